"""Bases, facets and extensions of cut domains, and what they refuse."""

import numpy as np
import pytest
from skfem import Basis, ElementQuad1, ElementVector, MeshQuad, MeshQuad2, MeshTri
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdini,
    InputError,
    LevelSet,
    essential_constraints,
    ghost_penalty,
    lowest_eigenpairs,
    nitsche,
    refined_at_boundary,
)

ELEMENT = ElementQuadAdini()


@pytest.fixture
def disk(cut_problems):
    return CutDomain(cut_problems.unit_square(8), cut_problems.LEVEL_SETS["disk"])


def test_sum_of_the_bases_is_what_assemble_gives(disk):
    for form in (laplace, mass):
        by_hand = sum(form.assemble(basis) for basis in disk.basis(ELEMENT))
        difference = abs(by_hand - disk.assemble(form, ELEMENT)).max()
        assert difference < 1e-14 * abs(by_hand).max()


def test_numbering_and_orientation_of_cells_do_not_matter(cut_problems):
    mesh = cut_problems.unit_square(8)
    t = mesh.t.copy()
    t[:, ::3] = np.roll(t[:, ::3], 1, axis=0)
    t[:, 1::3] = t[::-1, 1::3]
    values = []
    for m in (mesh, MeshQuad(mesh.p, t)):
        A, _, M = cut_problems.extended(m, cut_problems.LEVEL_SETS["ellipse"])
        values.append(lowest_eigenpairs(A, M, 3, shift=0.0)[0])
    np.testing.assert_allclose(*values, rtol=1e-11)


def test_normals_and_size_in_forms(disk):
    boundary = disk.boundary(ELEMENT)
    parameters = boundary.default_parameters()
    np.testing.assert_allclose(np.asarray(parameters["h"]), 1 / 8, rtol=1e-13)
    assert np.asarray(parameters["n"]).shape == np.asarray(parameters["x"]).shape
    assert boundary.dx.sum() == pytest.approx(2 * np.pi * 0.411, abs=1e-11)
    other = boundary.with_element(linear := ElementQuad1())
    assert other.elem is linear
    half = boundary.of_cells(boundary.tind[::2])
    assert half.dx.sum() == pytest.approx(boundary.dx[::2].sum())


def test_ghost_facets_have_two_active_cells_one_of_them_cut(disk):
    cells = disk.mesh.f2t[:, disk.ghost_facets]
    assert np.isin(cells, disk.active).all()
    assert np.isin(cells, disk.cut).any(axis=0).all()
    inner = np.setdiff1d(np.flatnonzero(disk.mesh.f2t[1] >= 0), disk.ghost_facets)
    cells = disk.mesh.f2t[:, inner]
    assert not (
        np.isin(cells, disk.active).all(axis=0) & np.isin(cells, disk.cut).any(axis=0)
    ).any()


@pytest.mark.parametrize("kind", ["stiffness", "mass"])
def test_ghost_penalty_of_vectors_acts_on_each_component(disk, kind):
    scalar = ghost_penalty(disk, ELEMENT, matrix=kind)
    vector = ghost_penalty(disk, ElementVector(ELEMENT), matrix=kind)
    x = np.random.default_rng(0).uniform(-1, 1, scalar.shape[0])
    dofs = Basis(disk.mesh, ElementVector(ELEMENT), intorder=1).nodal_dofs
    for c in (0, 1):
        y = np.zeros(2 * len(x))
        y[dofs[c::2]] = x[Basis(disk.mesh, ELEMENT, intorder=1).nodal_dofs]
        assert y @ vector @ y == pytest.approx(x @ scalar @ x)


@pytest.mark.parametrize("threshold", [0.3, 0.5, 1.0])
def test_extension_reproduces_cubics(disk, threshold):
    basis = Basis(disk.mesh, ELEMENT, intorder=1)
    extension = AdiniExtension(basis, disk, threshold)
    x, y = disk.mesh.p
    exact = basis.zeros()
    u, u_x, u_y = basis.nodal_dofs
    exact[u], exact[u_x] = x**3 - x * y**2 + 1, 3 * x**2 - y**2
    exact[u_y] = -2 * x * y
    active = disk.active_dofs(basis)
    z = np.linalg.lstsq(extension.P.toarray()[active], exact[active], rcond=None)[0]
    np.testing.assert_allclose(extension.expand(z)[active], exact[active], atol=1e-12)
    good = np.unique(disk.mesh.t[:, extension.good])
    assert extension.P.shape[1] == 3 * good.size
    assert np.abs(extension.P[basis.nodal_dofs[:, good].ravel()]).max() == 1


def test_two_components_and_a_hole(cut_problems):
    """The eigenvalues of two disks are those of both; a hole gets the conditions too."""

    def ball(x, y, r):
        return LevelSet(lambda p: (p[0] - x) ** 2 + (p[1] - y) ** 2 - r**2)

    A, _, M = cut_problems.extended(
        cut_problems.unit_square(24), ball(0.3, 0.3, 0.2) | ball(0.7, 0.71, 0.21)
    )
    values = lowest_eigenpairs(A, M, 2, shift=0.0)[0]
    np.testing.assert_allclose(values, (2.404825557695773 / np.array([0.21, 0.2])) ** 2, rtol=1e-5)
    ring = ball(0.5, 0.5, 0.4) - ball(0.5, 0.5, 0.15)
    A, _, M = cut_problems.extended(cut_problems.unit_square(24), ring)
    from scipy.optimize import brentq
    from scipy.special import jv, yv

    k = brentq(lambda k: jv(0, 0.4 * k) * yv(0, 0.15 * k) - jv(0, 0.15 * k) * yv(0, 0.4 * k), 9, 14)
    assert lowest_eigenpairs(A, M, 1, shift=0.0)[0][0] == pytest.approx(k**2, rel=1e-5)


