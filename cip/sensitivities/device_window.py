"""The window of a run on a CUDA device: states, feet and sums stay there."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.sensitivities.device_adjoint import DeviceAdjoint
from cip.sensitivities.device_tangent import DevicePathTangent, DevicePush
from cip.sensitivities.window import Window
from cip.stages.stage import Stage, StageFeet


class DeviceWindow(Window):
    """As `Window`, with vectors of CuPy.

    Derivatives of what enters through walls are made on the host.

    Parameters
    ----------
    engine : CudaEngine
    *arguments
        Those of `Window`.
    """

    def __init__(self, engine: Any, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._xp, self._engine = engine.xp, engine
        self._stages: dict[int, DeviceAdjoint] = {}
        self._pushes: dict[Stage, DevicePush] = {}
        self._orders: dict[Any, Any] = {}

    def _linear(self, tangent: Any, adjoint: Any, columns: int) -> Any:
        """An operator of CuPy."""
        from cupyx.scipy.sparse.linalg import LinearOperator

        shape = (self._start.data.size, columns)
        return LinearOperator(shape, tangent, rmatvec=adjoint, dtype=np.float64)

    def _on_device(self, n: int) -> DeviceAdjoint:
        stage = self._moves[n].stage
        if id(stage) not in self._stages:
            self._stages[id(stage)] = DeviceAdjoint(self._engine, stage)
        return self._stages[id(stage)]

    def _pull_back(self, n: int, z: Any, weight: Any, feet: Any, g: Any) -> Any:
        orders = self._orders.get(self._key(n))
        back, orders = self._on_device(n).pull_back(z, weight, feet, g, orders)
        if self._steady:
            self._orders[self._key(n)] = orders
        return back

    def _gradient(self, n: int, feet: StageFeet, g: Any) -> Any:
        return self._on_device(n).parameter_gradient(feet, g)

    def _new_tangent(self, stage: Stage) -> DevicePathTangent:
        return DevicePathTangent(self._engine, stage)

    def _push_forward(self, n: int, z: Any, feet: Any, changes: Any) -> Any:
        stage = self._moves[n].stage
        if stage not in self._pushes:
            self._pushes[stage] = DevicePush(self._engine, stage)
        return self._pushes[stage].forward(self._blocks_of(stage), z, feet, changes)
