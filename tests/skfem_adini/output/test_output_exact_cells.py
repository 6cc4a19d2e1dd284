"""Cubic Lagrange cells hold the fields of bricks and of BFS rectangles exactly."""

import meshio
import numpy as np
import pytest
import pyvista as pv
from skfem import Basis, ElementVector, MeshHex, MeshQuad

from skfem_adini import ElementHexAdini, ElementQuadBFS, save, to_pyvista

X = np.array([0, 0.3, 0.55, 1.0])
CASES = {
    "ElementQuadBFS": (MeshQuad.init_tensor(X, X), ElementQuadBFS(), 70, 16),
    "ElementHexAdini": (MeshHex.init_tensor(X, X[:3] / 0.55, X), ElementHexAdini(), 72, 64),
    "ElementHexAdini-refined": (MeshHex().refined(1), ElementHexAdini(), 72, 64),
}


@pytest.fixture(params=CASES)
def case(request):
    mesh, element, vtk_type, nodes = CASES[request.param]
    basis = Basis(mesh, element, intorder=2)
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    points = np.random.default_rng(0).uniform(0.02, 0.98, (mesh.dim(), 200))
    return basis, x, points, vtk_type, nodes


def sample(grid, points, name="u"):
    """Evaluate the VTK field; the tolerance keeps VTK inside the cell that holds the point."""
    padded = np.zeros((points.shape[1], 3))
    padded[:, : len(points)] = points.T
    result = pv.PolyData(padded).sample(grid, tolerance=1e-12)
    assert result["vtkValidPointMask"].all()
    return result[name]


def test_sampled_values(case):
    basis, x, points, vtk_type, _ = case
    grid = to_pyvista(basis, x)
    assert set(grid.celltypes) == {vtk_type}
    lattice = np.prod([3 * (len(np.unique(c)) - 1) + 1 for c in basis.mesh.p])
    assert grid.n_points == lattice
    assert grid.n_cells == basis.mesh.nelements
    expected = basis.interpolator(x)(points)
    np.testing.assert_allclose(sample(grid, points), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_round_trip_through_a_file(case, suffix, tmp_path):
    basis, x, points, *_ = case
    grid = pv.read(save(tmp_path / f"field{suffix}", basis, {"u": x}))
    expected = basis.interpolator(x)(points)
    np.testing.assert_allclose(sample(grid, points), expected, rtol=0, atol=1e-12)


def test_meshio_reads_the_file(case, tmp_path):
    """VTK gives .vtu files of hexahedra version 2.3, which meshio refuses; .vtk files it reads."""
    basis, x, _, vtk_type, nodes = case
    mesh = meshio.read(save(tmp_path / f"field.{'vtu' if vtk_type == 70 else 'vtk'}", basis, x))
    grid = to_pyvista(basis, x)
    assert mesh.cells[0].type.startswith("VTK_LAGRANGE_")
    np.testing.assert_array_equal(mesh.cells[0].data, grid.cells.reshape(-1, nodes + 1)[:, 1:])
    np.testing.assert_array_equal(np.ravel(mesh.point_data["u"]), grid["u"])


def test_round_trip_through_meshio(case, tmp_path):
    """What meshio reads and writes again is the same exact field for pyvista."""
    basis, x, points, vtk_type, _ = case
    first, second = tmp_path / "first.vtk", tmp_path / "second.vtk"
    meshio.read(save(first, basis, x)).write(second)
    grid = pv.read(second)
    assert set(grid.celltypes) == {vtk_type}
    expected = basis.interpolator(x)(points)
    np.testing.assert_allclose(sample(grid, points).ravel(), expected, rtol=0, atol=1e-12)


def test_vector_field():
    basis = Basis(MeshHex(), ElementVector(ElementHexAdini()), intorder=1)
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    points = np.random.default_rng(0).uniform(0.02, 0.98, (3, 50))
    values = sample(to_pyvista(basis, x), points)
    np.testing.assert_allclose(values.T, basis.interpolator(x)(points), rtol=0, atol=1e-12)


def test_nodes_on_any_mesh(any_hexes):
    """On every cell, the 64 values are those of the element at the 64 points; volumes are > 0."""
    basis = Basis(any_hexes, ElementHexAdini(), intorder=1)
    x = np.random.default_rng(1).uniform(-1, 1, basis.N)
    grid = to_pyvista(basis, x)
    for c in range(0, any_hexes.nelements, 3):
        nodes = grid.get_cell(c).point_ids
        local = basis.mapping.invF(grid.points[nodes].T[:, None], tind=np.array([c]))
        np.testing.assert_allclose(local * 3, np.rint(local * 3), atol=1e-9)
        values = sum(
            x[basis.element_dofs[i, c]]
            * np.array(ElementHexAdini().gbasis(basis.mapping, local, i, np.array([c]))[0])
            for i in range(32)
        )
        np.testing.assert_allclose(grid["u"][nodes], values[0], rtol=0, atol=1e-12)
    assert grid.compute_cell_sizes()["Volume"].min() > 0
