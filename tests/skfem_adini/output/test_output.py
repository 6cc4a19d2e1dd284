"""VTK output holds the fields exactly and survives the file."""

import sys
import xml.etree.ElementTree as ElementTree

import meshio
import numpy as np
import pytest
import pyvista as pv
from full_disk import errors_without_space
from skfem import (
    Basis,
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementQuadS2,
    ElementTetP1,
    ElementTetP2,
    ElementTriArgyris,
    ElementTriP0,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
    FacetBasis,
    MeshHex,
    MeshQuad,
    MeshTet,
    MeshTri,
)

from skfem_adini import (
    ElementQuadAdini,
    InputError,
    MissingDependency,
    nodal_gradient,
    nodal_stress,
    save,
    to_pyvista,
)


def rectangles():
    x = np.array([0, 0.3, 0.55, 1.0])
    return MeshQuad.init_tensor(x, x)


def random_points(dim, count=200):
    return np.random.default_rng(0).uniform(0.02, 0.98, (dim, count))


def sample(grid, points, name="u"):
    """Evaluate the VTK field; the tolerance keeps VTK inside the cell that holds the point."""
    padded = np.zeros((points.shape[1], 3))
    padded[:, : len(points)] = points.T
    result = pv.PolyData(padded).sample(grid, tolerance=1e-12)
    assert result["vtkValidPointMask"].all()
    return result[name]


@pytest.mark.parametrize("vector", [False, True], ids=["scalar", "vector"])
def test_adini_cells_are_exact(vector):
    element = ElementVector(ElementQuadAdini()) if vector else ElementQuadAdini()
    basis = Basis(rectangles(), element)
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    grid = to_pyvista(basis, x)
    assert set(grid.celltypes) == {70}
    assert (grid.n_cells, grid.n_points) == (9, 100)
    points = random_points(2)
    expected = basis.interpolator(x)(points)
    values = sample(grid, points)
    if vector:
        assert values.shape == (200, 3)
        assert not values[:, 2].any()
        values = values[:, :2].T
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12)


def test_nodes_of_adini_cells_on_any_mesh(any_quads):
    """On every cell, the 16 values are those of the element at the 16 points."""
    basis = Basis(any_quads, ElementQuadAdini())
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    grid = to_pyvista(basis, x)
    for c in range(any_quads.nelements):
        nodes = grid.get_cell(c).point_ids
        local = basis.mapping.invF(grid.points[nodes, :2].T[:, None, :], tind=np.array([c]))
        np.testing.assert_allclose(local * 3, np.rint(local * 3), atol=1e-10)
        values = sum(
            x[basis.element_dofs[i, c]]
            * np.array(ElementQuadAdini().gbasis(basis.mapping, local, i, np.array([c]))[0])
            for i in range(12)
        )
        np.testing.assert_allclose(grid["u"][nodes], values[0], rtol=0, atol=1e-12)


SAME_CELL = {
    5: (MeshTri, ElementTriP1()),
    22: (MeshTri, ElementVector(ElementTriP2())),
    9: (MeshQuad, ElementQuad1()),
    28: (MeshQuad, ElementVector(ElementQuad2())),
    10: (MeshTet, ElementVector(ElementTetP1())),
    24: (MeshTet, ElementTetP2()),
    12: (MeshHex, ElementVector(ElementHex1())),
    29: (MeshHex, ElementHex2()),
}


@pytest.mark.parametrize("vtk_type", SAME_CELL)
def test_other_elements_as_their_own_cells(vtk_type):
    make, element = SAME_CELL[vtk_type]
    basis = Basis(make().refined(1), element)
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    grid = to_pyvista(basis, x)
    assert set(grid.celltypes) == {vtk_type}
    nodes = Basis(basis.mesh, getattr(element, "elem", element)).N
    assert grid.n_points == nodes
    points = random_points(basis.mesh.dim(), 60)
    expected = basis.interpolator(x)(points)
    values = sample(grid, points)
    if expected.ndim == 2:
        values = values[:, : len(expected)].T
    # VTK inverts the map of quadratic tetrahedra to about 1e-5 only.
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-3 if vtk_type == 24 else 1e-12)


