"""Checks of tangents and adjoints that tests of several schemes share."""

import numpy as np
from hypothesis import settings

# Few examples in the fast lane, in which each costs about as much as a compilation; 40 in the slow.
few_examples = settings(max_examples=min(40, settings().max_examples // 6))


def scales(run):
    """The largest entry of each moment, for every entry: they differ by powers of 1 / h."""
    data = run.final.data
    largest = np.abs(data).max(axis=tuple(range(1, data.ndim)), keepdims=True)
    return np.broadcast_to(largest, data.shape).ravel()


def dot_test(solver, run, rng):
    """The largest difference of the products, relative to the sum of the magnitudes.

    For changes of the state and of the parameters apart, each scaled as the run's moments.
    """
    tangent, adjoint, size = solver.tangent(run), solver.adjoint(run), run[0].data.size
    scale, worst = np.append(scales(run), np.ones(tangent.shape[1] - size)), 0.0
    for only in (slice(0, size), slice(size, None)):
        if scale[only].size == 0:
            continue
        x, y = np.zeros(scale.size), rng.standard_normal(size) / scale[:size]
        x[only] = (rng.standard_normal(scale.size) * scale)[only]
        forward, backward = tangent @ x, adjoint @ y
        assert np.any(forward)
        bound = np.abs(y) @ np.abs(forward) + np.abs(x) @ np.abs(backward)
        worst = max(worst, abs(y @ forward - x @ backward) / bound)
    return worst


def run_again(solver, run, **values):
    """The last moments of the same run with other values of parameters, flat."""
    other = solver.with_parameters(**values)
    return other.run(run[0], run.final.t, dt=run.dt).final.data.ravel()


def parameter_error(solver, run, e=2e-5):
    """The largest error of the tangent in any parameter, by differences of order four.

    With so small an `e` no foot passes an edge, where derivatives jump, and rounding is 1e-15 / e.
    """
    values, size, scale = solver.parameters, run[0].data.size, scales(run)
    tangent, worst = solver.tangent(run), 0.0
    for q, (name, value) in enumerate(values.items()):
        low, below, above, high = (
            run_again(solver, run, **{name: value + k * e}) for k in (-2, -1, 1, 2)
        )
        quotient = (8 * (above - below) - (high - low)) / (12 * e)
        found = tangent @ np.eye(size + len(values))[size + q]
        assert np.any(found)
        worst = max(worst, float(np.max(np.abs(found - quotient) / scale)))
    return worst


def taylor_order(solver, run, direction, sizes):
    """The order of the remainder of the nodal values in the size of a change of the parameters.

    `direction` has the change of each parameter by name.
    """
    size, nodes = run[0].data.size, run.final.data[0].size
    values = solver.parameters
    change = [direction.get(name, 0.0) for name in values]
    slope, errors = solver.tangent(run) @ np.append(np.zeros(size), change), []
    for e in sizes:
        moved = {name: values[name] + e * by for name, by in direction.items()}
        remainder = run_again(solver, run, **moved) - run.final.data.ravel() - e * slope
        errors.append(np.linalg.norm(remainder[:nodes]))
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
