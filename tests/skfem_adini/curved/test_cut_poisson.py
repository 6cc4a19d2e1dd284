"""Poisson's equation on cut domains: orders, all kinds of data, mixed boundaries."""

import numpy as np
import pytest
from skfem import Basis, BilinearForm, ElementVector, Functional, LinearForm
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdini,
    LevelSet,
    Polygon,
    essential_constraints,
    factorize,
    ghost_penalty,
    nitsche,
)

ELEMENT = ElementQuadAdini()


def u(x):
    return np.sin(5 * x[0] + 0.3) * np.exp(2 * x[1])


def gradient(x):
    e = np.exp(2 * x[1])
    return np.array([5 * np.cos(5 * x[0] + 0.3) * e, 2 * np.sin(5 * x[0] + 0.3) * e])


source = LinearForm(lambda v, w: 21 * u(w.x) * v)  # -lap u = (25 - 4) u
square = Functional(lambda w: (w.x_h - u(w.x)) ** 2)
energy = Functional(lambda w: ((w.x_h.grad - gradient(w.x)) ** 2).sum(axis=0))


def errors(domain, x):
    found = []
    for norm in (square, energy):
        bases = domain.groups(ELEMENT, intorder=10)
        found.append(np.sqrt(sum(norm.assemble(b, x_h=b.interpolate(x)) for b in bases)))
    return found


def check_orders(convergence_order, cells, found):
    """Cubics give h^4 in L2 and h^3 in H1.

    Their factors depend on how far vertices outside lie from the cells they follow, which changes
    from mesh to mesh: between neighbouring meshes the orders scatter by 0.7, so only a fit over a
    factor of four in h shows them.
    """
    assert max(cells) >= 4 * min(cells)
    l2, h1 = (convergence_order(cells, error) for error in np.transpose(found))
    assert 3.9 <= l2 <= 4.3
    assert 2.9 <= h1 <= 3.3


SLOW_NAMES = [pytest.param(name, marks=pytest.mark.slow) for name in ("mild flower", "flower")]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["disk", "ellipse", *SLOW_NAMES])
def test_dirichlet_orders(cut_problems, name, convergence_order):
    cells, found = [16, 24, 32, 48, 64], []
    for n in cells:
        mesh = cut_problems.unit_square(n)
        domain = CutDomain(mesh, cut_problems.LEVEL_SETS[name], q=5)
        B, b = nitsche(domain.boundary(ELEMENT), u)
        A = domain.assemble(laplace, ELEMENT) + B
        extension = AdiniExtension(Basis(mesh, ELEMENT, intorder=1), domain)
        found.append(errors(domain, extension.solve(A, domain.assemble(source, ELEMENT, 10) + b)))
    check_orders(convergence_order, cells, found)


def disk_and_boundary(cut_problems, n):
    mesh = cut_problems.unit_square(n)
    domain = CutDomain(mesh, cut_problems.LEVEL_SETS["disk"])
    return mesh, domain, domain.boundary(ELEMENT)


@pytest.mark.turns(4)
def test_robin_orders(cut_problems, convergence_order):
    cells, found = [12, 16, 24, 32, 48], []
    for n in cells:
        mesh, domain, boundary = disk_and_boundary(cut_problems, n)
        robin = BilinearForm(lambda u, v, w: 3 * u * v)
        data = LinearForm(lambda v, w: (dot(gradient(w.x), w.n) + 3 * u(w.x)) * v)
        A = domain.assemble(laplace, ELEMENT) + robin.assemble(boundary)
        b = domain.assemble(source, ELEMENT, 10) + data.assemble(boundary)
        extension = AdiniExtension(Basis(mesh, ELEMENT, intorder=1), domain)
        found.append(errors(domain, extension.solve(A, b)))
    check_orders(convergence_order, cells, found)


@pytest.mark.turns(4)
def test_neumann_and_dirichlet_on_the_parts_of_a_composition(cut_problems, convergence_order):
    """Half a disk: Dirichlet on the arc, Neumann on the chord, which ends in the arc's corners."""
    disk = LevelSet(cut_problems.LEVEL_SETS["disk"])
    half = disk & LevelSet(lambda x: 0.8 * (x[0] - 0.51) + 0.6 * (x[1] - 0.49))
    cells, found = [16, 24, 32, 48, 64], []
    for n in cells:
        mesh = cut_problems.unit_square(n)
        domain = CutDomain(mesh, half)
        arc, chord = (domain.boundary(ELEMENT, parts=k) for k in (0, 1))
        flux = LinearForm(lambda v, w: dot(gradient(w.x), w.n) * v)
        B, b = nitsche(arc, u)
        b = b + domain.assemble(source, ELEMENT, 10) + flux.assemble(chord)
        extension = AdiniExtension(Basis(mesh, ELEMENT, intorder=1), domain)
        found.append(errors(domain, extension.solve(domain.assemble(laplace, ELEMENT) + B, b)))
    check_orders(convergence_order, cells, found)


