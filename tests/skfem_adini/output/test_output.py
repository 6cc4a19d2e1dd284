"""Gradients and stresses at the vertices; VTK output is exact and survives the file."""

import xml.etree.ElementTree as ElementTree

import meshio
import numpy as np
import pytest
import pyvista as pv
import skfem
from full_disk import errors_without_space
from hypothesis import given
from hypothesis import strategies as st
from skfem import Basis, ElementQuad1, ElementVector, MeshHex, MeshQuad, MeshTet, MeshTri

import skfem_adini
from skfem_adini import ElementHexAdini, ElementQuadAdini, nodal_stress, save, to_pyvista, von_mises

TICKS = np.array([0, 0.3, 0.5, 1.1])
PLANE = Basis(MeshQuad.init_tensor(TICKS, TICKS[:3]), ElementVector(ElementQuadAdini()))
SPACE = Basis(MeshHex.init_tensor(TICKS[:3], TICKS, TICKS[:2]), ElementVector(ElementHexAdini()))
numbers = st.floats(-2, 2)


def linear_field(basis, gradient, shift=0.0):
    """Return the dofs of u = gradient x + shift, without the functions under test."""
    dim = basis.mesh.dim()
    x = basis.zeros()
    dofs = basis.nodal_dofs.reshape(-1, dim, basis.mesh.nvertices)
    x[dofs[0]] = gradient @ basis.mesh.p + shift
    for j in range(dim):
        x[dofs[1 + j]] = gradient[:, j : j + 1]
    return x


@pytest.mark.parametrize(
    "element",
    [ElementQuadAdini(), skfem_adini.ElementQuadBFS(), ElementHexAdini()],
    ids=lambda element: type(element).__name__,
)
def test_gradient_of_a_cubic(element):
    mesh = SPACE.mesh if isinstance(element, ElementHexAdini) else PLANE.mesh
    basis = Basis(mesh, element)
    x = basis.project(lambda p: p[0] ** 3 * p[1] - p[1] ** 2 + p[-1])
    X, Y, last = mesh.p[0], mesh.p[1], np.eye(mesh.dim())[-1]
    expected = np.zeros((mesh.dim(), mesh.nvertices)) + last[:, None]
    expected[:2] += [3 * X**2 * Y, X**3 - 2 * Y]
    np.testing.assert_allclose(skfem_adini.nodal_gradient(basis, x), expected, atol=1e-10)


@pytest.mark.parametrize("basis", [PLANE, SPACE], ids=["plane", "space"])
@given(angle=numbers, shift=numbers, E=st.floats(0.1, 10), nu=st.floats(-0.9, 0.49))
def test_small_rotations_have_no_stress(basis, angle, shift, E, nu):
    spin = np.zeros((basis.mesh.dim(),) * 2)
    spin[0, 1], spin[1, 0] = angle, -angle
    stress = nodal_stress(basis, linear_field(basis, spin, shift), E, nu)
    np.testing.assert_array_equal(stress, 0)


@given(stretch=numbers, E=st.floats(0.1, 10), nu=st.floats(-0.9, 0.49))
def test_uniaxial_tension(stretch, E, nu):
    """With free sides only sigma_xx = E e is left; between rigid plates sigma_zz is nu of it."""
    for basis, plane in ((PLANE, "stress"), (SPACE, "strain")):
        gradient = np.diag([stretch, *[-nu * stretch] * (basis.mesh.dim() - 1)])
        stress = nodal_stress(basis, linear_field(basis, gradient), E, nu, plane=plane)
        expected = np.zeros((3, 3, 1))
        expected[0, 0] = E * stretch
        scale = E * abs(stretch) / ((1 - 2 * nu) * (1 + nu))
        np.testing.assert_allclose(stress - expected, 0, atol=1e-13 * scale + 1e-300)
    gradient = np.diag([stretch, -nu / (1 - nu) * stretch])
    stress = nodal_stress(PLANE, linear_field(PLANE, gradient), E, nu)
    expected[0, 0] = E / (1 - nu**2) * stretch
    expected[2, 2] = nu * expected[0, 0]
    np.testing.assert_allclose(stress - expected, 0, atol=1e-13 * scale + 1e-300)


def test_von_mises():
    assert von_mises(np.diag([5.0, 0, 0])) == pytest.approx(5)
    assert von_mises(np.eye(3) * 7) == pytest.approx(0)
    shear = np.zeros((3, 3, 2))
    shear[0, 2] = shear[2, 0] = [1, 2]
    np.testing.assert_allclose(von_mises(shear), np.sqrt(3) * np.array([1, 2]))
    sigma = np.random.default_rng(0).uniform(-1, 1, (3, 3))
    a, b, c = np.linalg.eigvalsh(sigma + sigma.T)
    principal = np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2)
    assert von_mises(sigma + sigma.T) == pytest.approx(principal)


