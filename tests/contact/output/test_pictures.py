"""Pictures of cut and of several bodies, and of whoever has the fields of `Drawn`."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from families import half_disk
from matplotlib.collections import LineCollection, PolyCollection
from pressed_pairs import pair, stack
from skfem import ElementHex1, ElementHex2, ElementTetP1, MeshHex, MeshQuad, MeshTri2

from contact import ContactProblem, ElasticBody, InputError, LayeredBlock, Pair, Plane
from contact.output.pictures import deformed_cells, on_deformed
from contact.plot import draw_edges, face_pressure, plot_cells, plot_field, plot_pressure
from skfem_adini import ElementHexAdini


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def result():
    return pair().solve()


def test_one_scale_of_colours(result):
    """The scale spans both bodies, each value has one colour, and there is one bar."""
    ax = plot_field(result, 1)
    fields = [part for part in ax.collections if part.get_array() is not None]
    assert len(fields) == 2
    values = np.concatenate([part.get_array() for part in fields])
    for part in fields:
        assert part.get_clim() == (values.min(), values.max())
    assert len(ax.figure.axes) == 2
    ends = result["upper"].sample(result["upper"].body.mesh.p)[1]
    assert values.min() <= ends.min() + 1e-12
    ax = plot_cells(result)
    cells = [part for part in ax.collections if isinstance(part, PolyCollection)]
    assert [part.get_array().size for part in cells] == [10, 18]
    assert cells[0].get_clim() == cells[1].get_clim()
    assert len(ax.figure.axes) == 2


@pytest.mark.parametrize("name", ["upper", "lower"])
def test_one_body_alone(result, name):
    """Drawn in its own scale, and nothing of the other."""
    own = result[name]
    fields = [part for part in plot_field(own, 0).collections if part.get_array() is not None]
    assert len(fields) == 1
    (cells,) = (p for p in plot_cells(own).collections if isinstance(p, PolyCollection))
    assert cells.get_array().size == own.body.mesh.nelements
    assert cells.get_clim() == (cells.get_array().min(), cells.get_array().max())
    (edges,) = draw_edges(own, plt.figure().add_subplot(), outline=True).collections
    assert len(edges.get_segments()) == own.body.mesh.boundary_facets().size
    (edges,) = draw_edges(result, plt.figure().add_subplot()).collections
    assert len(edges.get_segments()) == sum(body.mesh.nfacets for body in result.solid.bodies)


def test_plot_of_two_bodies(result):
    """The pressure once above, and the bodies below in a window around the contact points."""
    ax = result.plot()
    above, below = ax.figure.axes
    assert ax is above
    drawn = [line for line in above.lines if len(line.get_xdata()) == result.mu.size]
    assert any(np.array_equal(line.get_ydata(), result.pressure) for line in drawn)
    names = [text.get_text() for text in below.get_legend().get_texts()]
    assert names[:2] == ["upper", "lower"]
    assert len([p for p in below.collections if isinstance(p, LineCollection)]) == 4
    x = on_deformed(result)
    low, high = np.array([below.get_xlim(), below.get_ylim()]).T
    assert np.all((x > low[:, None]) & (x < high[:, None]))
    assert low[1] > -0.9
    assert high[1] < 0.9
    _, own = plt.subplots()
    assert result.plot(own) is own
    assert len(own.figure.axes) == 1
    block = LayeredBlock(1.0, [(0.5, 4, 1.0, 0.3)], sides="x").fix("top", "y", -0.02)
    below = MeshQuad().refined(2).translated((0.0, -1.0)).with_defaults()
    lower = ElasticBody.from_mesh(below, E=1.0, nu=0.3).fix("bottom", "xy")
    ax = ContactProblem(block, "bottom", lower.surface("top"), friction=0.3).solve().plot()
    assert ax.figure.axes == [ax]


def test_drawn_points_lie_on_both_bodies(result):
    """In contact the deformed place of a point is on the lower body's deformed boundary too."""
    x, top = on_deformed(result), result["lower"]
    surface = np.array([np.linspace(-0.99, 0.99, 400), np.zeros(400)])
    moved = surface + top.sample(surface)
    height = np.interp(x[0], *moved)
    inner = np.abs(x[0]) < 0.4
    # Equal as means over some of a cell, which is .2 wide; the displacement is .03.
    assert np.abs(height - x[1])[inner].max() < 1e-3


def test_parts_are_named():
    ax = stack().solve().plot()
    words = [text.get_text() for text in ax.texts]
    assert words == ["contact 0", "tie 1", "contact 2"]
    names = [text.get_text() for text in ax.figure.axes[1].get_legend().get_texts()]
    assert names[:3] == ["top block", "body 1", "low/block"]
    assert "bonded" in names


