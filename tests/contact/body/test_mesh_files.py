"""Meshes of second order with names, as mesh generators write them, and points in curved cells."""

import meshio
import numpy as np
import pytest
from fields import linear_dofs
from skfem import (
    ElementQuad2,
    ElementTetP2,
    ElementTriP2,
    FacetBasis,
    MeshHex,
    MeshHex2,
    MeshQuad,
    MeshQuad2,
    MeshTet,
    MeshTet2,
    MeshTri,
    MeshTri2,
)

from contact import ContactProblem, ContactResult, ElasticBody, InputError, Plane

MATERIAL = {"E": 1.0, "nu": 0.3}
# Mesh of second order, its straight kind, default element, meshio's names: cell, facet.
KINDS = {
    "tetra": (MeshTet2, MeshTet, ElementTetP2, "tetra10", "triangle6"),
    "triangle": (MeshTri2, MeshTri, ElementTriP2, "triangle6", "line3"),
    "quad": (MeshQuad2, MeshQuad, ElementQuad2, "quad9", "line3"),
}


def bent(x):
    """A smooth map of the unit box; its bottom, where the last coordinate is 0, stays flat."""
    y = x.copy()
    y[0] += 0.15 * x[-1] * np.sin(2 * x[-1])
    y[-1] *= 1 + 0.2 * x[0] ** 2
    return y


def curved(kind, refinements=1):
    """The bent box; nodes of second order lie on it."""
    second, straight, *_ = KINDS[kind]
    mesh = second.from_mesh(straight().refined(refinements))
    return second(bent(mesh.doflocs), mesh.t)


# Of a facet with vertices a, b, c: between which of them the nodes in the middle lie.
MIDDLES = {"line3": [(0, 1)], "triangle6": [(0, 1), (1, 2), (2, 0)]}


def written(kind, path):
    """The mesh as a .msh, its nodes in disorder: generators number them curve by curve."""
    second, _, _, cell, facet = KINDS[kind]
    mesh = curved(kind)
    flat = second.from_mesh(KINDS[kind][1]().refined(1))
    # Node of each pair of vertices, by its place before the bending.
    at = {tuple(np.round(x, 9)): i for i, x in enumerate(flat.doflocs.T)}

    def middle(vertices):
        return at[tuple(np.round(flat.p[:, list(vertices)].mean(axis=1), 9))]

    corners = [list(t) for t in mesh.t.T]
    edges = {
        "tetra": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],  # VTK's order, and meshio's
        "triangle": [(0, 1), (1, 2), (2, 0)],
        "quad": [(0, 1), (1, 2), (2, 3), (3, 0), (0, 1, 2, 3)],
    }[kind]
    cells = [t + [middle([t[i] for i in pair]) for pair in edges] for t in corners]
    sides = {"bottom": 0.0, "top": 1.0}
    blocks, tags = [(cell, np.array(cells))], [np.full(len(cells), 9)]
    for tag, name in enumerate(sides, 1):
        chosen = flat.facets_satisfying(
            lambda x, name=name: np.abs(x[-1] - sides[name]) < 1e-9, boundaries_only=True
        )
        nodes = [
            [*v, *(middle([v[i] for i in pair]) for pair in MIDDLES[facet])]
            for v in flat.facets[:, chosen].T.tolist()
        ]
        blocks.append((facet, np.array(nodes)))
        tags.append(np.full(len(nodes), tag))
    order = np.random.default_rng(0).permutation(mesh.doflocs.shape[1])
    place = np.argsort(order)
    points = np.zeros((order.size, 3))
    points[:, : mesh.dim()] = mesh.doflocs[:, order].T
    fields = {name: np.array([tag, mesh.dim() - 1]) for tag, name in enumerate(sides, 1)}
    file = meshio.Mesh(
        points,
        [(name, place[data]) for name, data in blocks],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data=fields | {"body": np.array([9, mesh.dim()])},
    )
    meshio.write(path, file, file_format="gmsh22")
    return mesh


