"""Nitsche's matrix is definite, accurate, well conditioned wherever the boundary cuts the cells."""

from functools import reduce
from operator import and_

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import Basis, BilinearForm, ElementQuad2, FacetBasis, MeshQuad
from skfem.element import ElementVector
from skfem.helpers import ddot, div, dot, grad, sym_grad
from skfem.models.poisson import laplace, mass

import skfem_adini
from skfem_adini import AdiniExtension, CutDomain, InputError, essential_constraints, nitsche
from skfem_adini.ground.pardiso import has_pardiso
from tests.skfem_adini.cut_problems import ball, box, disk_eigenvalues, matrices, unit_square

ELEMENT = skfem_adini.ElementQuadAdini()
MESH = unit_square(8).with_defaults()
SLIVERS = [1e-12, 1e-4, 0.01]


def square(e):
    return box(0.25 - e, 0.75 + e, 0.25 - e, 0.75 + e)


def turned(e, angle):
    c, s = np.cos(angle), np.sin(angle)
    u = lambda x: c * (x[0] - 0.5) + s * (x[1] - 0.5)  # noqa: E731
    v = lambda x: c * (x[1] - 0.5) - s * (x[0] - 0.5)  # noqa: E731
    sides = (
        skfem_adini.LevelSet(lambda x, k=k, f=f: k * f(x) - 0.25 - e)
        for k in (1, -1)
        for f in (u, v)
    )
    return reduce(and_, sides)


def scaled_spectrum(A):
    """Eigenvalues with a unit diagonal; the diagonal itself where it is not positive."""
    diagonal = A.diagonal()
    if not (diagonal > 0).all():
        return np.sort(diagonal)
    scale = 1 / np.sqrt(diagonal)
    return np.linalg.eigvalsh(scale[:, None] * A.toarray() * scale)


def least(A):
    return scaled_spectrum(A)[0]


def reduced(level_set, mesh=MESH, k=1.0, lame=None, threshold=0.5, essential=None):
    """Stiffness and Nitsche's matrix on the extension."""
    domain = CutDomain(mesh, level_set, q=6)
    element = ELEMENT if lame is None else ElementVector(ELEMENT)
    basis = Basis(mesh, element, intorder=1)
    extension = AdiniExtension(basis, domain, threshold, essential and essential(basis))

    def energy(u, v, w):
        if lame is None:
            return (k(w.x) if callable(k) else k) * dot(grad(u), grad(v))
        return lame[0] * div(u) * div(v) + 2 * lame[1] * ddot(sym_grad(u), sym_grad(v))

    boundary = domain.boundary(element)
    B, _ = nitsche(boundary, coefficient=k, lame=lame, extension=extension)
    return extension.apply(domain.assemble(BilinearForm(energy), element) + B)[0]


@pytest.mark.parametrize("n", [8, 16])
@pytest.mark.parametrize("e", [1e-8, 1e-4])
def test_the_plain_call_is_definite_just_beyond_a_grid_line(n, e):
    """With 50 / h the least eigenvalues were -145 to -19628."""
    mesh = unit_square(n)
    domain = CutDomain(mesh, square(e))
    A = domain.assemble(laplace, ELEMENT) + nitsche(domain.boundary(ELEMENT))[0]
    extension = AdiniExtension(Basis(mesh, ELEMENT), domain)
    A, M = (matrix.toarray() for matrix in extension.apply(A, domain.assemble(mass, ELEMENT)))
    value = scipy.linalg.eigh(A, M, eigvals_only=True)[0]
    assert abs(value / (2 * np.pi**2 / (0.5 + 2 * e) ** 2) - 1) < 2.5e-4 * (8 / n) ** 6


GRADED = np.append(0.0, np.cumsum(1.3 ** np.arange(9)))
SOME = [0.0, 1e-10, *SLIVERS, 1e-3, 0.03, 0.1]
MANY = np.append(np.logspace(-12, 0, 100), np.linspace(0.01, 1, 100)) / 8
SHAPES = {
    "side": (
        lambda e: box(0.25, 0.75 + e, 0.25, 0.75),
        lambda e: np.pi**2 * (4 + 1 / (0.5 + e) ** 2),
    ),
    "corner": (
        lambda e: box(0.25, 0.75 + e, 0.25, 0.75 + 0.3 * e),
        lambda e: np.pi**2 * (1 / (0.5 + 0.3 * e) ** 2 + 1 / (0.5 + e) ** 2),
    ),
    "circle": (lambda e: ball(r=0.25 + e), lambda e: (2.404825557695773 / (0.25 + e)) ** 2),
}