def cubes():
    """Two cubes side by side, each on its own foundation, one pressed twice as far."""
    mesh = MeshHex().refined(1).with_defaults()
    bodies = []
    for k in range(2):
        moved = mesh.translated((2.0 * k, 0.0, 0.0)).with_defaults()
        body = ElasticBody.from_mesh(moved, ElementHex1(), E=1.0, nu=0.3)
        bodies.append(body.fix("top", "xyz"))
    left, right = bodies
    pairs = [Pair(left, "bottom", -0.01), Pair(right, "bottom", -0.02)]
    return left, right, ContactProblem([left.named("left"), right], pairs).solve()


def test_pressures_in_space():
    """Faces of both bodies, in one scale; the second is pressed twice as hard."""
    left, right, result = cubes()
    ax = plot_pressure(result)
    first, second = ax.collections
    assert first.get_clim() == second.get_clim()
    np.testing.assert_allclose(second.get_array(), 2 * first.get_array(), rtol=1e-9)
    assert ax.get_xlim()[0] < 0 < 3 < ax.get_xlim()[1]
    with pytest.raises(InputError, match=r"body: .* say which one"):
        face_pressure(result)
    for body in (left, "left", 0):
        facets, pressure = face_pressure(result, body)
        assert np.array_equal(np.sort(facets), np.sort(left.facets("bottom")))
        assert np.all(pressure > 0)
    np.testing.assert_allclose(face_pressure(result, right)[1], 2 * pressure, rtol=1e-9)


@pytest.mark.parametrize("element", [ElementHex2, ElementTetP1, ElementHexAdini])
def test_pressure_on_faces(element, make):
    """All of the bottom and nothing else; a uniform pressure is uniform."""
    ticks = np.linspace(0, 1, 4)
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks, ticks), element(), E=1.0, nu=0.0)
    body.fix("left", "x").fix("front", "y").load("top", (0, 0, -0.1))
    result = ContactProblem(body, "bottom", 0.0).solve()
    facets, pressure = face_pressure(result)
    assert np.array_equal(np.sort(facets), np.sort(body.facets("bottom")))
    np.testing.assert_allclose(pressure, 0.1, rtol=1e-9)
    assert result.plot().name == "3d"
    with pytest.raises(InputError, match="projection"):
        result.plot(plt.figure().add_subplot())
    for ax in (3, "ax", [], object()):
        with pytest.raises(InputError, match="ax: "):
            result.plot(ax)


@pytest.fixture(scope="module")
def cut():
    disk = half_disk().fix("top", "x").fix("top", "y", -0.05)
    return ContactProblem(disk, disk.arc(), Plane((0.0, -1.02), (0.0, 1.0)), 0.3).solve()


def test_cells(cut):
    """Clipped cells have three or four corners; a bare ValueError of NumPy was raised."""
    ax = plot_cells(cut, magnification=0.0)
    (cells,) = (part for part in ax.collections if isinstance(part, PolyCollection))
    outlines = [path.vertices[:-1] for path in cells.get_paths()]
    assert {len(corners) for corners in outlines} == {3, 4}
    assert cells.get_array().size == len(outlines)
    x = np.vstack(outlines)
    assert np.hypot(*x.T).max() <= 1 + 1e-2  # the level set is linear within a sub-cell
    x, y = zip(*(corners.T for corners in outlines), strict=True)
    area = sum(
        abs(np.sum(a * np.roll(b, -1) - b * np.roll(a, -1))) / 2 for a, b in zip(x, y, strict=True)
    )
    assert area == pytest.approx(np.pi / 2, rel=2e-3)


@pytest.mark.parametrize("nodal", [False, True])
def test_fields(cut, nodal):
    """What the extension gives outside is no displacement of the body, and was drawn."""
    ax = plot_field(cut, 1, magnification=0.0, nodal=nodal)
    drawn = ax.collections[0]
    triangulation = drawn._triangulation
    x = np.stack((triangulation.x, triangulation.y))[:, np.unique(triangulation.triangles)]
    assert np.hypot(*x).max() <= 1 + 1e-2


def test_round_boundaries_are_drawn_round():
    """A hole of curved cells was a polygon."""
    mesh = MeshTri2.init_circle(1)
    sides = {"low": lambda x: x[1] < -0.5, "high": lambda x: x[1] > 0.5}
    body = ElasticBody.from_mesh(mesh.with_boundaries(sides), E=1.0, nu=0.3).fix("high")
    result = ContactProblem(body, "low", 0.0).solve()
    outlines, _ = deformed_cells(result, 0.0)
    radius = np.array([np.linalg.norm(outline, axis=1) for outline in outlines])
    outer = radius[np.sum(radius > 0.99, axis=1) >= 5]  # both ends of an edge, and what is between
    assert len(outer) == len(mesh.boundary_facets())
