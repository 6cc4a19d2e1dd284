"""Pictures measure the arc from the start of the boundary, in units of length, run by run."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTriP1,
    ElementTriP2,
    MeshTri,
    MeshTri2,
)

from contact import ContactProblem, Cylinder, ElasticBody, InputError, LayeredBlock
from contact.output.contact_runs import arc_length
from contact.plot import face_pressure
from skfem_adini import ElementHexAdini, ElementQuadAdini

mpl.use("Agg")


@pytest.fixture(autouse=True)
def closed():
    """Close the figures of each test."""
    yield
    plt.close("all")


PLANAR = [
    (ElementQuadAdini, None),
    (ElementQuadAdini, "gauss"),
    (ElementQuadAdini, "centroid"),
    (ElementTriP1, None),
    (ElementTriP2, None),
    (ElementTriP2, "gauss"),
    (ElementQuad1, None),
    (ElementQuad2, "gauss"),
]


def block(make, element, unit=1.0):
    ticks = unit * make.graded
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks), element(), E=1.0, nu=0.3)
    return body.fix("top", "xy")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("unit", [1.0, 1e-6])
@pytest.mark.parametrize(("element", "functional"), PLANAR)
def test_a_straight_side_is_its_coordinate(element, functional, unit, make):
    """Not from the first contact point, which lies inside where points of Gauss are taken."""
    body = block(make, element, unit)
    result = ContactProblem(body, "bottom", -0.01 * unit, 0.3, functional=functional).solve()
    s, run = arc_length(result)
    np.testing.assert_allclose(s, result.x[0], atol=1e-12 * unit)
    assert not run.any()
    drawn = result.plot().lines[0].get_xdata()
    np.testing.assert_array_equal(drawn, s)


def test_layers():
    block = LayeredBlock(1.0, [(1.0, 6, 1.0, 0.3)], top="xy")
    result = ContactProblem(block, "bottom", -0.01).solve()
    np.testing.assert_allclose(arc_length(result)[0], result.x[0], atol=1e-12)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "functional"), PLANAR)
def test_runs_follow_one_another(element, functional, make):
    """Two boundaries, and one boundary of two sides: each begins where the last one ended."""
    ticks = make.graded
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks), element(), E=1.0, nu=0.3)
    body.fix("top", "y")
    for place, obstacle in ((["left", "right"], -0.01), (["bottom", "right"], [-0.01, -0.01])):
        if isinstance(obstacle, list):
            body.fix("left", "x")
        result = ContactProblem(body, place, obstacle, functional=functional).solve()
        s, run = arc_length(result)
        along = [result.x[0], result.x[1]] if isinstance(obstacle, list) else [result.x[1]] * 2
        for k in (0, 1):
            at = along[k][run == k]
            same = np.abs(s[run == k] - k - at).max() < 1e-12
            assert same or np.abs(s[run == k] - k - (1 - at)).max() < 1e-12
        assert len([line for line in result.plot().lines if line.get_color() == "0.25"]) == 2


def test_corner_of_one_boundary(make):
    """Bottom and right as one boundary are one run of length two."""
    ticks = make.graded
    mesh = make.box(ElementTriP2, ticks, ticks)
    body = ElasticBody.from_mesh(mesh, ElementTriP2(), E=1.0, nu=0.3).fix("top", "y")
    result = ContactProblem(body.fix("left", "x"), ["bottom", "right"], -0.01).solve()
    s, run = arc_length(result)
    assert not run.any()
    assert np.all(np.diff(s) > 0)
    low, side = result.x_nominal[1] < 1e-9, result.x_nominal[0] > 1 - 1e-9
    np.testing.assert_allclose(s[low & ~side], result.x[0, low & ~side], atol=1e-12)
    np.testing.assert_allclose(s[side & ~low], 1 + result.x[1, side & ~low], atol=1e-12)


def test_strip_of_one_cell(make):
    """Its short sides join contact points, but are not in contact."""
    ticks = np.linspace(0, 1, 6), np.array([0.0, 0.2])
    body = ElasticBody.from_mesh(make.box(ElementQuad1, *ticks), ElementQuad1(), E=1.0, nu=0.3)
    result = ContactProblem(body.fix("left", "x"), ["bottom", "top"], -0.01, 0.1).solve()
    s, run = arc_length(result)
    assert run.max() == 1
    assert 0.8 < s[run == 0].max() <= 1 <= s[run == 1].min() < s.max() <= 2


@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("element", [ElementTriP1, ElementTriP2])
def test_closed_loop(element, curved):
    """A whole circle: places differ by the angles, from the facet of the first point on."""
    mesh = (MeshTri2 if curved else MeshTri).init_circle(3)
    rim = mesh.boundary_facets()
    body = ElasticBody.from_mesh(mesh.with_boundaries({"rim": rim}), element(), E=1.0, nu=0.3)
    result = ContactProblem(body, "rim", Cylinder((0, 0), 0.95, hollow=True), 0.2).solve()
    s, run = arc_length(result)
    assert not run.any()
    assert np.all(np.diff(s) > 0)
    angle = np.unwrap(np.arctan2(*result.x_nominal[::-1]))
    facets = mesh.boundary_facets().size
    assert s[0] < 2 * np.pi / facets
    # Facets are chords of the circle, or parabolas.
    np.testing.assert_allclose(s - s[0], np.abs(angle - angle[0]), atol=0.02)
    assert s[-1] < 2 * np.pi


@pytest.mark.parametrize("element", [ElementHex1, ElementHex2, ElementTetP1, ElementHexAdini])
def test_pressure_on_faces(element, make):
    """All of the bottom and nothing else; a uniform pressure is uniform."""
    ticks = np.linspace(0, 1, 4)
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks, ticks), element(), E=1.0, nu=0.0)
    body.fix("left", "x").fix("front", "y").load("top", (0, 0, -0.1))
    result = ContactProblem(body, "bottom", 0.0).solve()
    facets, pressure = face_pressure(result)
    assert np.array_equal(np.sort(facets), np.sort(body.facets("bottom")))
    np.testing.assert_allclose(pressure, 0.1, rtol=1e-9)
    axes = result.plot()
    assert axes.name == "3d"
    with pytest.raises(InputError, match="projection"):
        result.plot(mpl.figure.Figure().add_subplot())


def test_not_axes(make):
    result = make.solved(n=4)[1]
    for ax in (3, "ax", [], object()):
        with pytest.raises(InputError, match="ax: "):
            result.plot(ax)
