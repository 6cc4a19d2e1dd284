"""Loads at the limit of friction, displacements beyond the body, and slip that is rounding."""

from dataclasses import replace

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementTriP2

from contact import ContactProblem, ElasticBody, InputError, Status, Unbounded
from skfem_adini import ElementQuadAdini

ELEMENTS = [ElementQuad1, ElementTriP2, ElementQuadAdini, ElementHex1]


def pushed(make, element, push, friction=0.5, length=1.0, E=2.0, law="coulomb"):
    """A block on a rough floor under its weight and a body force sideways."""
    dim = 3 if element is ElementHex1 else 2
    ticks = np.linspace(0, length, 5 if dim == 2 else 4)
    body = ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=E, nu=0.3)
    down, aside = np.eye(dim)[-1], np.eye(dim)[0]
    body.body_force(0.1 * E / length * (push * aside - down))
    bound = friction if law == "coulomb" else 0.1 * E * friction
    return ContactProblem(body, "bottom", 0.0, bound, law)


@pytest.mark.parametrize(("length", "E"), [(1.0, 2.0), (1e-3, 2e11)])
@pytest.mark.parametrize("element", ELEMENTS)
def test_load_at_the_friction_limit(element, length, E, make):
    with pytest.raises(Unbounded, match=r"slip is undetermined.*a translation along"):
        pushed(make, element, 0.5, length=length, E=E).solve()
    below = pushed(make, element, 0.49, length=length, E=E).solve()
    assert element is ElementHex1 or Status.STICK in below.status
    assert below.system.body.reach(below.u) < length
    with pytest.raises(Unbounded, match="not held"):
        pushed(make, element, 0.51, length=length, E=E).solve()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("element", [ElementQuad1, ElementHex1])
def test_loads_beside_the_friction_limit(element, law, make):
    """Solved below, refused above; within 1e-6 a slip without digits may be refused as well."""
    near = 2e-6 if element is ElementQuad1 else 1e-3  # nearer, the slip exceeds the body's size
    below = pushed(make, element, 0.5 * (1 - near), law=law).solve()
    # In the plane the last point still sticks; in space friction turns, and the slip that it needs
    # to point the right way grows like the root of what is left.
    further = pushed(make, element, 0.5 * (1 - 2e-2), law=law).solve()
    reach = [one.system.body.reach(one.u) for one in (below, further)]
    assert reach[0] < (1.1 if element is ElementQuad1 else 200) * reach[1]
    for share in (1 - 1e-8, 1 - 1e-12, 1.0, 1 + 1e-12, 1 + 1e-8):
        result, refusal = None, "not held"
        try:
            result = pushed(make, element, 0.5 * share, law=law).solve()
        except Unbounded as error:
            refusal = str(error)
        assert "slip is undetermined" in refusal or "not held" in refusal
        if result is not None:
            assert share < 1 - 1e-9
            assert result.system.body.reach(result.u) < 1.01 * reach[0]
    for share in (1 + 2e-6, 1.01):
        with pytest.raises(Unbounded, match="not held"):
            pushed(make, element, 0.5 * share, law=law).solve()


def test_no_load_is_spoken_of_where_there_is_none(make):
    ticks = np.linspace(0, 1, 4)
    body = ElasticBody.from_mesh(make.box(ElementQuad1, ticks, ticks), E=2.0, nu=0.3)
    with pytest.raises(Unbounded, match="no load says how far") as caught:
        ContactProblem(body.load("top", (0.0, -0.1)), "bottom", 0.0).solve()
    assert "balance the loads" not in str(caught.value)


def test_displacement_beyond_the_body(make):
    """The modulus in the wrong unit: a thousand times too soft."""
    body = make.block(4, E=2e-3)
    with pytest.raises(InputError, match="times the size of the body"):
        ContactProblem(body, "bottom", lambda x: 0.0 * x[0] + 2.0, 0.4).solve()


def test_rounding_of_a_displacement_is_no_slip(make):
    """All points stick; noise of 1e-14 on the displacement changes no status."""
    _, result = make.solved(friction=0.9, n=8)
    rng = np.random.default_rng(0)
    noise = 1e-14 * result.system.body.reach(result.u) * rng.standard_normal(result.u.size)
    again = replace(result, u=result.u + noise)
    assert np.array_equal(again.status, result.status)
    at_the_bound = replace(result, t=np.sign(result.t) * result.system.bound(result.mu)[:, None])
    at_rest = replace(at_the_bound, u=noise)
    moved = replace(at_the_bound, u=np.where(np.abs(result.u) > 0, 1e-3, 0.0) + noise)
    assert Status.SLIP not in replace(at_rest, u=0 * noise).status
    assert Status.SLIP in moved.status