def test_hanging_vertices_stay_away_from_cut_cells(cut_problems):
    level_set = cut_problems.LEVEL_SETS["flower"]
    mesh = refined_at_boundary(cut_problems.unit_square(12), level_set, 2)
    domain = CutDomain(mesh, level_set, q=3)
    sizes = np.ptp(mesh.p[0][mesh.t], axis=0)
    np.testing.assert_allclose(sizes[domain.cut], 1 / 48, rtol=1e-12)
    assert sizes.max() == pytest.approx(1 / 12)
    assert ghost_penalty(domain, ELEMENT).shape == (3 * mesh.p.shape[1],) * 2
    assert refined_at_boundary(mesh, level_set, 0) is mesh


BAD = {
    "triangles": (lambda mesh: CutDomain(MeshTri(), lambda x: x[0]), "mesh: expected a MeshQuad"),
    "rotated": (
        lambda mesh: CutDomain(
            MeshQuad(np.array([[0.8, -0.6], [0.6, 0.8]]) @ mesh.p, mesh.t), lambda x: x[0]
        ),
        "axis-parallel rectangles",
    ),
    "outside": (lambda mesh: CutDomain(mesh, lambda x: 1 + x[0]), "no cell of the mesh"),
    "threshold": (
        lambda mesh: AdiniExtension(Basis(mesh, ELEMENT), half(mesh), 1.5), "threshold=.*: expected"
    ),
    "element": (
        lambda mesh: AdiniExtension(Basis(mesh, ElementQuad1()), half(mesh)), "basis: expected"
    ),
    "other mesh": (
        lambda mesh: AdiniExtension(Basis(mesh.refined(), ELEMENT), half(mesh)), "the same mesh"
    ),
    "thin": (
        lambda mesh: AdiniExtension(
            Basis(mesh, ELEMENT), CutDomain(mesh, lambda x: (x[0] - 0.5) ** 2 - 1e-6)
        ),
        "too thin for this mesh",
    ),
    "beta": (lambda mesh: nitsche(half(mesh).boundary(ELEMENT), beta=0), "beta=.*: expected"),
    "beta NaN": (lambda mesh: nitsche(half(mesh).boundary(ELEMENT), beta=np.nan), "beta=nan: exp"),
    "lame": (lambda mesh: nitsche(half(mesh).boundary(ELEMENT), lame=(1, 1)), "lame: give"),
    "no lame": (
        lambda mesh: nitsche(half(mesh).boundary(ElementVector(ELEMENT))), "lame: give"
    ),
    "coefficient": (
        lambda mesh: nitsche(half(mesh).boundary(ELEMENT), coefficient=-1.0), "coefficient: exp"
    ),
    "value": (lambda mesh: nitsche(half(mesh).boundary(ELEMENT), np.nan), "value: the data hold"),
    "gamma": (lambda mesh: ghost_penalty(half(mesh), ELEMENT, gamma=-1), "gamma=.*: expected"),
    "matrix": (lambda mesh: ghost_penalty(half(mesh), ELEMENT, matrix="K"), "matrix: expected"),
    "ghost element": (lambda mesh: ghost_penalty(half(mesh), ElementQuad1()), "elem: expected"),
    "parts": (lambda mesh: half(mesh).boundary(ELEMENT, parts=3), "parts: 3 has no boundary"),
    "levels": (lambda mesh: refined_at_boundary(mesh, lambda x: x[0], -1), "levels: expected"),
    "layers": (lambda mesh: refined_at_boundary(mesh, lambda x: x[0], 1, 0), "layers: expected"),
}  # fmt: skip


def half(mesh):
    return CutDomain(mesh, lambda x: x[0] - 0.6)


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused(cut_problems, name):
    make, message = BAD[name]
    with pytest.raises(InputError, match=message):
        make(cut_problems.unit_square(4))


def test_data_of_essential_conditions_need_the_matrix(cut_problems):
    mesh = cut_problems.unit_square(4).with_defaults()
    basis = Basis(mesh, ELEMENT)
    extension = AdiniExtension(
        basis, half(mesh), essential=essential_constraints(basis, "left", 1.0)
    )
    with pytest.raises(InputError, match="A: needed"):
        extension.load(basis.zeros())


def test_grids_of_second_order_are_those_of_first_order():
    """Vertices come first there, so everything is the same but the other nodes."""
    first = MeshQuad.init_tensor(*[np.linspace(0, 1, 9)] * 2)
    second = MeshQuad2.from_mesh(first)
    found = []
    for mesh in (first, second):
        domain = CutDomain(mesh, lambda x: (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - 0.411**2)
        extension = AdiniExtension(Basis(mesh, ELEMENT), domain)
        B, b = nitsche(domain.boundary(ELEMENT), lambda x: x[0], extension=extension)
        found.append(extension.solve(domain.assemble(laplace, ELEMENT) + B, b))
        active = domain.on_active_cells()
        assert active.area == domain.area
        assert Basis(active.mesh, ELEMENT).N > 0
    np.testing.assert_allclose(*found, atol=1e-10)
    curved = second.doflocs.copy()
    curved[1, 100] += 0.01
    with pytest.raises(InputError, match=r"mesh: .*curved"):
        CutDomain(MeshQuad2(curved, second.t), lambda x: x[0] - 0.5)