def test_mean_over_materials():
    """At a vertex of the interface half the cells are stiff; elsewhere the value is one-sided."""
    middle = PLANE.mesh.p[0, PLANE.mesh.t].mean(axis=0)
    E = np.where(middle < 0.3, 1.0, 9.0)
    u = linear_field(PLANE, np.array([[0.0, 1.0], [0.0, 0.0]]))
    shear = nodal_stress(PLANE, u, E, 0.0)[0, 1]
    px = PLANE.mesh.p[0]
    np.testing.assert_allclose(shear, np.select([px < 0.3, px == 0.3], [0.5, 2.5], 4.5))


def test_law():
    """Any law of the gradient; here the first Piola-Kirchhoff stress of Saint Venant-Kirchhoff."""

    def law(gradient):
        F = gradient + np.eye(2)[..., None]
        green = 0.5 * (np.einsum("kin,kjn->ijn", F, F) - np.eye(2)[..., None])
        return np.einsum("ikn,kjn->ijn", F, 2 * green)

    x = linear_field(PLANE, np.diag([1.0, 0.0]))
    expected = np.broadcast_to(np.diag([6.0, 0.0])[..., None], (2, 2, PLANE.mesh.nvertices))
    np.testing.assert_allclose(nodal_stress(PLANE, x, law=law), expected)


# Files and grids of VTK.


def rectangles():
    x = np.array([0, 0.3, 0.55, 1.0])
    return MeshQuad.init_tensor(x, x)


def random_field(mesh, element, intorder=None):
    basis = Basis(mesh, element, intorder=intorder)
    return basis, np.random.default_rng(1).uniform(-1, 1, basis.N)


def sample(grid, points, name="u"):
    """Evaluate the VTK field; the tolerance keeps VTK inside the cell that holds the point."""
    padded = np.zeros((points.shape[1], 3))
    padded[:, : len(points)] = points.T
    result = pv.PolyData(padded).sample(grid, tolerance=1e-12)
    assert result["vtkValidPointMask"].all()
    return result[name]


def is_exact(grid, basis, x, atol=1e-12):
    """Whether the VTK field is that of the basis at random points."""
    points = np.random.default_rng(0).uniform(0.02, 0.98, (basis.mesh.dim(), 200))
    values, expected = sample(grid, points), basis.interpolator(x)(points)
    if expected.ndim == 2:
        assert not values[:, len(expected) :].any()
        values = values[:, : len(expected)].T
    np.testing.assert_allclose(np.reshape(values, expected.shape), expected, rtol=0, atol=atol)


X = np.array([0, 0.3, 0.55, 1.0])
BRICKS = MeshHex.init_tensor(X, X[:3] / 0.55, X)
EXACT = {  # as one cubic cell of VTK each
    "Adini": (rectangles(), ElementQuadAdini(), 70),
    "vector": (rectangles(), ElementVector(ElementQuadAdini()), 70),
    "BFS": (rectangles(), skfem_adini.ElementQuadBFS(), 70),
    "bricks": (BRICKS, ElementHexAdini(), 72),
    "refined bricks": (MeshHex().refined(1), ElementHexAdini(), 72),
    "vector bricks": (MeshHex(), ElementVector(ElementHexAdini()), 72),
}


@pytest.mark.parametrize("name", EXACT)
def test_cubic_cells_are_exact_also_in_files(name, tmp_path):
    """And in what meshio reads and writes again; hexahedra in .vtu files it refuses."""
    mesh, element, vtk_type = EXACT[name]
    basis, x = random_field(mesh, element, intorder=2)
    grid = to_pyvista(basis, x)
    assert set(grid.celltypes) == {vtk_type}
    lattice = np.prod([3 * (len(np.unique(c)) - 1) + 1 for c in mesh.p])
    assert (grid.n_cells, grid.n_points) == (mesh.nelements, lattice)
    is_exact(grid, basis, x)
    data = {} if "vector" in name else {"gradient": skfem_adini.nodal_gradient(basis, x)}
    for suffix in ("vtu", "vtk"):
        path = save(tmp_path / "new" / f"field.{suffix}", basis, x, point_data=data)
        is_exact(pv.read(path), basis, x)
        if vtk_type == 72 and suffix == "vtu":
            continue
        read = meshio.read(path)
        nodes = {70: 16, 72: 64}[vtk_type]
        assert read.cells[0].type.startswith("VTK_LAGRANGE_")
        cells = grid.cells.reshape(-1, nodes + 1)[:, 1:]
        np.testing.assert_array_equal(read.cells[0].data, cells)
        np.testing.assert_array_equal(np.ravel(read.point_data["u"]), np.ravel(grid["u"]))
        again = tmp_path / f"again.{suffix}"
        read.write(again)
        second = pv.read(again)
        assert set(second.celltypes) == {vtk_type}
        is_exact(second, basis, x)
        for key in data:
            np.testing.assert_array_equal(np.ravel(second[key]), np.ravel(pv.read(path)[key]))


