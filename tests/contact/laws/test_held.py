"""Bodies held by contact and friction alone: loads that these can balance, and no others.

In all units, above gaps, by every method.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import ElementHex1, MeshQuad, MeshTri

from contact import ContactProblem, ElasticBody, LoadStepper, Unbounded
from skfem_adini import ElementQuadAdini

TICKS = np.linspace(0, 1, 5)
F = 0.3
METHODS = ("newton", "pdas", "tresca_loop")
LOOPS = {"coulomb": ("tresca_loop", "fixed_point", "qp:osqp"), "tresca": ()}
CELLS = {"P1": MeshTri, "Q1": MeshQuad}


def square(force):
    mesh = MeshQuad.init_tensor(TICKS, TICKS).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=2.0, nu=0.3)
    return body.body_force(force)


# Weight 1 presses on the foundation; it slides when the horizontal force exceeds F.
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("pull", [-0.29, 0.1, 0.29, -0.31, 0.31, 2.0])
def test_friction_holds_what_it_can(pull, law) -> None:
    problem = ContactProblem(square((pull, -1.0)), "bottom", 0.03, F, law=law)
    if abs(pull) < F:
        np.testing.assert_allclose(problem.solve().resultant, [-pull, 1.0], atol=1e-9)
        return
    for method in ("newton", "pdas", *LOOPS[law]):
        with pytest.raises(Unbounded, match="not held"):
            problem.solve(method, max_iterations=50)


def test_round_cone_in_three_dimensions(make) -> None:
    """|(.2, .2)| = .283 < F < .311 = |(.22, .22)|: neither a square nor an octagon."""

    def problem(*force):
        mesh = make.box(ElementHex1, TICKS, TICKS, TICKS)
        body = ElasticBody.from_mesh(mesh, ElementHex1(), E=2.0, nu=0.3).body_force(force)
        return ContactProblem(body, "bottom", 0.01, F)

    result = problem(0.2, 0.2, -1.0).solve()
    np.testing.assert_allclose(result.resultant, [-0.2, -0.2, 1.0], atol=1e-9)
    with pytest.raises(Unbounded, match="translation"):
        problem(0.22, 0.22, -1.0).solve()
    with pytest.raises(Unbounded, match="translation along z") as caught:
        problem(0.0, 0.0, 1.0).solve()
    lifted = caught.value.mode.reshape(-1, 3)
    np.testing.assert_allclose(lifted, np.tile([0, 0, 1.0], (len(lifted), 1)), atol=1e-9)


def test_gaps_given_point_by_point_stay_in_order() -> None:
    body = square((0.0, -1.0)).fix("top", "xy")
    gaps = np.linspace(0.01, 0.1, ContactProblem(body, "bottom", 0.1).rows.gap.size)
    problem = ContactProblem(body, "bottom", gaps)
    np.testing.assert_array_equal(problem.rows.gap, gaps)
    assert np.all(np.diff(problem.rows.x[0]) > 0)


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
@pytest.mark.parametrize(
    ("side", "load", "given"),
    [
        # The springs of the start bear light loads short of the obstacle, without friction.
        *((0.2, load, {"gap": gap}) for load in (1e-3, 1e-5, 1e-6) for gap in (0.0, 0.02, below)),
        # On flat ground the sum of the pressure is the load: up to F times it friction holds.
        *((0.29, 1e-4, {"kind": kind, "lengths": (1.0, 0.3)}) for kind in CELLS),
        *((0.08, 1e-4, {"friction": 0.1, "compliance": k}) for k in (1e-2, 1.0, 100.0)),
    ],
)
def test_light_loads(method, side, load, given):
    result = solved(side=side, load=load, method=method, **given)
    assert result.resultant == pytest.approx([-side * load, load], rel=1e-8)
    assert max(result.kkt.values()) < 1e-10


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([1e-6, 1e-3, 1.0, 1e4]),
    st.sampled_from([1e-9, 1e-6, 1.0, 1e5, 2e11]),
    st.floats(0.05, 1.5).filter(lambda share: abs(share - 1.0) >= 0.02),
    st.floats(0.3, 3.0),
    st.sampled_from(["P1", "Q1"]),
)
def test_what_tips_over_is_unbounded_in_all_units(unit, E, share, high, kind):
    """Resultant within the base: N / 2 times the width against the push at the top.

    The share is that of the push at which the block tips; friction is always enough.
    """
    side = share * 0.5 / high
    case = {"side": side, "friction": 4.0, "unit": unit, "E": E, "kind": kind}
    case |= {"lengths": (1.0, high), "cells": (3, 4)}
    if share > 1.0:
        with pytest.raises(Unbounded, match="not held: a rotation"):
            solved(**case)
    else:
        force = 1e-4 * E * unit
        assert solved(**case).resultant == pytest.approx([-side * force, force], rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_history_of_a_free_block(method):
    body = block(cells=(6, 3))
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.01, friction=0.5), method=method)
    stepper.load("top", (0.0, -1e-5), lambda t: 1 - 0.8 * np.cos(5 * t))
    stepper.load("top", (2e-6, 0.0), lambda t: np.sin(7 * t) * (1 - 0.8 * np.cos(5 * t)))
    for t, result in zip((0.3, 0.9, 1.6), stepper.run([0.3, 0.9, 1.6]), strict=True):
        N = 1e-5 * (1 - 0.8 * np.cos(5 * t))
        assert result.resultant == pytest.approx([-0.2 * N * np.sin(7 * t), N], rel=1e-7)