def swept(shape, places):
    """Least scaled eigenvalues, and relative errors of the lowest eigenvalue."""
    level_set, exact = SHAPES[shape]
    mesh = unit_square(8)
    found = []
    for e in places:
        domain = CutDomain(mesh, level_set(e), q=6)
        extension = AdiniExtension(Basis(mesh, ELEMENT, intorder=1), domain)
        B, _ = nitsche(domain.boundary(ELEMENT), extension=extension)
        A = domain.assemble(laplace, ELEMENT) + B
        A, M = extension.apply(A, domain.assemble(mass, ELEMENT))
        value = scipy.linalg.eigh(A.toarray(), M.toarray(), eigvals_only=True)[0]
        found.append((least(A), abs(value / exact(e) - 1)))
    return np.transpose(found)


@pytest.mark.parametrize("places", [SOME, pytest.param(MANY, marks=pytest.mark.slow)])
@pytest.mark.parametrize("shape", SHAPES)
def test_boundaries_swept_through_a_cell(shape, places):
    definite, error = swept(shape, places)
    assert definite.min() > 1e-4
    assert error.max() < 3e-4


CORNERS = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]])
SLENDER = MeshQuad.init_tensor(np.linspace(0, 10, 9), np.linspace(0, 1, 9))
FINER = skfem_adini.refined_at_boundary(
    unit_square(8), square(0.01), levels=1, layers=1, where=lambda c: c[0] < 0.5
)
OTHERS = {
    "k from 1 to 1e6": lambda e: reduced(square(e), k=lambda x: np.exp(14 * x[0])),
    "elastic": lambda e: reduced(square(e), lame=(1.5, 1.0)),
    "nearly incompressible": lambda e: reduced(square(e), lame=(5000.0, 1.0)),
    "threshold .9": lambda e: reduced(square(e), threshold=0.9),
    "threshold .1": lambda e: reduced(square(e), threshold=0.1),
    "cells 10:1": lambda e: reduced(box(2.5 - e, 7.5 + e, 0.25 - e, 0.75 + e), SLENDER),
    "graded": lambda e: reduced(
        box(GRADED[3] - e, GRADED[7] + e, GRADED[2] - e, GRADED[8] + e),
        MeshQuad.init_tensor(GRADED, GRADED),
    ),
    "micrometres": lambda e: reduced(
        box(*(1e6 * np.array([0.25 - e, 0.75 + e, 0.25 - e, 0.75 + e]))), MESH.scaled(1e6)
    ),
    "re-entrant corner": lambda e: reduced(square(e) - box(0.5 + e, 2, 0.5 + e, 2)),
    "turned": lambda e: reduced(turned(e, 1e-4)),
    "superellipse": lambda e: reduced(lambda x: (((x - 0.5) / (0.25 + e)) ** 8).sum(axis=0) - 1),
    "polygon": lambda e: reduced(skfem_adini.Polygon(0.5 + (0.25 + e) * CORNERS)),
    "hanging vertices in cut cells": lambda e: reduced(square(e), FINER),
    "essential conditions": lambda e: reduced(
        box(-1, 0.75 + e, -1, 0.75 + e),
        essential=lambda basis: essential_constraints(basis, "left"),
    ),
    "a roller": lambda e: reduced(
        box(-1, 0.75 + e, -1, 0.75 + e),
        lame=(1.0, 1.0),
        essential=lambda basis: essential_constraints(basis, "left", components=0),
    ),
}


@pytest.mark.parametrize("case", OTHERS)
def test_other_materials_cells_and_outlines(case):
    assert min(least(OTHERS[case](e)) for e in SLIVERS) > 1e-5


@settings(max_examples=8, deadline=None)
@given(
    st.floats(0.15, 0.35),
    st.floats(0.15, 0.35),
    st.floats(0.4, 0.6),
    st.floats(0, np.pi),
    st.sampled_from([None, (0.0, 1.0), (50.0, 1.0)]),
)
def test_any_ellipse_is_definite(a, b, centre, angle, lame):
    c, s = np.cos(angle), np.sin(angle)

    def ellipse(x):
        u, v = x[0] - centre, x[1] - 0.5
        return ((c * u + s * v) / a) ** 2 + ((c * v - s * u) / b) ** 2 - 1

    assert least(reduced(ellipse, unit_square(10), lame=lame)) > 0


def test_calls_for_the_parts_add_up_to_the_call_for_all():
    """So conditions with different data on the sides of a domain stay definite together."""
    mesh = unit_square(8)
    domain = CutDomain(mesh, square(1e-4))
    extension = AdiniExtension(Basis(mesh, ELEMENT), domain)
    whole, load = nitsche(domain.boundary(ELEMENT), 1.0, extension=extension)
    parts = [nitsche(domain.boundary(ELEMENT, part), 1.0, extension=extension) for part in range(4)]
    total = sum(B for B, _ in parts)
    assert abs(whole - total).max() < 1e-12 * abs(whole).max()
    np.testing.assert_allclose(sum(b for _, b in parts), load, atol=1e-12 * abs(load).max())