def test_nodes_of_any_cells(any_cells):
    """The values at the nodes of every cell are those of the element at these points."""
    mesh, dim = any_cells, any_cells.dim()
    element = ElementQuadAdini() if dim == 2 else ElementHexAdini()
    basis, x = random_field(mesh, element, intorder=1)
    grid = to_pyvista(basis, x)
    for c in range(0, mesh.nelements, 1 if dim == 2 else 3):
        nodes = grid.get_cell(c).point_ids
        local = basis.mapping.invF(grid.points[nodes, :dim].T[:, None], tind=np.array([c]))
        np.testing.assert_allclose(local * 3, np.rint(local * 3), atol=1e-9 if dim == 3 else 1e-10)
        values = sum(
            x[dofs[c]] * np.array(element.gbasis(basis.mapping, local, i, np.array([c]))[0])
            for i, dofs in enumerate(basis.element_dofs)
        )
        np.testing.assert_allclose(grid["u"][nodes], values[0], rtol=0, atol=1e-12)
    if dim == 3:
        assert grid.compute_cell_sizes()["Volume"].min() > 0


SAME_CELL = {
    5: (MeshTri, skfem.ElementTriP1()),
    22: (MeshTri, ElementVector(skfem.ElementTriP2())),
    9: (MeshQuad, ElementQuad1()),
    28: (MeshQuad, ElementVector(skfem.ElementQuad2())),
    10: (MeshTet, ElementVector(skfem.ElementTetP1())),
    24: (MeshTet, skfem.ElementTetP2()),
    12: (MeshHex, ElementVector(skfem.ElementHex1())),
    29: (MeshHex, skfem.ElementHex2()),
}


@pytest.mark.parametrize("vtk_type", SAME_CELL)
def test_other_elements_as_their_own_cells(vtk_type):
    make, element = SAME_CELL[vtk_type]
    basis, x = random_field(make().refined(1), element)
    grid = to_pyvista(basis, x)
    assert set(grid.celltypes) == {vtk_type}
    assert grid.n_points == Basis(basis.mesh, getattr(element, "elem", element)).N
    # VTK inverts the map of quadratic tetrahedra to about 1e-5 only.
    is_exact(grid, basis, x, atol=1e-3 if vtk_type == 24 else 1e-12)


def test_serendipity_lies_in_the_nine_node_cell():
    basis, x = random_field(rectangles(), skfem.ElementQuadS2())
    is_exact(to_pyvista(basis, x), basis, x)


LINEAR = {
    9: (rectangles(), ElementQuadAdini()),
    5: (MeshTri().refined(1), skfem.ElementTriP2()),
    10: (MeshTet(), skfem.ElementTetP2()),
    12: (MeshHex(), skfem.ElementHex2()),
}


@pytest.mark.parametrize("linear_type", LINEAR)
def test_linear_sub_cells_are_positive_and_nodally_exact(linear_type):
    mesh, element = LINEAR[linear_type]
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
    for element in (skfem.ElementTriP0(), skfem.ElementTriArgyris()):
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


def test_series_with_stresses_of_each_step(tmp_path):
    """A strip stretched step by step; pyvista finds the times, fields and stresses."""
    basis = Basis(rectangles(), ElementVector(ElementQuadAdini()))
    x = basis.project(lambda p: np.array([p[0], 0 * p[0]]))
    times = [0.0, 0.1, 0.25]
    steps = [
        (t, {"u": t * x}, {"stress": nodal_stress(basis, t * x, E=1.0, nu=0.0)}) for t in times
    ]
    path = save(tmp_path / "run.pvd", basis, steps, point_data={"E": np.ones(16)})
    entries = ElementTree.parse(path).getroot().findall("Collection/DataSet")
    assert [entry.get("file") for entry in entries] == [f"run_000{k}.vtu" for k in range(3)]
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
    coarse = save(tmp_path / "coarse.pvd", basis, [(0.0, x)], subdivide=1)
    assert pv.get_reader(coarse).read()[0].n_points == 16


def test_gradients_beside_the_field(tmp_path):
    """Vectors come with three components, gradients of vector fields row by row with nine."""
    basis = Basis(rectangles(), ElementVector(ElementQuadAdini()))
    x = basis.project(lambda p: np.array([p[0] + 2 * p[1], 3 * p[0] + 4 * p[1]]))
    gradient = skfem_adini.nodal_gradient(basis, x)
    data = {"gradient": gradient, "first": gradient[0]}
    grid = pv.read(save(tmp_path / "field.vtu", basis, x, point_data=data))
    row = [1.0, 2, 0, 3, 4, 0, 0, 0, 0]
    np.testing.assert_allclose(grid["gradient"], np.tile(row, (grid.n_points, 1)), atol=1e-10)
    np.testing.assert_allclose(grid["first"], np.tile(row[:3], (grid.n_points, 1)), atol=1e-10)


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