def test_serendipity_lies_in_the_nine_node_cell():
    basis = Basis(rectangles(), ElementQuadS2())
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    points = random_points(2)
    values = sample(to_pyvista(basis, x), points)
    np.testing.assert_allclose(values, basis.interpolator(x)(points), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "element", "linear_type"),
    [
        (rectangles(), ElementQuadAdini(), 9),
        (MeshTri().refined(1), ElementTriP2(), 5),
        (MeshTet(), ElementTetP2(), 10),
        (MeshHex(), ElementHex2(), 12),
    ],
    ids=["quad", "tri", "tet", "hex"],
)
def test_linear_sub_cells_are_positive_and_nodally_exact(mesh, element, linear_type):
    basis = Basis(mesh, element)
    x = basis.project(lambda p: p[0] ** 2 - p[1])
    grid = to_pyvista(basis, x, subdivide=4)
    assert set(grid.celltypes) == {linear_type}
    assert grid.n_cells == mesh.nelements * 4 ** mesh.dim()
    np.testing.assert_allclose(grid["u"], grid.points[:, 0] ** 2 - grid.points[:, 1], atol=1e-12)
    sizes = grid.compute_cell_sizes()["Volume" if mesh.dim() == 3 else "Area"]
    assert sizes.min() > 0
    assert sizes.sum() == pytest.approx(1.0)


def test_discontinuous_and_unknown_elements_share_no_points():
    for element in (ElementTriP0(), ElementTriArgyris()):
        basis = Basis(MeshTri().refined(1), element)
        grid = to_pyvista(basis, basis.project(lambda p: 1 + 0 * p[0]))
        assert set(grid.celltypes) == {5}
        assert grid.n_points == basis.mesh.nelements * 15
        np.testing.assert_allclose(grid["u"], 1, atol=1e-9)


def test_clockwise_cells_come_out_anticlockwise():
    x = np.linspace(0, 1, 3)
    basis = Basis(MeshQuad.init_tensor(x, x), ElementQuad1())
    grid = to_pyvista(basis, basis.zeros())
    normals = grid.extract_surface(algorithm="dataset_surface").compute_normals(
        consistent_normals=False, auto_orient_normals=False
    )
    np.testing.assert_allclose(normals.cell_data["Normals"][:, 2], 1)


def test_point_and_cell_data():
    mesh = rectangles()
    basis = Basis(mesh, ElementQuadAdini())
    grid = to_pyvista(
        basis,
        {"a": basis.zeros(), "b": basis.ones()},
        point_data={"p": mesh.p, "q": mesh.p[0]},
        cell_data={"c": np.arange(9.0), "v": np.arange(18).reshape(2, 9)},
    )
    assert set(grid.point_data.keys()) == {"a", "b", "p", "q"}
    np.testing.assert_allclose(grid["p"], grid.points, atol=1e-15)
    np.testing.assert_allclose(grid["q"], grid.points[:, 0], atol=1e-15)
    np.testing.assert_array_equal(grid.cell_data["c"], np.arange(9))
    assert grid.cell_data["v"].shape == (9, 3)
    fine = to_pyvista(basis, basis.zeros(), subdivide=2, cell_data={"c": np.arange(9)})
    np.testing.assert_array_equal(fine.cell_data["c"], np.repeat(np.arange(9), 4))


def test_part_of_the_mesh():
    mesh = rectangles()
    full = Basis(mesh, ElementQuadAdini())
    part = full.with_elements(np.array([2, 7]))
    x = full.project(lambda p: p[0] * p[1])
    grid = to_pyvista(part, x, cell_data={"c": np.arange(9)})
    assert grid.n_cells == 2
    np.testing.assert_allclose(grid["u"], grid.points[:, 0] * grid.points[:, 1], atol=1e-12)
    np.testing.assert_array_equal(grid.cell_data["c"], [2, 7])


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_round_trip_through_a_file(tmp_path, suffix):
    basis = Basis(rectangles(), ElementQuadAdini())
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    path = save(tmp_path / "new" / f"field{suffix}", basis, {"u": x})
    points = random_points(2)
    values = sample(pv.read(path), points)
    np.testing.assert_allclose(values, basis.interpolator(x)(points), rtol=0, atol=1e-12)


def test_meshio_reads_the_file(tmp_path):
    basis = Basis(rectangles(), ElementQuadAdini())
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    grid = to_pyvista(basis, x)
    mesh = meshio.read(save(tmp_path / "field.vtu", basis, x))
    assert mesh.cells[0].type == "VTK_LAGRANGE_QUADRILATERAL"
    assert mesh.cells[0].data.shape == (9, 16)
    np.testing.assert_array_equal(mesh.point_data["u"], grid["u"])


def test_series(tmp_path):
    basis = Basis(rectangles(), ElementQuadAdini())
    steps = [(0.0, {"u": basis.zeros()}), (0.1, {"u": basis.ones()})]
    path = save(tmp_path / "run.pvd", basis, steps, subdivide=1)
    entries = ElementTree.parse(path).getroot().findall("Collection/DataSet")
    assert [entry.get("file") for entry in entries] == ["run_0000.vtu", "run_0001.vtu"]
    reader = pv.get_reader(path)
    assert reader.time_values == [0.0, 0.1]
    reader.set_active_time_value(0.1)
    assert reader.read()[0]["u"].max() == pytest.approx(
        to_pyvista(basis, basis.ones(), subdivide=1)["u"].max()
    )


