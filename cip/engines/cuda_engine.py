"""Stages on a CUDA device: kernels are translated to C and compiled by NVRTC through CuPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cip.engines.cuda_displacements import DeviceDisplacements
from cip.engines.cuda_kernels import compiled, device_source, feet_source, launch
from cip.engines.displacements import Displacements
from cip.engines.engine import Engine, Setting, Tally
from cip.engines.path_kernel import PATH
from cip.errors import InputError
from cip.formulas.snapshots import snapshots_of
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State, state_of
from skfem_adini.ground.errors import optional


class CudaEngine(Engine):
    """Runs the stages with CuPy; states stay on the device."""

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        cupy = optional(
            "cupy",
            "backend='cupy' needs CuPy: pip install 'skfem-adini[cuda13]' (or [cuda12]), by the "
            "CUDA version of the driver",
        )
        try:
            cupy.cuda.runtime.getDeviceCount()
        except cupy.cuda.runtime.CUDARuntimeError as error:
            raise InputError(
                f"backend='cupy': no CUDA device answers ({error}); take backend='cpu' here"
            ) from error
        self.xp = self._cupy = cupy
        self._compiled: dict[Any, Any] = {}
        self._certain: set[Any] = set()
        self._splines: Any = None
        grid = setting.grid
        widths = [] if all(grid.uniform) else grid.widths  # equal widths: constants in the kernels
        self._widths = [cupy.asarray(width.astype(self.dtype)) for width in widths]
        self._lines = [cupy.asarray(line.astype(self.dtype)) for line in grid.coordinates]
        self.real = "double" if self.dtype == np.float64 else "float"
        self.index = "int" if 16 * grid.size < 2**31 else "long long"
        self.whole = np.int32 if self.index == "int" else np.int64

    def place(self, state: State) -> State:
        """The state in a CuPy array of the setting's precision."""
        data = self._cupy.ascontiguousarray(self._cupy.asarray(state.data, dtype=self.dtype))
        return state_of(self.grid, state.profile, data, state.t, fields=state.fields)

    def place_feet(self, feet: StageFeet) -> StageFeet:
        """Feet on the device, in the setting's precision."""
        return replace(feet, data=self._cupy.asarray(feet.data.astype(self.dtype, copy=False)))

    def empty(self, data: Any) -> Any:
        """Uninitialized memory for the new moments."""
        return self._cupy.empty_like(data)

    def correct(self, flat: Any, places: Any, values: Any, add: bool) -> None:
        """Write values to (or add them at) indices into the flat moments."""
        where = self._cupy.asarray(places)
        what = self._cupy.asarray(values.astype(self.dtype))
        if add:
            self._cupy.add.at(flat, where, what)
        else:
            flat[where] = what

    def _by_displacements(self, stage: Stage) -> Displacements | None:
        """Planes with walls have kernels that reach them; the same serve for very long formulas."""
        if not stage.conservative and not all(self.grid.periodic):
            return None
        made = DeviceDisplacements(stage, self._memory.flows, self)
        return made if made.fits else None

    def apply(
        self,
        stage: Stage,
        data: Any,
        t: float,
        dt: float,
        homogeneous: bool = False,
        kept: list[StageFeet] | None = None,
        known: StageFeet | None = None,
        tallies: Sequence[Tally] = (),
    ) -> Any:
        """As in the base class; planes without kinks take differences within their update."""
        moved, key = self._displaced(stage), ("kinks", *stage.part(dt))
        alone = kept is None and known is None and key not in self._counts
        if alone and isinstance(moved, DeviceDisplacements) and moved.fused:
            out = self.empty(data)

            def attempt(t: float, dt: float, count: int) -> bool:
                return moved.update(data.reshape(-1), out.reshape(-1), t, dt, count)

            if self._refined(moved, t, dt, attempt):
                return out
            self._counts[key] = t, 1
        return super().apply(stage, data, t, dt, homogeneous, kept, known, tallies)

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any, prefix: str = "node_") -> None:
        """Run a stage's kernel over all nodes with stored feet; the arrays are flat. `prefix`
        chooses another one than the update."""
        arguments = [feet, *self._widths]
        if stage.conservative:
            limits = (*self.bounds(stage), self.setting.bounds_tolerance)
            arguments += [self.dtype.type(value) for value in limits]
        self._start(stage, False, [m, out, *arguments], prefix)

    def launch_path(
        self, stage: Stage, m: Any, out: Any, t_end: float, dt: float, count: int
    ) -> int:
        """Run a stage's kernel that computes the feet too; return the bits that `path` returned."""
        said = self._cupy.zeros(1, np.int32)
        real = self.dtype.type
        clock = [real(t_end), real(dt / count), self.whole(count), said]
        clock += [*self._table(stage), *(real(value) for value in stage.parameters)]
        self._start(stage, True, [m, out, *self._lines, *clock, *self._widths])
        part = (stage.axis, dt, count)
        if part in self._certain:
            return 0
        left, coarse = (int(byte != 0) for byte in said.get().view(np.uint8)[:2])
        found = PATH.left * left | PATH.coarse * coarse
        if self.setting.steady and not found:
            # Every later step has the same feet, so the host need not wait for their codes.
            self._certain.add(part)
        return found

    def _compiled_feet(self, stage: Stage, t: float, dt: float) -> StageFeet | None:
        """As in the base class, on the device except for means and velocities from snapshots."""
        if stage.conservative or snapshots_of(stage.velocity) is not None:
            return super()._compiled_feet(stage, t, dt)
        cupy, real, size = self._cupy, self.dtype.type, self.grid.size
        t_end, length = t + stage.end * dt, (stage.end - stage.begin) * dt
        feet = cupy.empty(len(stage.jets) * size, self.dtype)
        kernel = compiled(feet_source(stage, self.real, self.index))
        values = [real(value) for value in stage.parameters]

        def attempt(count: int) -> int:
            said = cupy.zeros(1, np.int32)
            clock = [real(t_end), real(length / count), self.whole(count), said]
            kernel((-(-size // 128),), (128,), (feet, *self._lines, *clock, *values))
            left, coarse = (int(byte != 0) for byte in said.get().view(np.uint8)[:2])
            return PATH.left * left | PATH.coarse * coarse

        if not self._refine(stage, t, dt, attempt):
            return None
        count = self._counts[stage.part(dt)][1]
        return StageFeet(feet, [None], t + stage.begin * dt, t_end, (count,))

    def _table(self, stage: Stage) -> list[Any]:
        """The table of a velocity from snapshots on the device, as a list; empty for others."""
        field = snapshots_of(stage.velocity)
        if field is None:
            return []
        if self._splines is None:
            self._splines = self._cupy.asarray(field.table.astype(self.dtype))
        return [self._splines]

    def _start(
        self, stage: Stage, computed: bool, arguments: list[Any], prefix: str = "node_"
    ) -> None:
        fields = len(self.fields(arguments[0]))
        key = (stage.axis, computed, prefix, fields)
        kernel = self._compiled.get(key)
        if kernel is None:
            name = self.name(stage, prefix)
            types = self.real, self.index
            source = device_source(stage, name, self.limiter, computed, *types, fields)
            kernel = self._compiled[key] = compiled(source)
        launch(kernel, stage, *arguments)
