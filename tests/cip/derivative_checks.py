"""Checks of tangents and adjoints that tests of several schemes share."""

from contextlib import contextmanager
from unittest import mock

import numpy as np
from hypothesis import settings

from cip.characteristics import feet
from cip.stages import stage

# Few examples in the fast lane, in which each costs about as much as a compilation; 40 in the slow.
few_examples = settings(max_examples=min(40, settings().max_examples // 6))


@contextmanager
def equal_substeps():
    """As many in every run: with another number the feet differ by up to 1e-8 cells."""

    def integrate(*arguments):
        return feet.integrate(*arguments[:6], substeps=16)

    with (
        mock.patch.object(stage, "integrate", integrate),
        mock.patch.object(stage.Stage, "substeps", return_value=16),
    ):
        yield


def scales(run):
    """The largest entry of each moment, for every entry: they differ by powers of 1 / h."""
    data = run.final.data
    largest = np.abs(data).max(axis=tuple(range(1, data.ndim)), keepdims=True)
    return np.broadcast_to(largest, data.shape).ravel()


def dot_test(solver, run, rng):
    """Differences of the products over sums of magnitudes, for state and parameters apart."""
    tangent, adjoint, size = solver.tangent(run), solver.adjoint(run), run[0].data.size
    scale, found = np.append(scales(run), np.ones(tangent.shape[1] - size)), []
    assert adjoint.shape == tangent.shape[::-1]
    for only in (slice(0, size), slice(size, None)):
        if scale[only].size == 0:
            continue
        x, y = np.zeros(scale.size), rng.standard_normal(size) / scale[:size]
        x[only] = (rng.standard_normal(scale.size) * scale)[only]
        forward, backward = tangent @ x, adjoint @ y
        assert np.any(forward)
        bound = np.abs(y) @ np.abs(forward) + np.abs(x) @ np.abs(backward)
        found.append(abs(y @ forward - x @ backward) / bound)
    return found


def run_again(solver, run, **values):
    """The last moments of the same run with other values of parameters, flat."""
    other = solver.with_parameters(**values)
    return other.run(run[0], run.final.t, dt=run.dt).final.data.ravel()


def along(solver, run, name):
    """The tangent in one parameter."""
    names, size = list(solver.parameters), run[0].data.size
    unit = np.zeros(size + len(names))
    unit[size + names.index(name)] = 1.0
    return solver.tangent(run) @ unit


def parameter_error(solver, run, e=2e-5):
    """The largest error of the tangent in any parameter, by differences of order four."""
    worst = 0.0
    for name, value in solver.parameters.items():
        low, below, above, high = (
            run_again(solver, run, **{name: value + k * e}) for k in (-2, -1, 1, 2)
        )
        quotient = (8 * (above - below) - (high - low)) / (12 * e)
        found = along(solver, run, name)
        assert np.any(found)
        worst = max(worst, float(np.max(np.abs(found - quotient) / scales(run))))
    return worst


def state_error(solver, run, rng):
    """The scheme is affine in the state: runs of two states differ by the tangent's product."""
    change = rng.standard_normal(run[0].data.size) * scales(run)
    other = solver.state(0.0)
    other.data[...] = run[0].data + change.reshape(other.data.shape)
    difference = solver.run(other, run.final.t, dt=run.dt).final.data - run.final.data
    found = solver.tangent(run) @ np.append(change, np.zeros(len(solver.parameters)))
    return np.max(np.abs(found - difference.ravel()) / scales(run))


def taylor_order(solver, run, direction, sizes):
    """The order of the remainder in a change of the parameters, given by their names."""
    size, nodes = run[0].data.size, run.final.data[0].size
    values = solver.parameters
    change = [direction.get(name, 0.0) for name in values]
    slope, errors = solver.tangent(run) @ np.append(np.zeros(size), change), []
    for e in sizes:
        moved = {name: values[name] + e * by for name, by in direction.items()}
        remainder = run_again(solver, run, **moved) - run.final.data.ravel() - e * slope
        errors.append(np.linalg.norm(remainder[:nodes]))
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
