"""Many quadratic programs with one call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple
from typing import Any, NamedTuple, overload

import numpy as np

from gpu.errors import GpuError, Infeasible, InputError, Unbounded
from gpu.qp.active_set.dual import LIMITS, room, stored
from gpu.qp.data.derivatives import Gradients, gradients
from gpu.qp.data.qp_problem import (
    EMPTY,
    SOLVED,
    UNDECIDED,
    FactoredMatrix,
    QPProblem,
    Rows,
    check_problem,
)
from gpu.qp.data.qp_problem import LIMITS as PROBLEM
from gpu.qp.data.qp_result import KKT, QPResult, Status
from gpu.qp.data.standard_qp import ROUNDING, is_sparse
from gpu.qp.solve_qp import checked_options, solve_qp
from skfem_adini.ground.arguments import flag, shown, unmasked
from skfem_adini.ground.arrays import cores, namespace, on_device, to_host

INFINITE = PROBLEM.infinite
CHAIN = 64  # problems that one thread solves in a row, each from the active set of the last


class QPBatch(Sequence[QPResult]):
    """Solutions of a batch, with their proofs; a sequence of `QPResult`.

    An item of a problem without solution raises its error; whole arrays hold NaN there.

    Attributes
    ----------
    x : (k, n) array
        Minimisers.
    y, z, z_box : (k, m), (k, l), (k, n) arrays
        Multipliers of the rows of A, of G and of the bounds, as in `QPResult`.
    active, active_rows : (k, n), (k, l) arrays of int8
        Signed states of the bounds and of the rows of G.
    kkt : (k, 5) array
        Residuals in the order of `KKT`.
    iterations : (k,) array of int
        Steps.
    status : tuple of Status
        What is known about each.
    errors : dict of int to GpuError
        The errors of those without solution, with certificates.

    Examples
    --------
    The second of two problems has no solution:

    >>> from gpu import batch_solve_qp
    >>> batch = batch_solve_qp([[2.0]], [[-1.0], [-4.0]], lb=[[0.0], [3.0]], ub=2.0)
    >>> batch.x.ravel().tolist(), [status.name for status in batch.status]
    ([0.5, nan], ['OPTIMAL', 'INFEASIBLE'])
    >>> batch[0].z_box.tolist()
    [0.0]
    """

    x: Any
    y: Any
    z: Any
    z_box: Any
    active: Any
    active_rows: Any
    kkt: Any
    iterations: Any
    status: tuple[Status, ...]
    errors: dict[int, GpuError]
    _data: _Data | None
    _alone: dict[int, QPResult]
    _shared: frozenset[str]  # of P, G and A

    @classmethod
    def _of(
        cls, data: _Data | None, found: _Found, equal: int, errors: dict[int, GpuError],
        alone: dict[int, QPResult], shared: frozenset[str],
    ) -> QPBatch:  # fmt: skip
        """What was found, the errors, and problems that were solved by themselves."""
        self = object.__new__(cls)
        m, self._shared = equal, shared
        self.x, self.z_box, self.kkt = found.x, found.z_box, found.kkt
        self.y, self.z = found.y[:, :m], found.y[:, m:]
        self.active_rows = found.active[:, m : found.y.shape[1]]
        self.active = found.active[:, found.y.shape[1] :]
        self.iterations, self.errors = found.count, errors
        self._data, self._alone, idle = data, alone, to_host(found.idle)
        names = {Infeasible: Status.INFEASIBLE, Unbounded: Status.UNBOUNDED}
        self.status = tuple(
            names.get(type(errors[i]), Status.FAILED) if i in errors
            else alone[i].status if i in alone
            else Status.DEGENERATE if idle[i] else Status.OPTIMAL
            for i in range(len(self.x))
        )  # fmt: skip
        return self

    def __repr__(self) -> str:
        solved, worst = len(self) - len(self.errors), np.nanmax(to_host(self.kkt), initial=0.0)
        return f"QPBatch({solved} of {len(self)} solved, residuals at most {worst:.1e})"

    def __len__(self) -> int:
        return len(self.x)

    @overload
    def __getitem__(self, i: int) -> QPResult: ...
    @overload
    def __getitem__(self, i: slice) -> list[QPResult]: ...
    def __getitem__(self, i: Any) -> Any:
        if isinstance(i, slice):
            return [self[k] for k in range(*i.indices(len(self)))]
        i = range(len(self))[i]
        if i in self.errors:
            raise self.errors[i]
        if i in self._alone or self._data is None:
            return self._alone[i]
        parts = (self.x, self.y, self.z, self.z_box, self.active, self.active_rows)
        x, y, z, z_box, active, active_rows = (part[i].copy() for part in parts)
        return QPResult(
            x, y, z, z_box, self.status[i], active,
            KKT(*to_host(self.kkt[i]).tolist()), int(self.iterations[i]), (), active_rows,
            _problem=self._data.member(i),
        )  # fmt: skip

    def __iter__(self) -> Iterator[QPResult]:
        return (self[i] for i in range(len(self)))

    def vjp(self, dx: Any = None, dz: Any = None, dy: Any = None, dz_box: Any = None) -> Gradients:
        """Gradients of functions of the solutions, one a problem, as `QPResult.vjp`.

        Parameters
        ----------
        dx, dz, dy, dz_box : (k, n), (k, l), (k, m), (k, n) array_like, optional
            Derivatives of the functions by `x`, `z`, `y`, `z_box`; zero where left out.

        Returns
        -------
        Gradients
            Arrays with a leading dimension k (lists of sparse ones). By dense P, G and A that all
            problems share it is 1, and the gradients are sums. Problems without solution have
            zeros and the flag. Arrays of the problems must be as they were.
        """
        given, data = (dx, dz, dy, dz_box), self._data
        for name, value in zip(("dx", "dz", "dy", "dz_box"), given, strict=True):
            if value is not None and np.shape(value)[:1] != (len(self),):
                raise InputError(
                    f"{name} has shape {np.shape(value)}: it must have a row for each of "
                    f"{len(self)} problems"
                )
        if data is not None and not self.errors:
            y = namespace(self.x).concatenate([self.y, self.z], axis=1)
            return _summed(gradients(data, self.x, y, self.z_box, given), self._shared)
        parts = [
            None if i in self.errors
            else self[i].vjp(*(None if part is None else part[i] for part in given))
            for i in range(len(self))
        ]  # fmt: skip
        return _summed(_together(parts), self._shared)


class _Found(NamedTuple):
    """Solutions of all problems, as `gpu.qp.active_set.dual.Found`."""

    x: Any
    y: Any
    z_box: Any
    active: Any
    kkt: Any
    code: Any
    idle: Any
    count: Any

    @classmethod
    def room(cls, k: int, m: int, n: int) -> _Found:
        """Arrays for k problems of m rows and n variables."""
        code, idle, count = (np.zeros(k, kind) for kind in (np.int8, bool, np.int64))
        x, y, z_box, active, kkt = room(m, n, k)
        return cls(x, y, z_box, active, kkt, code, idle, count)


class _Data(NamedTuple):
    """Problems as the compiled methods take them; what has the leading size 1 is shared."""

    P: Any
    C: Any
    q: Any
    low: Any  # sides of rows, then of bounds
    high: Any
    equal: int

    def member(self, i: int) -> Rows:
        """One problem."""
        P, C, q, low, high = (part[i % len(part)] for part in self[:5])
        return Rows(P, C, q, low, high, self.equal, len(C) - self.equal)


def _put(found: _Found, i: int, result: QPResult) -> None:
    """Fill in a problem that was solved by itself."""
    xp = namespace(found.x)
    found.x[i], found.z_box[i] = xp.asarray(result.x), xp.asarray(result.z_box)
    found.y[i] = xp.concatenate([xp.asarray(result.y), xp.asarray(result.z)])
    equal = result.y.size
    found.active[i, :equal] = xp.sign(found.y[i, :equal]).astype(np.int8)
    states = [xp.asarray(value) for value in (result.active_rows, result.active)]
    found.active[i, equal:] = xp.concatenate(states)
    found.kkt[i] = xp.asarray(astuple(result.kkt))
    found.count[i] = result.iterations


def _clear(found: _Found, i: int) -> None:
    """Leave nothing of a problem without solution."""
    for array in (found.x, found.y, found.z_box, found.kkt):
        array[i] = np.nan
    found.active[i] = 0


class _Given:
    """The arguments of a batch: which are shared, and those of one problem."""

    names = "P", "q", "G", "h", "A", "b", "lb", "ub", "h_low"

    def __init__(self, count: int, *values: Any) -> None:
        self.count, self.values, self.own = count, list(values), [False] * len(values)
        for place, (name, value) in enumerate(zip(self.names, values, strict=True)):
            unmasked(name, value)
            dimensions = 3 if name in "PGA" else 2
            if value is None or isinstance(value, FactoredMatrix) or is_sparse(value):
                continue
            if not isinstance(value, np.ndarray) and not on_device(value):
                try:
                    value = np.asarray(value)
                except ValueError as error:
                    raise InputError(f"{name} is not an array of real numbers: {error}") from None
            self.own[place] = value.ndim == dimensions
            if self.own[place]:
                self.values[place] = value
            if self.own[place] and len(value) != count:
                raise InputError(f"{name} has {len(value)} rows: there are {count} linear terms q")

    def member(self, i: int) -> dict[str, Any]:
        """The arguments of `solve_qp` for one problem."""
        parts = zip(self.names, self.values, self.own, strict=True)
        return {name: value[i] if own else value for name, value, own in parts}

    def room(self, first: QPProblem | None) -> _Found:
        """Arrays for problems that are solved by themselves, with one factor where P is shared."""
        if first is None:
            return _Found.room(0, 0, 0)
        if not self.own[0]:
            self.values[0] = first.factor
        found = _Found.room(self.count, first.b.size + first.row_low.size, first.q.size)
        xp = namespace(first.q)
        return found if xp is np else _Found(*(xp.asarray(value) for value in found))

    def stacked(self, first: QPProblem) -> _Data:
        """The data of all, after the check of the first."""
        xp, m = namespace(first.q), first.b.size
        f = first
        values = (f.factor.P, f.q, f.G, f.row_high, f.A, f.b, f.lb, f.ub, f.row_low)
        shared = dict(zip(self.names, values, strict=True))
        part = {
            name: xp.asarray(value, dtype=float) if own else shared[name][None]
            for name, value, own in zip(self.names, self.values, self.own, strict=True)
        }
        for name, value in part.items():
            if value.shape[1:] != shared[name].shape:
                raise InputError(f"{name} has shape {value.shape[1:]} in a problem: others differ")
        C, low, high = (
            self._joined(xp, [part[name] for name in names])
            for names in (("A", "G"), ("b", "h_low", "lb"), ("b", "h", "ub"))
        )
        keep = stored if xp is np else xp.ascontiguousarray
        P, q = part["P"], part["q"]
        return _Data(keep(P), keep(C), keep(q), keep(low), keep(high), m)

    def _joined(self, xp: Any, parts: list[Any]) -> Any:
        """Arrays one below the other; copied for each problem if one of them is its own."""
        size = max(len(part) for part in parts)
        whole = [xp.broadcast_to(part, (size, *part.shape[1:])) for part in parts]
        return xp.concatenate(whole, axis=1)


def batch_solve_qp(
    P: Any,
    q: Any,
    G: Any = None,
    h: Any = None,
    A: Any = None,
    b: Any = None,
    lb: Any = None,
    ub: Any = None,
    *,
    h_low: Any = None,
    start: Any = None,
    tol: float = 1e-9,
    warm_start: bool = True,
    host_below: int = 0,
) -> QPBatch:
    """Solve many problems of one shape.

    Each argument is that of one problem, shared by all, or has one more dimension in front, of
    length k. Small dense problems are solved by a compiled dual active set, on the host in as many
    threads as there are processors, on a device by one warp or block a problem; others one by one.

    Parameters
    ----------
    P : (n, n) or (k, n, n) array_like, QPFactor
    q : (k, n) array_like
        Linear terms, one a row.
    G, A : (l, n) or (k, l, n), (m, n) or (k, m, n) array_like, optional
    h, h_low : (l,) or (k, l) array_like or float, optional
    b : (m,) or (k, m) array_like, optional
    lb, ub : (n,) or (k, n) array_like or float, optional
        As in `solve_qp`.
    start : QPBatch, optional
        The result of nearby problems, one each, from whose active sets to begin.
    tol, host_below
        As in `solve_qp`.
    warm_start : bool, optional
        Whether problems that share P, G and A may begin at the active set of the one before.

    Returns
    -------
    QPBatch
        Solutions, states and residuals of all; problems without solution are reported in place.

    Raises
    ------
    InputError
        As for `solve_qp`, or numbers of problems that differ; where one problem is the cause, its
        number is the attribute `index`.

    Notes
    -----
    Results do not depend on the number of threads.

    Examples
    --------
    >>> from gpu import batch_solve_qp
    >>> results = batch_solve_qp([[2.0]], [[-1.0], [-4.0]], lb=0.0, ub=1.0)
    >>> [result.x.tolist() for result in results]
    [[0.5], [1.0]]
    """
    warm_start, count = flag("warm_start", warm_start), _rows("q", q)
    checked_options(tol, host_below)
    batch = _Given(count, P, q, G, h, A, b, lb, ub, h_low)
    if start is not None and (not isinstance(start, QPBatch) or len(start) != count):
        raise InputError(f"start is {shown(start)}: it must be a QPBatch of {count} problems")
    if not batch.own[1]:
        raise InputError("q has one dimension: it must have a row for each problem")
    first = check_problem(**batch.member(0)) if count else None
    if first is not None and start is not None:
        sizes = (first.q.size, first.b.size, first.row_low.size)
        found_sizes = tuple(part.shape[1] for part in (start.x, start.y, start.z))
        if found_sizes != sizes:
            raise InputError(
                f"start has {found_sizes} variables, equality rows and inequality rows: the "
                f"problems have {sizes}"
            )
    if first is not None and _fits(first):
        data = batch.stacked(first)
        found = _solved(data, count, start, warm_start, tol)
        least = min(ROUNDING.sharp, tol)
        solved = (found.code == SOLVED) & (found.kkt.max(axis=1) <= least)
    else:
        data, found = None, batch.room(first)
        solved = found.idle
    errors: dict[int, GpuError] = {}
    alone: dict[int, QPResult] = {}
    last: QPResult | None = None
    for i in np.flatnonzero(~to_host(solved)).tolist():
        if namespace(found.x) is not np and found.code[i] == EMPTY:
            errors[i] = Infeasible("no point of the box satisfies the rows", found.y[i].copy())
            _clear(found, i)
            continue
        before = last if warm_start and data is None else None
        if start is not None and i not in start.errors:
            before = start[i]
        try:
            last = solve_qp(**batch.member(i), start=before, tol=tol, host_below=host_below)
        except InputError as error:
            error.index = i  # type: ignore[attr-defined]
            raise
        except GpuError as error:
            _clear(found, i)
            errors[i] = error
        else:
            _put(found, i, last)
            alone[i] = last
    equal = 0 if first is None else first.b.size
    shared = (name for name, own in zip(batch.names, batch.own, strict=True) if not own)
    return QPBatch._of(data, found, equal, errors, alone, frozenset(shared) & {"P", "G", "A"})


def _fits(first: QPProblem) -> bool:
    """Whether the compiled methods take such a problem."""
    P = first.factor.P
    return not is_sparse(P) and first.factor.definite and first.q.size <= LIMITS.unknowns


def _summed(found: Gradients, shared: frozenset[str]) -> Gradients:
    """The gradients, those by what all problems share as sums."""
    sums = {
        name: value.sum(axis=0, keepdims=True)
        for name, value in found._asdict().items()
        if name in shared and value is not None and not isinstance(value, list)
    }
    return found._replace(**sums)


def _together(parts: list[Gradients | None]) -> Gradients:
    """Gradients of problems one by one, in the arrays of a batch."""
    some = next((part for part in parts if part is not None), None)
    if some is None:
        raise InputError("no problem of the batch has a solution: nothing has derivatives")
    xp, fields = namespace(some.q), dict[str, Any]()
    for name, like in some._replace(degenerate=None)._asdict().items():
        if like is None:
            fields[name] = None
            continue
        zero = 0.0 * like
        values = [zero if part is None else getattr(part, name) + zero for part in parts]
        fields[name] = values if is_sparse(like) else xp.stack(values)
    fields["degenerate"] = xp.asarray([part is None or part.degenerate for part in parts])
    return Gradients(**fields)


def _solved(data: _Data, count: int, start: QPBatch | None, chain: bool, tol: float) -> _Found:
    """Solve all on the device of their arrays, or in threads; what misses its certificate shows."""
    m, n = data.C.shape[1:]
    state = np.zeros((1, m + n), np.int8)
    if start is not None:
        parts = [to_host(part) for part in (start.active_rows, start.active)]
        equal = np.zeros((count, data.equal), np.int8)
        state = np.ascontiguousarray(np.concatenate([equal, *parts], axis=1))
    if namespace(data.q) is not np:
        return _on_device(data, state, tol)
    from gpu.qp.active_set.dual_kernels import solve_many

    found = _Found.room(count, m, n)
    boxes = data.member(0).boxes_only

    chain, most = chain and start is None, LIMITS.steps * (m + n)

    def run(first: int) -> None:
        last = min(first + CHAIN, count)
        solve_many(*data[:5], state, boxes, chain, first, last, most, tuple(found))

    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(run, range(0, count, CHAIN)))
    return found


def _on_device(data: _Data, state: np.ndarray, tol: float) -> _Found:
    """The same on a device."""
    from gpu.qp.active_set.dual_device import solve_batch

    xp, m = namespace(data.q), data.C.shape[1]
    low = xp.where(data.low <= -INFINITE, -xp.inf, data.low)
    high = xp.where(data.high >= INFINITE, xp.inf, data.high)
    good = (xp.swapaxes(data.P, 1, 2) == data.P).all(axis=(1, 2))
    good = good & xp.isfinite(data.q).all(axis=1)
    good = good & ((low <= high) & (low < INFINITE) & (high > -INFINITE)).all(axis=1)
    given = xp.asarray(state) if state.any() else None
    found = solve_batch(
        data.P, data.q, data.C, low[:, :m], high[:, :m], low[:, m:], high[:, m:], given, tol
    )
    primal, stationarity, gap, pairs = found.residuals.T
    kkt = xp.stack([stationarity, primal, xp.zeros_like(gap), pairs, gap], axis=1)
    code = xp.where(good, found.code, UNDECIDED).astype(np.int8)
    idle = ((found.state[:, m:] != 0) & (found.z_box == 0.0) & (low < high)[:, m:]).any(axis=1)
    return _Found(found.x, found.y, found.z_box, found.state, kkt, code, idle, found.steps)


def _rows(name: str, value: Any) -> int:
    """Number of problems for which an argument holds a vector."""
    unmasked(name, value)
    dense = getattr(value, "ndim", 0) > 0 and not hasattr(value, "tocsr")
    dense = dense and hasattr(value, "__len__")
    if not dense and not (isinstance(value, Sequence) and not isinstance(value, str | bytes)):
        raise InputError(
            f"{name} is {shown(value)}: it must hold one vector for each problem, in a list or in "
            "the rows of a dense array"
        )
    return len(value)
