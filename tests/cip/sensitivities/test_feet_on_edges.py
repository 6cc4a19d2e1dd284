"""Where feet lie on edges of cells, derivatives are the mean of both sides.

Difference quotients of the scheme itself, taken from both sides, are the oracle.
"""

import numpy as np
import pytest

from cip import Grid, IdentifiedVelocity, Solver, Velocity, identify_velocity

LINE, PLANE = Grid((0, 1), 16, periodic=True), Grid([(0, 1), (0, 1)], (9, 8), periodic=True)
CASES = {
    "cubic": (LINE, ["a"], {"a": 0.0}),
    "quintic": (LINE, ["a"], {"a": 0.0}),
    "csl2": (LINE, ["a"], {"a": 0.0}),
    "csl4": (LINE, ["a"], {"a": 0.0}),
    "whole cells": (LINE, ["a"], {"a": 0.625}),  # one cell a step
    "backward": (LINE, ["a*cos(t)"], {"a": 0.0}),
    "some feet": (LINE, ["a*sin(2*pi*x1)"], {"a": 0.7}),  # those of two nodes at rest
    "walls": (Grid((0, 1), 12), ["a*x1*(1 - x1)"], {"a": 0.0}),
    "adini": (PLANE, ["a", "b"], {"a": 0.0, "b": 0.0}),
    "bicubic": (PLANE, ["a", "b"], {"a": 0.0, "b": 0.0}),
    "shear": (PLANE, ["a*sin(2*pi*x2)", "0"], {"a": 1.0}),  # never moved across: one side there
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CASES)
def test_quotients_from_both_sides(name):
    grid, texts, values = CASES[name]
    profile = name if name in ("quintic", "csl2", "csl4", "adini", "bicubic") else "cubic"
    profile = "adini" if name == "shear" else profile
    form = "advection" if profile.startswith("csl") else "transport"
    solver = Solver(grid, Velocity.from_expression(*texts, parameters=values), form, profile)
    field = "exp(sin(2*pi*x1) + 0.3)" if grid.dim == 1 else "exp(sin(2*pi*x1) + cos(2*pi*x2 + 1))"
    start = solver.state(field)
    run = solver.run(start, 0.2, dt=0.1)
    tangent, adjoint, size = solver.tangent(run), solver.adjoint(run), start.data.size
    rng, e = np.random.default_rng(0), 1e-5
    for q, (parameter, value) in enumerate(values.items()):
        ends = [
            solver.with_parameters(**{parameter: value + k * e}).run(start, 0.2, dt=0.1).final.data
            for k in (-1, 1)
        ]
        quotient = (ends[1] - ends[0]) / (2 * e)
        found = (tangent @ np.eye(size + len(values))[size + q]).reshape(quotient.shape)
        scale = np.abs(quotient).max(axis=tuple(range(1, quotient.ndim)), keepdims=True)
        # The quotient's error: e times a jump of second derivatives; one side is 1e-2 off.
        assert np.max(np.abs(found - quotient) / np.where(scale > 0, scale, 1.0)) < 2e-5
        weight = rng.standard_normal(size)
        products = weight * found.ravel()
        assert abs((adjoint @ weight)[size + q] - products.sum()) <= 1e-13 * np.abs(products).sum()


@pytest.mark.parametrize(("a", "feet"), [(0.0, 32), (0.625, 32), (0.6, 0)])
def test_the_results_say_how_many_feet(a, feet, tmp_path):
    velocity = Velocity.from_expression("a", parameters={"a": a})
    solver = Solver(LINE, velocity)
    start = solver.state("exp(sin(2*pi*x1))")
    run = solver.run(start, 0.2, dt=0.1)
    assert solver.tangent(run).feet_on_edges() == feet
    found = identify_velocity(solver, start, {0.2: run.final["u"]}, dt=0.1, noise=0.01)
    assert found.parameters["a"] == a
    assert found.feet_on_edges == feet
    found.save(tmp_path / "found.json")
    assert IdentifiedVelocity.load(tmp_path / "found.json", velocity).feet_on_edges == feet