def test_the_penalty_leaves_a_share_of_the_energy():
    """K + B is at least 1 - 2^(-1/2) = .29 of the energy and the penalty, whatever the floor."""
    mesh = unit_square(8)
    domain = CutDomain(mesh, square(1e-3))
    boundary = domain.boundary(ELEMENT)
    extension = AdiniExtension(Basis(mesh, ELEMENT), domain)
    K = domain.assemble(laplace, ELEMENT)
    B, _ = nitsche(boundary, beta=1e-9, extension=extension)
    fluxes = BilinearForm(lambda u, v, w: -dot(grad(u), w.n) * v - dot(grad(v), w.n) * u)
    norm, form = extension.apply(K + B - fluxes.assemble(boundary), K + B)
    share = scipy.linalg.eigh(form.toarray(), norm.toarray(), eigvals_only=True)
    assert 1 - 2**-0.5 <= share[0] < 0.8


def test_facets_of_slender_and_skew_cells():
    """The length of a facet says nothing of the cell's extent across it."""
    slender = MeshQuad.init_tensor(np.linspace(0, 10, 6), np.linspace(0, 0.5, 6))
    skew = MeshQuad(
        np.array([[1.0, 0.8], [0.0, 0.05]]) @ MeshQuad().refined(2).p, MeshQuad().refined(2).t
    )
    for mesh in (slender, skew):
        for element in (ELEMENT, ElementQuad2()):
            basis = Basis(mesh, element)
            facets = FacetBasis(mesh, element)
            A = laplace.assemble(basis) + nitsche(facets)[0]
            assert least(A) > 1e-7
            first, second = np.array_split(facets.find, 2)
            halves = [
                nitsche(FacetBasis(mesh, element, facets=some))[0] for some in (first, second)
            ]
            assert abs(halves[0] + halves[1] - nitsche(facets)[0]).max() < 1e-9 * abs(A).max()


@pytest.mark.parametrize("solver", ["auto", "superlu"])
def test_the_error_of_a_solution_names_the_cause(solver):
    """A penalty below the constant, then no condition at all: constants have no energy."""
    mesh = unit_square(8)
    domain = CutDomain(mesh, square(1e-4))
    extension = AdiniExtension(Basis(mesh, ELEMENT), domain)
    K, load = domain.assemble(laplace, ELEMENT), np.ones(Basis(mesh, ELEMENT).N)
    boundary = domain.boundary(ELEMENT)
    weak = BilinearForm(
        lambda u, v, w: 10 / w.h * u * v - dot(grad(u), w.n) * v - dot(grad(v), w.n) * u
    ).assemble(boundary)
    if solver == "auto" and has_pardiso():  # SuperLU does not see the signs of its pivots
        with pytest.raises(InputError, match=r"the matrix is indefinite, \d+ of its .*penalty"):
            extension.solve(K + weak, load)
    with pytest.raises(InputError, match=r"the matrix is singular: some function .* constants"):
        extension.solve(K, load, solver=solver)


# Accuracy and conditioning do not depend on how the boundary cuts the cells.


N = 16


def configurations(shifts, slivers):
    """Centres and radii: random shifts, and disks that poke eps h across a grid line."""
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-0.5 / N, 0.5 / N, (shifts, 2)):
        yield 0.5 + x, 0.5 + y
    for power in np.linspace(-12, -1, slivers):
        for turn in (0, 1):
            # The rightmost (topmost) point lies eps h beyond the grid line at 14/16.
            offset = 0.875 - 0.411 + 10.0**power / N
            yield (offset, 0.5) if turn == 0 else (0.5, offset)


@pytest.mark.parametrize(
    ("shifts", "slivers"),
    [pytest.param(2, 1, marks=pytest.mark.turns(4)), pytest.param(200, 25, marks=pytest.mark.slow)],
)
def test_shifts_and_slivers(shifts, slivers):
    mesh = unit_square(N)
    basis = Basis(mesh, ELEMENT, intorder=1)
    errors, conditions = {"extension": [], "ghost": []}, {"extension": [], "ghost": []}
    for cx, cy in configurations(shifts, slivers):
        domain, K, M, B = matrices(mesh, ball(cx, cy), q=5)
        active = domain.active_dofs(basis)
        ghost = [
            (A + skfem_adini.ghost_penalty(domain, ELEMENT, matrix=kind)).tocsr()[active][:, active]
            for A, kind in ((K + B, "stiffness"), (M, "mass"))
        ]
        extension = AdiniExtension(basis, domain).apply(K + B, M)
        for name, (A, weight) in (("extension", extension), ("ghost", ghost)):
            spectrum = scaled_spectrum(A)
            assert spectrum[0] > 0, (name, cx, cy)
            conditions[name].append(spectrum[-1] / spectrum[0])
            value = skfem_adini.lowest_eigenpairs(A, weight, 1, shift=0.0)[0][0]
            errors[name].append(abs(value / disk_eigenvalues(1)[0] - 1))
    for found in errors.values():
        assert max(found) <= 1.2 * min(found)
        assert max(found) <= 2.5e-7
    assert max(conditions["extension"]) <= 6e4
    assert max(conditions["ghost"]) <= 4e3
