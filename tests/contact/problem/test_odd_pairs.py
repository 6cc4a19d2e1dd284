"""Pairs, ties and bodies that do not fit: refused, with the argument and the bodies named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pressed_pairs import stack
from skfem import ElementQuad1
from two_blocks import facing

from contact import (
    ContactError,
    ContactProblem,
    ContactWarning,
    InputError,
    LayeredBlock,
    NotConverged,
    Pair,
    Tie,
)
from skfem_adini import ElementQuadAdini


def two(**more):
    upper, lower = facing(ElementQuad1, 4, 6, **more)
    lower.fix("bottom", "xy")
    upper.fix("left", "x").load("top", (0.0, -0.05))
    return upper.named("upper"), lower.named("lower")


@pytest.mark.parametrize("kind", [Pair, Tie])
@pytest.mark.parametrize(
    ("sides", "said"),
    [
        (("top", "bottom"), "no facet lies opposite"),
        (("left", "right"), "no facet lies opposite"),
        (("top", "top"), "the normals of the two boundaries point the same way"),
    ],
)
def test_sides_that_do_not_face_each_other(kind, sides, said):
    upper, lower = two()
    pair = kind(upper, sides[0], lower, sides[1])
    with pytest.raises(InputError, match=rf"^opposite: {said}.*of 'upper' and 'lower'\)$"):
        ContactProblem([upper, lower], [pair])


@pytest.mark.parametrize("place", [{"gap": 10.0}, {"shift": 1.0}, {"shift": 5.0}, {"gap": -1.5}])
@pytest.mark.parametrize("kind", [Pair, Tie])
def test_bodies_that_are_far_apart_or_in_each_other(kind, place):
    upper, lower = two(**place)
    with pytest.raises(InputError, match=r"^opposite: no facet lies opposite"):
        ContactProblem([upper, lower], [kind(upper, "bottom", lower, "top")])


def test_an_unknown_boundary_is_said_to_be_that_of_which_body():
    upper, lower = two()
    with pytest.raises(InputError, match=r"^other of 'lower': boundary 'tpo' is unknown"):
        Pair(upper, "bottom", lower, "tpo")
    with pytest.raises(InputError, match=r"^boundary 'botom'.*the Pair of 'upper' and 'lower'"):
        ContactProblem([upper, lower], [Pair(upper, "botom", lower, "top")])


def test_one_boundary_on_both_sides():
    upper, _ = two()
    with pytest.raises(InputError, match=r"^boundary: facet 1 of 'upper' .*to both sides of one$"):
        ContactProblem([upper], [Pair(upper, "bottom", upper, "bottom")])


def test_plane_stress_on_plane_strain_is_warned_of():
    upper, _ = two(plane="stress")
    _, lower = two()
    pair = Pair(upper, "bottom", lower, "top")
    with pytest.warns(ContactWarning, match=r"^bodies: 'upper' in plane stress, 'lower' in plane"):
        result = ContactProblem([upper, lower], [pair]).solve()
    assert abs(result.resultant[1] - 0.05) < 1e-12
    with pytest.warns(ContactWarning, match=r"^bodies: 'upper' in plane stress"):
        ContactProblem(upper, "bottom", lower.surface("top"))


@pytest.mark.parametrize("name", ["periodic", "tie", "constrain"])
def test_layers_take_no_equations(name):
    block = LayeredBlock(1.0, [(0.5, 8, 1.0, 0.3)], sides="x")
    with pytest.raises(InputError, match=rf"^{name}: a LayeredBlock takes no equations"):
        getattr(block, name)("top")


def test_a_whole_number_of_numpy_chooses_a_body():
    result = stack().solve()
    assert np.array_equal(result[np.int64(1)].u, result[1].u)
    with pytest.raises(InputError, match=r"^body: True is not one of 'top block', body 1"):
        result[True]


def test_interfaces_are_shown_in_one_line():
    problem = stack()
    assert repr(problem.boundaries) == f"Interfaces(3 pairs, {problem.rows.gap.size} points)"


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuadAdini], ids=lambda e: e.__name__)
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_a_stiff_body_that_contact_holds_is_refused_with_the_reason(element, size):
    """It moves as a rigid one, and its reactions drown in the rounding of its displacements."""
    stiff, _ = facing(element, 4, 6, E=1e10, size=size)
    _, lower = facing(element, 4, 6, E=1.0, size=size)
    lower.fix("bottom", "xy")
    stiff.fix("left", "x").load("top", (0.0, -0.01))
    pair = Pair(stiff, "bottom", lower, "top", friction=0.3)
    with pytest.raises(NotConverged, match=r"stiffest body is \de\+(09|10) times as stiff"):
        ContactProblem([stiff, lower], [pair]).solve()


@pytest.mark.turns(3)
@settings(max_examples=40, deadline=None)
@given(
    ratio=st.sampled_from([1e-8, 1e-4, 1.0, 1e4, 1e8]),
    kind=st.sampled_from([Pair, Tie]),
    shift=st.floats(-1.2, 1.2),
    gap=st.one_of(st.sampled_from([0.0, 1e-12, -1e-12]), st.floats(-0.6, 3.0)),
    friction=st.floats(0.0, 1.5),
    push=st.floats(-0.1, 0.1),
)
@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
def test_certified_or_refused(ratio, kind, shift, gap, friction, push):
    """Stiffness ratios, places and pushes of any kind: balanced forces, or a typed error."""
    upper, lower = facing(ElementQuad1, 3, 5, shift=shift, gap=gap)
    stiff, _ = facing(ElementQuad1, 3, 5, shift=shift, gap=gap, E=ratio)
    lower.fix("bottom", "xy")
    stiff.fix("top", "x", 0.01).fix("top", "y", -push)
    more = {} if kind is Tie else {"friction": friction}
    try:
        problem = ContactProblem([stiff, lower], [kind(stiff, "bottom", lower, "top", **more)])
        result = problem.solve()
    except ContactError:
        return
    assert max(result.kkt.values()) <= 1e-10
    forces = np.array([own.resultant + own.tie_resultant for own in (result[0], result[1])])
    if kind is Tie:
        assert np.abs(forces).max() > 0
    assert np.abs(forces.sum(axis=0)).max() <= 1e-9 * max(np.abs(forces).max(), 1e-300)
    assert upper.f.size == stiff.f.size
