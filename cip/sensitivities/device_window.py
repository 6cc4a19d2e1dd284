"""The window of a run on a CUDA device: states, feet and sums stay there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cip.sensitivities.device_adjoint import DeviceAdjoint
from cip.sensitivities.window import ParameterPart, Window
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State


class DeviceWindow(Window):
    """As `Window`, with vectors of CuPy; derivatives of feet for the tangent are made on the host.

    Parameters
    ----------
    engine : CudaEngine
    *arguments
        Those of `Window`.
    """

    def __init__(self, engine: Any, *arguments: Any) -> None:
        import cupy

        super().__init__(*arguments)
        self._xp, self._engine = cupy, engine
        self._stages: dict[int, DeviceAdjoint] = {}
        self._orders: dict[Any, Any] = {}

    def operator(self) -> Any:
        """The derivative as a linear operator of CuPy (`cupyx.scipy.sparse.linalg`)."""
        from cupyx.scipy.sparse.linalg import LinearOperator

        size = self._start.data.size
        shape = (size, size + len(self.parameters))
        return LinearOperator(shape, self._tangent, rmatvec=self._adjoint, dtype=np.float64)

    def _on_device(self, n: int) -> DeviceAdjoint:
        stage = self._moves[n].stage
        if id(stage) not in self._stages:
            self._stages[id(stage)] = DeviceAdjoint(self._engine, stage)
        return self._stages[id(stage)]

    def _part(self, n: int) -> ParameterPart:
        found: ParameterPart = self._once(n, self._steady, self._placed)
        return found

    def _placed(self, stage: Stage, feet: StageFeet) -> ParameterPart:
        """The part of a stage, made on the host, on the device."""
        part = ParameterPart.of(stage, replace(feet, data=feet.data.get()))
        arrays = ("nodes", "cell", "feet", "by_parameter")
        return replace(part, **{name: self._xp.asarray(getattr(part, name)) for name in arrays})

    def _tangent(self, x: Any) -> Any:
        xp, size = self._xp, self._start.data.size
        x = xp.ravel(xp.asarray(x))
        given = x[size:].get()
        state = self._start
        change = State(state.grid, state.profile, x[:size].reshape(state.data.shape).copy())
        varies = given.any()
        for n, columns in enumerate(self._columns):
            new = self._advance(n, change, True)
            direction = given[columns]
            if direction.any():
                z = state.data.reshape(len(state.data), -1)
                more = self._part(n).along(z, xp.asarray(direction), xp).ravel()
                for wall in self._walls(n):
                    # Each place occurs once, so the order of additions is fixed.
                    xp.add.at(more, xp.asarray(wall.places), xp.asarray(direction @ wall.values))
                data = new.data + more.reshape(new.data.shape)
                new = State(state.grid, state.profile, data, new.t)
            if varies:
                state = self._advance(n, state)
            change = new
        return xp.ravel(change.data)

    def _adjoint(self, x: Any) -> Any:
        xp = self._xp
        weight = xp.asarray(x, dtype=float).reshape(len(self._start.data), -1).copy()
        found = np.zeros(len(self.parameters))
        segment: list[State] = []
        gathered: dict[Any, tuple[int, StageFeet, Any]] = {}
        for n in range(len(self._moves) - 1, -1, -1):
            feet, z, columns = self._feet(n), weight, self._columns[n]
            if self._varies:
                first = n - n % self.every
                if n == len(self._moves) - 1 or (n + 1) % self.every == 0:
                    segment = self._states(self._marks[first], first, n)
                z = segment[n - first].data.reshape(len(weight), -1)
            if columns and feet.bounded:
                for wall in self._walls(n):
                    found[columns] += wall.values @ weight.ravel()[xp.asarray(wall.places)].get()
            for correction in self._moves[n].stage.corrections(feet):
                if not correction.add:
                    weight.reshape(-1)[xp.asarray(correction.places)] = 0.0
            components = feet.data.reshape(-1, weight.shape[1])
            key = self._key(n)
            _, _, g = gathered.setdefault(key, (n, feet, xp.zeros(components.shape)))
            weight, order = self._on_device(n).pull_back(
                z, weight, components, g, self._orders.get(key)
            )
            if self._steady:
                self._orders[key] = order
            if not self._steady or n == 0:
                for m, where, total in gathered.values():
                    if self._columns[m]:
                        more = self._on_device(m).parameter_gradient(where, total)
                        found[self._columns[m]] += more
                gathered.clear()
        return xp.concatenate([weight.ravel(), xp.asarray(found)])