@pytest.mark.parametrize("kind", KINDS)
def test_file_of_second_order(kind, tmp_path):
    """Names, element and geometry are those of the mesh; so is a contact problem's solution."""
    mesh = written(kind, tmp_path / "bent.msh")
    body = ElasticBody.from_mesh(tmp_path / "bent.msh", **MATERIAL)
    assert type(body.mesh) is KINDS[kind][0]
    assert isinstance(body.element, KINDS[kind][2])
    last = mesh.dim() - 1
    named = mesh.with_boundaries(
        {
            "bottom": lambda x: np.abs(x[last]) < 1e-9,
            "top": mesh.facets_satisfying(
                lambda x: x[last] > 0.99 + 0.15 * x[0] ** 2, boundaries_only=True
            ),
        }
    )
    direct = ElasticBody.from_mesh(named, **MATERIAL)
    # Coordinates are written with 16 digits.
    assert abs(body.basis.dx.sum() - direct.basis.dx.sum()) < 1e-13
    results = []
    for one in (body, direct):
        facets = FacetBasis(one.mesh, one.basis.elem, facets=one.facets("top"))
        results.append(facets.dx.sum())
        one.fix("top", "xyz"[last], -0.02).fix("top", "x")
        if last == 2:
            one.fix("top", "y")
        normal = np.eye(last + 1)[last]
        results.append(ContactProblem(one, "bottom", Plane(0 * normal, normal), 0.3).solve())
    assert abs(results[0] - results[2]) < 1e-13
    # Another numbering: rounding times the condition of the body.
    np.testing.assert_allclose(results[1].resultant, results[3].resultant, atol=1e-12)
    back = ContactResult.load(results[1].save(tmp_path / "bent.npz"))
    assert back.kkt == results[1].kkt


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 5], [1, 5, 2]])),
        (("triangle", [[0, 1, 2], [0, 2, 3], [1, 5, 2]]), ("triangle6", [[1, 4, 5, 6, 7, 8]])),
        (("tetra", [[0, 1, 3, 9]]), ("pyramid", [[1, 4, 5, 2, 9]])),
    ],
    ids=["plane", "orders", "space"],
)
def test_cells_of_several_kinds(first, second, tmp_path):
    """A part of the body would be missing."""
    points = np.zeros((10, 3))
    points[:6, :2] = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1)]
    points[6:9, :2] = [(1.5, 0), (2, 0.5), (1.5, 0.5)]
    points[9] = 1.0, 0.5, float(first[0] == "tetra")
    for cells in ([first, second], [second, first]):
        meshio.write(tmp_path / "mixed.vtu", meshio.Mesh(points, cells))
        with pytest.raises(InputError, match=rf"mixed\.vtu.*{first[0]}.*one kind"):
            ElasticBody.from_mesh(tmp_path / "mixed.vtu", **MATERIAL)


@pytest.mark.parametrize("kind", [*KINDS, "hexahedron"])
def test_points_in_curved_cells(kind):
    """An affine displacement and its stress are found anywhere, outside is told."""
    flat = MeshHex2.from_mesh(MeshHex.init_tensor([0.0, 0.5, 1.0], [0.0, 1.0], [0.0, 1.0]))
    hexahedra = MeshHex2(bent(flat.doflocs), flat.t)
    body = ElasticBody.from_mesh(curved(kind, 0) if kind in KINDS else hexahedra, **MATERIAL)
    dim, rng = body.dim, np.random.default_rng(1)
    X = rng.dirichlet(np.ones(dim + 1), 2)[:, :dim].T  # in the simplex, and in the cube
    points = body.basis.mapping.F(X).reshape(dim, -1)
    A = rng.normal(size=(dim, dim))
    u = linear_dofs(body, A)
    # Newton's method ends at 1e-10 of a cell.
    np.testing.assert_allclose(body.displacement(u, points), A @ points, atol=1e-9)
    found = body.gradient(u, points)
    np.testing.assert_allclose(found, np.repeat(A[:, :, None], points.shape[1], 2), atol=1e-9)
    with pytest.raises(InputError, match="outside"):
        body.displacement(u, np.full((dim, 1), -0.01))