def test_series_with_stresses_of_each_step(tmp_path):
    """A strip stretched step by step; pyvista finds the times, fields and stresses."""
    basis = Basis(rectangles(), ElementVector(ElementQuadAdini()))
    x = basis.project(lambda p: np.array([p[0], 0 * p[0]]))
    times = [0.0, 0.1, 0.25]
    steps = [
        (t, {"u": t * x}, {"stress": nodal_stress(basis, t * x, E=1.0, nu=0.0)}) for t in times
    ]
    path = save(tmp_path / "run.pvd", basis, steps, point_data={"E": np.ones(16)})
    reader = pv.get_reader(path)
    assert reader.time_values == times
    for t in times:
        reader.set_active_time_value(t)
        grid = reader.read()[0]
        expected = np.zeros(9)
        expected[0] = t
        assert grid["stress"].shape == (grid.n_points, 9)
        np.testing.assert_allclose(grid["stress"] - expected, 0, atol=1e-12)
        np.testing.assert_allclose(grid["u"][:, 0], t * grid.points[:, 0], atol=1e-12)
        np.testing.assert_allclose(grid["E"], 1)


def test_gradients_beside_the_field(tmp_path):
    """Vectors come with three components, gradients of vector fields row by row with nine."""
    basis = Basis(rectangles(), ElementVector(ElementQuadAdini()))
    x = basis.project(lambda p: np.array([p[0] + 2 * p[1], 3 * p[0] + 4 * p[1]]))
    gradient = nodal_gradient(basis, x)
    data = {"gradient": gradient, "first": gradient[0]}
    grid = pv.read(save(tmp_path / "field.vtu", basis, x, point_data=data))
    row = [1.0, 2, 0, 3, 4, 0, 0, 0, 0]
    np.testing.assert_allclose(grid["gradient"], np.tile(row, (grid.n_points, 1)), atol=1e-10)
    np.testing.assert_allclose(grid["first"], np.tile(row[:3], (grid.n_points, 1)), atol=1e-10)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_round_trip_through_meshio(tmp_path, suffix):
    """What meshio reads and writes again is the same exact field for pyvista."""
    basis = Basis(rectangles(), ElementQuadAdini())
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    gradient = nodal_gradient(basis, x)
    first = save(tmp_path / f"first{suffix}", basis, x, point_data={"gradient": gradient})
    second = tmp_path / f"second{suffix}"
    meshio.read(first).write(second)
    grid, points = pv.read(second), random_points(2)
    assert set(grid.celltypes) == {70}
    np.testing.assert_allclose(
        sample(grid, points), basis.interpolator(x)(points), rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(grid["gradient"], pv.read(first)["gradient"])


@pytest.mark.parametrize(
    "steps",
    [[(0.0,)], [(np.nan, np.zeros(1))], [(0.0, {}, {}, {})]],
    ids=["no fields", "no time", "too much"],
)
def test_bad_series(tmp_path, steps):
    with pytest.raises(InputError, match=r"fields: a \.pvd series"):
        save(tmp_path / "run.pvd", Basis(rectangles(), ElementQuadAdini()), steps)


def test_without_pyvista_the_install_line_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    basis = Basis(rectangles(), ElementQuadAdini())
    with pytest.raises(MissingDependency, match="pip install"):
        to_pyvista(basis, basis.zeros())


def test_facet_bases_are_refused():
    basis = FacetBasis(rectangles(), ElementQuadAdini())
    with pytest.raises(InputError, match="cell basis"):
        to_pyvista(basis, basis.zeros())


WITHOUT_SPACE = """
    import sys
    from pathlib import Path
    import numpy as np
    import pyvista
    from skfem import Basis, ElementQuad1, MeshQuad
    from skfem_adini import save

    folder = Path(sys.argv[1])
    basis = Basis(MeshQuad().refined(5), ElementQuad1())
    x = np.random.default_rng(0).random(basis.N)
    calls = [
        lambda: save(folder / "field.vtu", basis, x),
        lambda: save(folder / "field.vtk", basis, x),
        lambda: save(folder / "run.pvd", basis, [(0.0, x), (1.0, x)]),
    ]
"""


def test_no_space_left(tmp_path):
    """An OSError, where VTK's own writers end the process; the file of before stays."""
    basis = Basis(MeshQuad(), ElementQuad1())
    before = save(tmp_path / "field.vtu", basis, basis.ones()).read_bytes()
    errors = errors_without_space(WITHOUT_SPACE, tmp_path, 4000)
    assert len(errors) == 3
    assert all("too large" in error for error in errors)
    assert [path.name for path in tmp_path.iterdir()] == ["field.vtu"]
    assert (tmp_path / "field.vtu").read_bytes() == before
