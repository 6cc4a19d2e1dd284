"""Cells of bodies: numbered as scikit-fem does, checked for folds, found by points; their files."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
from families import CURVED, PLANE, SOLID, STRAIGHT
from fields import linear_dofs
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import (
    Basis,
    ElementHex1,
    ElementHex2,
    ElementHexS2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriCR,
    ElementTriMini,
    ElementTriMorley,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
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
from skfem.assembly import Dofs
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

from contact import ContactProblem, ContactResult, ElasticBody, InputError, NotConverged, Plane
from contact.body.cell_check import check_cells, number_facets
from contact.body.cell_finder import find_cells, places_in
from contact.body.deferred_basis import DofNumbers, dofs_on_facets, edges_of_facets
from contact.body.jacobians import middle_determinants, turning_move
from contact.facet_basis import facet_basis, places_on_facets
from contact.rows.contact_boundaries import outward_normals
from skfem_adini import ElementHexAdini, ElementQuadAdini

LAGRANGE = [e for e in PLANE + SOLID if "Adini" not in e.__name__]
CELLS = [(e, c) for e in LAGRANGE for c in (False, True)]
cells = pytest.mark.parametrize(("element", "curved"), CELLS)
PLAIN = [MeshTri, MeshQuad, MeshTet, MeshHex]
SECOND = [MeshTri2, MeshQuad2, MeshTet2, MeshHex2]


def grid(element, curved=False, places=lambda x: x, ticks=None):
    """Cells of the unit square or cube, or of given ticks, with their nodes at other places."""
    ticks = (np.linspace(0, 1, 4),) * element().dim if ticks is None else ticks
    mesh = STRAIGHT[element].init_tensor(*ticks)
    mesh = CURVED[element].from_mesh(mesh) if curved else mesh
    return replace(mesh, doflocs=places(mesh.doflocs))


def body(mesh, element):
    return ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)


def shuffled(mesh):
    """The same mesh with its vertices and cells numbered at random."""
    rng = np.random.default_rng(4)
    places = rng.permutation(mesh.p.shape[1])
    t = np.argsort(places)[mesh.t][:, rng.permutation(mesh.t.shape[1])]
    return replace(mesh, doflocs=mesh.p[:, places], t=t.astype(np.int32))


def three_cells_at_a_facet():
    mesh = MeshTri().refined(1)
    return MeshTri(mesh.p, np.hstack([mesh.t, mesh.t[:, :2]]))


def three_common_corners():
    """Two bricks whose facets have three corners in common, and not the fourth."""
    p = np.hstack([MeshHex().p, [[0.5], [0.5], [2.0]]])
    one = MeshHex().t
    return MeshHex(p, np.hstack([one, np.where(one == one.max(), 8, one)]))


MESHES = {
    **{f"plain {m.__name__}": lambda m=m: shuffled(m().refined(2)) for m in PLAIN},
    **{
        f"curved {m.__name__}": lambda m=m, n=n: m.from_mesh(n().refined(1))
        for m, n in zip(SECOND, PLAIN, strict=True)
    },
    "three cells at a facet": three_cells_at_a_facet,
    "three common corners": three_common_corners,
}


@pytest.mark.parametrize("name", MESHES)
def test_facets_are_numbered_as_scikit_fem_does(name):
    ours, theirs = MESHES[name](), MESHES[name]()
    number_facets(ours)
    assert hasattr(ours, "_f2t") == (name != "three common corners")
    for table in ("facets", "t2f", "f2t"):
        one, other = getattr(ours, table), getattr(theirs, table)
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
    facets = ours.facets
    number_facets(ours)
    assert ours.facets is facets


ELEMENTS = [e() for e in (*PLANE, *SOLID, ElementTriMorley, ElementTriCR, ElementTriMini)]
ELEMENTS += [ElementHexS2()]


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda element: type(element).__name__)
def test_dofs_are_numbered_as_scikit_fem_does(element):
    """Those of facets, too, for which it numbers all edges."""
    mesh = {RefTri: MeshTri, RefQuad: MeshQuad, RefTet: MeshTet, RefHex: MeshHex}[element.refdom]
    lonely = np.array([[5.0]] * element.dim)  # a vertex of no cell
    mesh = mesh().refined(1)
    mesh = type(mesh)(np.hstack([mesh.p, lonely]), mesh.t)
    for one in (element, ElementVector(element)):
        ours, theirs = DofNumbers(mesh, one), Dofs(mesh, one)
        assert ours.N == theirs.N
        for name in ("nodal", "edge", "facet", "interior", "element"):
            numbers, expected = (getattr(dofs, f"{name}_dofs") for dofs in (ours, theirs))
            np.testing.assert_array_equal(numbers, expected)
            assert numbers.dtype == expected.dtype
    basis = Basis(type(mesh)().refined(2), ElementVector(element), intorder=1)
    for facets in (basis.mesh.boundary_facets(), np.arange(basis.mesh.nfacets)[::3]):
        expected = basis.get_dofs(facets).flatten()
        np.testing.assert_array_equal(dofs_on_facets(basis, facets), expected)
        if element.dim == 3:
            expected = np.sort(basis.mesh.f2e[:, facets], axis=0)
            np.testing.assert_array_equal(edges_of_facets(basis.mesh, facets), expected)


@cells
def test_vertex_beyond_its_neighbours(element, curved):
    """Every P1 triangle is one to one by itself; three of them lie on others."""

    def moved(x):
        inner = np.argmin(np.abs(x - 1 / 3).sum(axis=0))
        return np.where(np.arange(x.shape[1]) == inner, 0.9, x)

    with pytest.raises(InputError, match="untangle"):
        body(grid(element, curved, moved), element)


@cells
def test_half_that_lies_on_the_other(element, curved):
    """A sheet folded along a line of facets, no cell of it bent."""
    mesh = grid(element, curved, lambda x: np.vstack((np.minimum(x[0], 4 / 3 - x[0]), x[1:])))
    with pytest.raises(InputError, match="same side, one upon the other"):
        body(mesh, element)


@pytest.mark.parametrize("element", [ElementTriP1, ElementQuad1, ElementTetP1, ElementHex1])
def test_cells_that_are_none(element):
    """There twice, flat, of vertices that do not exist, or of points of another dimension."""
    mesh = grid(element)
    with pytest.raises(InputError, match=r"room for two|same side"):
        body(type(mesh)(mesh.p, np.hstack((mesh.t, mesh.t[:, 4:5]))), element)
    # Where a determinant is exactly zero scikit-fem raises a bare Exception.
    with pytest.raises(InputError, match="flat, not convex or folded"):
        body(grid(element, places=lambda x: np.vstack((x[:-1], 0 * x[-1]))), element)
    for vertex in (-1, -(10**7), mesh.nvertices, 10**8):
        t = mesh.t.copy()
        t[1, 3] = vertex
        words = f"cell 3 has the vertices .*{vertex}.*, of 0 to {mesh.nvertices - 1}"
        with pytest.raises(InputError, match=words):
            body(type(mesh)(mesh.p, t, sort_t=False), element)
    for rows in (mesh.p[:-1], np.vstack([mesh.p, mesh.p[:1] ** 2])):
        other = grid(element)
        other.doflocs = rows
        words = rf"points of {mesh.dim()} coordinates, got {len(rows)}"
        with pytest.raises(InputError, match=words):
            check_cells(other)
    with pytest.raises(InputError, match="no cells"):
        body(type(mesh)(mesh.p, mesh.t[:, :0]), element)


@pytest.mark.parametrize("plain", SECOND)
def test_curved_cells_have_places_for_all_nodes(plain):
    mesh = plain()
    count = mesh.doflocs.shape[1]
    mesh.doflocs = mesh.doflocs[:, :-1].copy()
    words = f"have {count} nodes, and places are given for {count - 1}"
    with pytest.raises(InputError, match=words):
        check_cells(mesh)


@cells
def test_what_is_accepted(element, curved):
    """Uneven, mirrored and turned, of any unit, and 1e6 times as long as wide."""
    rng = np.random.default_rng(1)
    body(grid(element, curved, lambda x: x + 0.005 * rng.standard_normal(x.shape)), element)
    body(grid(element, curved, lambda x: -1e-6 * x[::-1]), element)
    if STRAIGHT[element] in (MeshTri, MeshTet) and not curved:
        mesh = grid(element)
        t = mesh.t.copy()
        t[:2, ::2] = t[1::-1, ::2]
        for sort in (False, True):
            body(type(mesh)(mesh.p, t, sort_t=sort), element)
    c, s = np.cos(0.7), np.sin(0.7)

    def needle(x):
        x = x * np.array([[1.0], [1e-6], [1e-6]][: len(x)])
        return np.vstack((c * x[0] - s * x[1], s * x[0] + c * x[1], *x[2:]))

    body(grid(element, curved, needle), element)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([MeshTri, MeshQuad, MeshTet, MeshHex]))
def test_no_cell_turns_below_the_bound(seed, mesh_type):
    rng = np.random.default_rng(seed)
    mesh = mesh_type().refined(2)
    mesh = mesh.scaled(np.exp(rng.uniform(-3, 3, mesh.dim())))
    mesh = mesh_type(mesh.p * (1 + 0.05 * rng.uniform(-1, 1, mesh.p.shape)), mesh.t)
    directions = rng.standard_normal(mesh.p.shape)
    moves = turning_move(mesh) * directions / np.linalg.norm(directions, axis=0)
    rest = middle_determinants(mesh, mesh.p)
    assert (rest * middle_determinants(mesh, mesh.p + 0.99 * moves) > 0).all()


def turning(dim, planes):
    """Turned by half a radian in the planes one after the other."""
    turn = np.eye(dim)
    for plane in planes:
        one = np.eye(dim)
        one[np.ix_(plane, plane)] = [[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]]
        turn = one @ turn
    return turn


@pytest.mark.parametrize(
    ("element", "ratio"),
    [(e, r) for e in PLANE for r in (1e2, 1e4, 1e6)] + [(ElementHex1, 1e5), (ElementHex2, 1e5)],
)
def test_slender_plate_askew(element, ratio, make):
    dim = element().dim
    turn, up = turning(dim, [[0, -1]]), np.eye(dim)[-1]
    along, across = np.linspace(0, 1, 5 if dim == 2 else 3), np.linspace(0, 0.75 / ratio, 4)
    mesh = make.box(element, *(along,) * (dim - 1), across)
    mesh = replace(mesh, doflocs=turn @ mesh.doflocs)
    plate, load = body(mesh, element), 0.1 * np.eye(dim)[0] - 2.5 * up
    plate.load("top", turn @ load)
    np.testing.assert_allclose(turn.T @ plate.total(plate.f), load, atol=1e-13)
    result = ContactProblem(plate, "bottom", Plane(0 * up, turn @ up), 0.4).solve()
    # Places are rounded by machine precision of the length, of the thickness that is more by the
    # ratio; the tolerance of the solution is 1e-10.
    np.testing.assert_allclose(turn.T @ result.resultant, -load, atol=2.5e-10)
    if dim == 2:
        below = mesh.p[:, mesh.facets[:, mesh.boundaries["bottom"]]].mean(axis=1)
        normals = outward_normals(mesh, below)
        np.testing.assert_allclose(normals, -turn[:, 1:] + 0 * below, atol=1e-15 * ratio)
        middle = turn @ np.array([[0.3, 0.6], [0.1 / ratio, 0.4 / ratio]])
        near = result.u[plate.basis.nodal_dofs[:2]]
        assert np.all(np.abs(result.sample(middle)) <= 1.5 * np.abs(near).max())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("where", ["boundary", "everywhere"])
@pytest.mark.parametrize(
    ("element", "curved"),
    [c for c in CELLS if c[0].maxdeg > 1 and "1" not in c[0].__name__]
    + [(ElementQuadAdini, False)],
)
def test_places_on_facets_without_a_search(element, curved, where):
    noise = np.random.default_rng(0)
    size = 0.01 if curved else 0.03
    mesh = grid(element, curved, lambda x: x + size * noise.standard_normal(x.shape) / 1.5)
    facets = mesh.boundary_facets() if where == "boundary" else np.arange(mesh.nfacets)
    ours = facet_basis(mesh, element(), facets, intorder=4)
    theirs = FacetBasis(mesh, element(), facets=facets, intorder=4)
    # Newton's method stops at 1e-12, derivatives of the functions are some ten times as large.
    np.testing.assert_allclose(ours.dx, theirs.dx, rtol=1e-12)
    np.testing.assert_allclose(ours.normals, theirs.normals, atol=1e-11)
    for one, two in zip(ours.basis, theirs.basis, strict=True):
        np.testing.assert_allclose(one[0].grad, two[0].grad, atol=1e-10)
    mapping, inner = mesh.mapping(), np.flatnonzero(mesh.f2t[1] >= 0)
    for side in (0, 1):
        X = places_on_facets(mesh, inner, ours.X, side)
        x = mapping.F(X, tind=mesh.f2t[side, inner])
        np.testing.assert_allclose(x, mapping.G(ours.X, find=inner), atol=1e-14)


@pytest.mark.sampled(8)
@pytest.mark.parametrize(("ratio", "moved"), [(1e2, 0.0), (1e6, 0.0), (1e5, 100.0)])
@pytest.mark.parametrize(
    ("element", "curved"), [*CELLS, (ElementQuadAdini, False), (ElementHexAdini, False)]
)
def test_points_on_the_edge_of_a_body_lie_in_it(element, curved, ratio, moved):
    dim = element().dim
    turn = turning(dim, ([0, 1], [0, 2], [1, 2])[: 2 * dim - 3])
    lines = [np.linspace(0, 1, 9 - 2 * dim)] * (dim - 1) + [np.linspace(0, 0.75 / ratio, 6 - dim)]
    mesh = grid(element, curved, lambda x: turn @ x + moved, lines)
    plate = body(mesh, element)
    corners = mesh.p[:, mesh.facets[:, mesh.boundary_facets()]]
    points = np.hstack((mesh.p[:, np.unique(mesh.t)], corners.mean(axis=1)))
    found = plate.cells_of(points)
    X = places_in(mesh, plate.basis.mapping, points, found)
    # Rounding of places is machine precision of the largest, of the thickness by the ratio more.
    rounding = 1e-14 * (1 + moved) * ratio
    assert np.all((-1e-8 - rounding <= X) & (1 + 1e-8 + rounding >= X))
    again = plate.basis.mapping.F(X[:, :, None], tind=found)[:, :, 0]
    np.testing.assert_allclose(again, points, rtol=0, atol=1e-13 + rounding / 10)
    aside = points[:, :1] - turn[:, -1:] * 1e-3 / ratio
    if 1e-8 + rounding < 1e-3:
        with pytest.raises(InputError, match="outside the body"):
            plate.cells_of(np.hstack((points, aside)))
    assert find_cells(mesh, np.zeros((dim, 0))).shape == (0,)


def bent(element, bend=1.0, held=False):
    """A block of curved cells under a load of its top."""

    def place(x):
        x = x.copy()
        x[0] += bend * 0.1 * (x[0] - 0.5) * np.sin(3 * x[-1])
        x[-1] += bend * 0.15 * x[-1] * np.sin(2 * x[0])
        return x

    mesh = grid(element, True, place)
    mesh = mesh.with_boundaries({"bottom": lambda x: x[-1] == 0, "top": lambda x: x[-1] > 0.95})
    block = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    block.load("top", -0.01 * np.eye(block.dim)[-1])
    return ContactProblem(block.fix("top") if held else block, "bottom", 0.0, 0.4)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("element", "remedy"),
    [
        (ElementTriP1, r"P2 elements \(ElementTriP2\)"),
        (ElementQuad1, r"Q2 elements \(ElementQuad2\)"),
        (ElementTetP1, r"P2 elements \(ElementTetP2\)"),
        (ElementHex1, r"Q2 elements \(ElementHex2\)"),
        (ElementTriP2, None),
        (ElementQuad2, None),
    ],
)
def test_rotations_on_curved_cells(element, remedy):
    """Elements of first order hold none without strain, unless the cells are straight or held."""
    others = [bent(element, 0.0), bent(element, held=True)] if remedy else [bent(element)]
    for solved in others:
        assert max(solved.solve().kkt.values()) < 1e-10
    if remedy:
        with pytest.raises(NotConverged, match=remedy):
            bent(element).solve()


MATERIAL = {"E": 1.0, "nu": 0.3}
# Mesh of second order, its straight kind, default element, meshio's names: cell, facet.
KINDS = {
    "tetra": (MeshTet2, MeshTet, ElementTetP2, "tetra10", "triangle6"),
    "triangle": (MeshTri2, MeshTri, ElementTriP2, "triangle6", "line3"),
    "quad": (MeshQuad2, MeshQuad, ElementQuad2, "quad9", "line3"),
}


def bulged(x):
    """A smooth map of the unit box; its bottom, where the last coordinate is 0, stays flat."""
    y = x.copy()
    y[0] += 0.15 * x[-1] * np.sin(2 * x[-1])
    y[-1] *= 1 + 0.2 * x[0] ** 2
    return y


def bulged_cells(kind, refinements=1):
    """The bulged box; nodes of second order lie on it."""
    second, straight, *_ = KINDS[kind]
    mesh = second.from_mesh(straight().refined(refinements))
    return second(bulged(mesh.doflocs), mesh.t)


# Of a facet with vertices a, b, c: between which of them the nodes in the middle lie.
MIDDLES = {"line3": [(0, 1)], "triangle6": [(0, 1), (1, 2), (2, 0)]}


def written(kind, path):
    """The mesh as a .msh, its nodes in disorder: generators number them curve by curve."""
    second, _, _, cell, facet = KINDS[kind]
    mesh = bulged_cells(kind)
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
    hexahedra = MeshHex2(bulged(flat.doflocs), flat.t)
    body = ElasticBody.from_mesh(bulged_cells(kind, 0) if kind in KINDS else hexahedra, **MATERIAL)
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


def test_only_physical_groups_of_gmsh_are_names(tmp_path):
    """Format 4.1 lists bounding entities, too, which meshio makes a set of cells."""
    path = tmp_path / "square.msh"
    path.write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
        '$PhysicalNames\n2\n1 1 "bottom"\n2 2 "body"\n$EndPhysicalNames\n'
        "$Entities\n0 1 1 0\n1 0 0 0 1 0 0 1 1 0\n1 0 0 0 1 1 0 1 2 1 1\n$EndEntities\n"
        "$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n"
        "$Elements\n2 3 1 3\n1 1 1 1\n1 1 2\n2 1 2 2\n2 1 2 3\n3 1 3 4\n$EndElements\n"
    )
    assert "gmsh:bounding_entities" in meshio.read(path).cell_sets
    mesh = ElasticBody.from_mesh(path, E=1.0, nu=0.3).mesh
    assert list(mesh.boundaries) == ["bottom"]
    assert list(mesh.subdomains) == ["body"]
