"""What public objects say of themselves fits in a few lines, in a terminal and in a notebook."""

import dataclasses
import re
from importlib.metadata import version

import numpy as np
import pytest
from scipy import sparse
from skfem import Basis, ElementVector, MeshQuad
from skfem.models.poisson import laplace, mass

import cip
import contact
import gpu
import skfem_adini

PACKAGES = (cip, contact, gpu, skfem_adini)


def contact_objects():
    mesh = MeshQuad().refined(3).with_defaults()
    element = skfem_adini.ElementQuadAdini()
    body = contact.ElasticBody.from_mesh(mesh, element, E=2.0, nu=0.3)
    body = body.fix("top", "x").fix(["left", "right"], "y").load("top", (0.0, -1.0))
    plane = contact.Plane((0.0, -0.03), (0.0, 1.0))
    problem = contact.ContactProblem(body, "bottom", plane, 0.9)
    result = problem.solve()
    history = contact.LoadStepper(problem).load("top", (0.0, -1.0)).run([0.5, 1.0])
    thrown = contact.DynamicStepper(problem, 1.0, 0.1)
    yield from (thrown, thrown.step(), thrown.history)
    layers = contact.LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)])
    yield from (body, plane, problem, result, result.system, result.system.rows, history, layers)
    yield from (problem.condense(), contact.cross_check(problem, result))
    yield from (contact.uniqueness(problem, result), contact.Rigid(plane), *result.history)


def cip_objects():
    grid = cip.Grid((0, 1), 2000, periodic=True)
    solver = cip.Solver(grid, 1.0)
    run = solver.run(solver.state("sin(2*pi*x1)"), 0.1, dt=0.05)
    yield from (grid, solver, run, run.final, run.diagnostics, cip.Velocity.from_expression("x1"))


def gpu_objects():
    n = 300
    A = sparse.diags([-2.0 - np.arange(n) / n, np.ones(n - 1)], [0, 1]).toarray()
    B = np.eye(n)[:, :2]
    result = gpu.solve_qp(np.eye(n), -np.ones(n), lb=np.zeros(n))
    yield from (result, result.kkt, gpu.QPFactor(np.eye(n)), *result.history)
    yield from (gpu.lqr(A, B, np.eye(n)), gpu.lqe(A, B, B.T, np.eye(2), np.eye(2)))
    yield from (gpu.dlqr(A / 4, B, np.eye(n)), gpu.LowRankValue(B, np.eye(2)))


def adini_objects():
    mesh = MeshQuad().refined(4)
    element = skfem_adini.ElementQuadAdini()
    basis = Basis(mesh, element)
    A, M = laplace.assemble(basis), mass.assemble(basis)
    _, vectors = skfem_adini.lowest_eigenpairs(A + M, M, 2)
    yield from (element, skfem_adini.refine_eigenpair(basis, vectors[:, 1], tol=1.0))
    yield skfem_adini.near_null_space(Basis(mesh, ElementVector(element)))
    domain = skfem_adini.CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.5)
    yield from (domain, domain.quadrature, skfem_adini.UniformSolver((4, 4)))
    yield skfem_adini.Polygon(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))


@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
@pytest.mark.parametrize("objects", [contact_objects, cip_objects, gpu_objects, adini_objects])
def test_every_public_object_fits_in_a_few_lines(objects):
    long = {}
    for each in objects():
        for text in (repr(each), str(each)):
            if len(text) > 600 or text.count("\n") > 6:
                long[type(each).__name__] = len(text)
    assert not long


def first(kind):
    return next(each for each in contact_objects() if isinstance(each, kind))


def test_a_contact_problem_names_its_body_and_law():
    problem = first(contact.ContactProblem)
    body = "ElasticBody(2-D, 486 unknowns of ElementQuadAdini)"
    assert repr(problem) == f"ContactProblem({body}, {problem.rows.gap.size} points, law='coulomb')"


def test_a_contact_result_sums_itself_up():
    result = first(contact.ContactResult)
    text, html = result.summary(), result._repr_html_()
    slip = np.count_nonzero(result.status == contact.Status.SLIP)
    for fact in (f"{slip} slip", f"{result.pressure.max():.6g}", "coulomb, friction 0.9"):
        assert fact in text
        assert fact in html
    worst = float(re.search(r"no residual above (\S+)", text)[1])
    assert worst == pytest.approx(max(result.kkt.values()), rel=0.1)
    assert max(map(len, text.splitlines())) <= 100
    assert len(text.splitlines()) <= 12


def test_numbers_that_are_none_are_not_shown_as_zero():
    result = first(contact.ContactResult)
    spoilt = dataclasses.replace(result, mu=np.full_like(result.mu, np.nan))
    assert "resultant (nan, nan)" in repr(spoilt)
    with pytest.raises(contact.InputError, match="NaN"):
        spoilt.summary()


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_show_their_public_names(package):
    assert package.__version__ == version("skfem-adini")
    assert {name for name in dir(package) if not name.startswith("_")} == set(package.__all__)


@pytest.mark.parametrize(
    "base", [cip.CipError, contact.ContactError, gpu.GpuError, skfem_adini.AdiniError]
)
@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (np.float64(2.5), "2.5"),
        ((np.int32(1), np.float32(-0.5)), "(1, -0.5)"),
        ([np.True_, np.bool_(False)], "[True, False]"),
        (np.complex128(1 + 2j), "(1+2j)"),
        ({np.str_("a"): np.uint8(3)}, "{'a': 3}"),
    ],
)
def test_errors_show_numbers_of_numpy_as_numbers(base, value, shown):
    error = base(f"size={value!r}: expected np.zeros(3)")
    assert str(error) in (
        f"size={shown}: expected np.zeros(3)",
        f"size={shown[1:-1]}: expected np.zeros(3)",
    )


def test_calls_show_numbers_of_numpy_as_numbers():
    two = np.float64(2.0)
    calls = (
        lambda: gpu.solve_qp([[1.0]], [0.0], tol=two),
        lambda: gpu.eigs(np.eye(3), tol=two),
        lambda: gpu.eigs(np.eye(3), np.float64(1.5)),
        lambda: cip.Grid((np.float64(1.0), np.float64(0.0)), 8),
    )
    for call in calls:
        with pytest.raises((gpu.GpuError, cip.CipError)) as caught:
            call()
        assert "np." not in str(caught.value)
