"""Bodies held by contact and friction alone: in all units, above gaps, by every method."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import MeshQuad, MeshTri

from contact import ContactProblem, ElasticBody, LoadStepper, Unbounded

METHODS = ("newton", "pdas", "tresca_loop")
CELLS = {"P1": MeshTri, "Q1": MeshQuad}


def block(kind="P1", cells=(4, 3), lengths=(1.0, 0.6), E=1.0, nu=0.3):
    x, y = (np.linspace(0, length, n + 1) for length, n in zip(lengths, cells, strict=True))
    mesh = CELLS[kind].init_tensor(x, y).with_defaults()
    return ElasticBody.from_mesh(mesh, E=E, nu=nu)


def solved(gap=0.0, side=0.2, load=1e-4, friction=0.3, method="newton", unit=1.0, E=1.0, **more):
    """A block that nothing holds, pressed by `load` and pushed by a share of that."""
    compliance = more.pop("compliance", None)
    lengths = more.pop("lengths", (1.0, 0.6))
    body = block(lengths=tuple(unit * length for length in lengths), E=E, **more)
    body.load("top", (side * load * E, -load * E))
    law = {} if compliance is None else {"overclosure": compliance * E / unit}
    height = (lambda x: unit * gap(x / unit)) if callable(gap) else unit * gap
    return ContactProblem(body, "bottom", height, friction=friction, **law).solve(method=method)


def below(x):
    return 0.01 * np.sin(3 * x[0] + 1) ** 2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("load", [1e-3, 1e-5, 1e-6])
@pytest.mark.parametrize("gap", [0.0, 0.02, below])
def test_light_loads_over_gaps(method, load, gap):
    """The springs of the start bear light loads short of the obstacle, and no friction results."""
    result = solved(gap, 0.2, load, method=method)
    assert result.resultant == pytest.approx([-0.2 * load, load], rel=1e-8)
    assert max(result.kkt.values()) < 1e-10


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", CELLS)
def test_near_the_limit_of_friction(method, kind):
    """On flat ground the sum of the pressure is the load: up to F times it friction holds."""
    result = solved(0.0, 0.29, kind=kind, method=method, lengths=(1.0, 0.3))
    assert result.resultant == pytest.approx([-0.29e-4, 1e-4], rel=1e-8)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("stiffness", [1e-2, 1.0, 100.0])
def test_compliant_surfaces(method, stiffness):
    result = solved(0.0, 0.08, friction=0.1, method=method, compliance=stiffness)
    assert result.resultant == pytest.approx([-0.08e-4, 1e-4], rel=1e-8)


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([1e-6, 1e-3, 1.0, 1e4]),
    st.sampled_from([1e-9, 1e-6, 1.0, 1e5, 2e11]),
    st.floats(0.05, 1.5),
    st.floats(0.3, 3.0),
    st.sampled_from(["P1", "Q1"]),
)
def test_what_tips_over_is_unbounded_in_all_units(unit, E, share, high, kind):
    """Resultant within the base: N / 2 times the width against the push at the top.

    The share is that of the push at which the block tips; friction is always enough.
    """
    side = share * 0.5 / high
    if abs(share - 1.0) < 0.02:
        return
    case = {"side": side, "friction": 4.0, "unit": unit, "E": E, "kind": kind}
    case |= {"lengths": (1.0, high), "cells": (3, 4)}
    if share > 1.0:
        with pytest.raises(Unbounded, match="not held: a rotation"):
            solved(**case)
    else:
        result = solved(**case)
        force = 1e-4 * E * unit
        assert result.resultant == pytest.approx([-side * force, force], rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_history_of_a_free_block(method):
    body = block(cells=(6, 3))
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.01, friction=0.5), method=method)
    stepper.load("top", (0.0, -1e-5), lambda t: 1 - 0.8 * np.cos(5 * t))
    stepper.load("top", (2e-6, 0.0), lambda t: np.sin(7 * t) * (1 - 0.8 * np.cos(5 * t)))
    for t, result in zip((0.3, 0.9, 1.6), stepper.run([0.3, 0.9, 1.6]), strict=True):
        N = 1e-5 * (1 - 0.8 * np.cos(5 * t))
        assert result.resultant == pytest.approx([-0.2 * N * np.sin(7 * t), N], rel=1e-7)