@pytest.mark.turns(4)
def test_strong_conditions_on_grid_lines_and_nitsche_on_an_arc(cut_problems, convergence_order):
    """The quarter of a disk at the corner of the mesh: the axes are grid lines."""
    cells, found = [12, 16, 24, 32, 48], []
    for n in cells:
        mesh = cut_problems.unit_square(n).with_defaults()
        domain = CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.83**2)
        basis = Basis(mesh, ELEMENT, intorder=1)
        sides = [("left", u), ("bottom", u)]
        extension = AdiniExtension(basis, domain, essential=essential_constraints(basis, sides))
        B, b = nitsche(domain.boundary(ELEMENT), u)
        A = domain.assemble(laplace, ELEMENT) + B
        x = extension.solve(A, domain.assemble(source, ELEMENT, 10) + b)
        corner = np.flatnonzero((mesh.p == 0).all(axis=0))
        assert x[basis.nodal_dofs[0, corner]] == pytest.approx(np.sin(0.3))
        found.append(errors(domain, x))
    check_orders(convergence_order, cells, found)


@pytest.mark.parametrize("stabilise", ["extension", "ghost"])
def test_cubics_are_exact_on_a_polygon(cut_problems, stabilise):
    """The patch test: -lap (x^3 - 2 x y^2) = -2 x, on a graded mesh and a slanted pentagon."""

    def cubic(x):
        return x[0] ** 3 - 2 * x[0] * x[1] ** 2

    x_ticks, y_ticks = np.array([0, 0.2, 0.5, 0.7, 1.1]), np.array([0, 0.3, 0.45, 0.8, 1])
    mesh = type(cut_problems.unit_square(1)).init_tensor(x_ticks, y_ticks)
    domain = CutDomain(mesh, Polygon([[0.1, 0.9, 1.02, 0.6, 0.15], [0.1, 0.05, 0.6, 0.95, 0.7]]))
    B, b = nitsche(domain.boundary(ELEMENT), cubic)
    A = domain.assemble(laplace, ELEMENT) + B
    b = b + domain.assemble(LinearForm(lambda v, w: -2 * w.x[0] * v), ELEMENT)
    basis = Basis(mesh, ELEMENT, intorder=1)
    active = domain.active_dofs(basis)
    if stabilise == "extension":
        x = AdiniExtension(basis, domain).solve(A, b)
    else:
        x = basis.zeros()
        A = (A + ghost_penalty(domain, ELEMENT)).tocsr()[active][:, active]
        x[active] = factorize(A).solve(b[active])
    exact = basis.zeros()
    exact[basis.nodal_dofs[0]] = cubic(mesh.p)
    exact[basis.nodal_dofs[1]] = 3 * mesh.p[0] ** 2 - 2 * mesh.p[1] ** 2
    exact[basis.nodal_dofs[2]] = -4 * mesh.p[0] * mesh.p[1]
    np.testing.assert_allclose(x[active], exact[active], atol=1e-9)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("lame", [1.5, 1e6])
def test_nearly_incompressible_elasticity_keeps_its_order(cut_problems, lame, convergence_order):
    """u = curl of a potential is free of divergence, so the load does not depend on lambda."""
    element = ElementVector(ELEMENT)

    def field(x):  # of psi = sin(3 x) cos(2 y)
        return np.array(
            [-2 * np.sin(3 * x[0]) * np.sin(2 * x[1]), -3 * np.cos(3 * x[0]) * np.cos(2 * x[1])]
        )

    load = LinearForm(lambda v, w: 13 * dot(field(w.x), v))  # -mu lap u, lap = -13
    error = Functional(lambda w: ((w.x_h - field(w.x)) ** 2).sum(axis=0))
    cells, found = [8, 16, 24], []
    for n in cells:
        mesh = cut_problems.unit_square(n)
        domain = CutDomain(mesh, cut_problems.LEVEL_SETS["disk"], q=5)
        B, b = nitsche(domain.boundary(element), field, lame=(lame, 1.0))
        A = domain.assemble(linear_elasticity(Lambda=lame, Mu=1.0), element) + B
        extension = AdiniExtension(Basis(mesh, element, intorder=1), domain)
        x = extension.solve(A, b + domain.assemble(load, element, 10))
        bases = domain.groups(element, intorder=10)
        found.append(np.sqrt(sum(error.assemble(b, x_h=b.interpolate(x)) for b in bases)))
    order = convergence_order(cells, found)
    # The element itself locks at first, on fitted meshes too: over n = 12 to 48 it is 4.4.
    assert order >= (3.8 if lame < 10 else 2.7)
    assert order <= 4.8
