"""What all histories of load steps have: a sequence of results, tables and files of pictures."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.output.tables import steps_frame
from contact.output.vtk import block_sets, boundary_grids
from contact.result.contact_fields import as_html, facts
from skfem_adini.ground.vtk_files import write_series

Array = NDArray[np.float64]
Result = TypeVar("Result", bound=Any)
logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False, repr=False)
class StepHistory(Generic[Result]):
    """The finished steps of a history: results, and their times, shape (n,)."""

    times: Array = field(default_factory=lambda: np.zeros(0))
    results: tuple[Result, ...] = ()

    def __repr__(self) -> str:
        if not len(self):
            return f"{type(self).__name__}(no step)"
        return f"{type(self).__name__}({self._span}; the last: {self.results[-1]!r})"

    @property
    def _span(self) -> str:
        return f"{len(self)} steps from t = {self.times[0]:.6g} to {self.times[-1]:.6g}"

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[Result]:
        return iter(self.results)

    @overload
    def __getitem__(self, place: int) -> Result: ...

    @overload
    def __getitem__(self, place: slice) -> Self: ...

    def __getitem__(self, place: int | slice) -> Result | Self:
        """The result of one step, counted from zero, or a part of the history."""
        if isinstance(place, slice):
            return type(self)(self.times[place], self.results[place])
        return self.results[place]

    @property
    def resultant(self) -> Array:
        """Force of the obstacle on the body in each step, shape (n, dim)."""
        return np.array([result.resultant for result in self.results])

    def _repr_html_(self) -> str:
        if not len(self):
            return f"<p>{self!r}</p>"
        about = {"history": self._span, **facts(self.results[-1])}
        return as_html(about, f"{type(self).__name__}, its last step")

    def to_frame(self) -> Any:
        """The steps as a table: time, forces, numbers of points by status, largest residual.

        Returns
        -------
        pandas.DataFrame
            One row a step. `ContactResult.to_frame` has the points of one.

        Raises
        ------
        MissingDependency
            pandas is not installed.
        """
        return steps_frame(self)

    def to_pvd(self, path: str | Path, subdivide: int | None = None) -> Path:
        """Write the body, and beside it the contact boundary, as series that ParaView animates.

        ``name.pvd`` lists ``name_0000.vtu``, ...; ``name_boundary.pvd`` lists the contact points,
        ``name_boundary_0000.vtp``, .... In Python ``pyvista.get_reader("name.pvd")`` reads them.
        Of several bodies ``name.pvd`` lists ``name_0000.vtm``, ..., each with the blocks of
        `ContactResult.to_pyvista`.

        Parameters
        ----------
        path : str or Path
            Ends in .pvd.
        subdivide : int, optional
            As for `ContactResult.to_pyvista`.

        Returns
        -------
        Path
            The collection of the body.

        Raises
        ------
        InputError
            Another suffix, or a history without a step.
        MissingDependency
            pyvista is not installed.
        """
        path = as_path(path)
        if path.suffix != ".pvd":
            raise InputError(f"path: expected a name ending in .pvd, got {path.name!r}")
        if not self.results:
            raise InputError("history: has no finished step to write")
        times = self.times.tolist()
        write_series(
            path.with_name(f"{path.stem}_boundary.pvd"),
            zip(times, boundary_grids(self.results), strict=True),
        )
        several = len(self.results[0].system.body.bodies) > 1
        steps: Iterable[Any] = (
            block_sets(self.results, subdivide)
            if several
            else (r.to_pyvista(subdivide) for r in self.results)
        )
        return write_series(path, zip(times, steps, strict=True))[0]


def reporter(progress: bool, callback: Callable[[Any], None] | None) -> Callable[[Any], None]:
    """What a run does with a finished step: log it, print it, hand it to the callback."""
    if callback is not None and not callable(callback):
        raise InputError(f"callback={callback!r}: expected a function of a finished step")

    def report(step: Any) -> None:
        logger.info("%s", step)
        if progress:
            print(step, flush=True)
        if callback is not None:
            callback(step)

    return report


def as_path(path: str | Path) -> Path:
    """The path, or an `InputError` if it is not one."""
    try:
        return Path(path)
    except TypeError:
        raise InputError(f"path={path!r}: expected the name of a file or folder") from None
