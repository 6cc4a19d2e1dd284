"""Contact points of axisymmetric bodies: their areas, and uniform pressures on any outline."""

import numpy as np
import pytest
from convergence import order
from families import CURVED, PLANE, PLANE_AND_BFS
from fields import rms
from skfem import ElementQuad2, ElementTriP1, ElementTriP2, MeshQuad

from contact import ContactProblem, ElasticBody, InputError
from skfem_adini import ElementQuadAdini, ElementQuadBFS

RING = {"plane": "axisymmetric"}
E, NU = 3.0, 0.3
TICKS = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.8, 1.0])
OFFERED = [(element, None) for element in PLANE_AND_BFS]
OFFERED += [(ElementTriP2, "gauss"), (ElementQuad2, "gauss")]
OFFERED += [(ElementQuadAdini, "centroid"), (ElementQuadBFS, "centroid")]
CONICAL = [case for case in OFFERED if case[0] is not ElementQuadBFS]


def ids(case):
    return case.__name__ if isinstance(case, type) else str(case)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e4])
@pytest.mark.parametrize("inner", [0.0, 0.3], ids=["disc", "annulus"])
@pytest.mark.parametrize(("element", "functional"), OFFERED, ids=ids)
def test_uniform_pressure_on_a_disc(element, functional, inner, unit, make):
    """Every point has the pressure, however small its area; the areas add up to the disc's."""
    p, moduli = 0.2, 1e9 if unit < 1 else 1.0
    mesh = make.box(element, unit * (inner + TICKS), unit * np.array([0.0, 0.4, 1.0]))
    body = ElasticBody.from_mesh(mesh, element(), E=E * moduli, nu=NU, **RING)
    body.load("top", (0.0, -p * moduli))
    result = ContactProblem(body, "bottom", 0.0, functional=functional).solve()
    area = np.pi * unit**2 * ((inner + 1) ** 2 - inner**2)
    assert np.abs(result.pressure / (p * moduli) - 1).max() < 1e-10
    assert result.system.rows.weights.min() > 0
    assert result.system.rows.weights.sum() == pytest.approx(area, rel=1e-13)
    assert result.resultant == pytest.approx([0.0, p * moduli * area], rel=1e-12)
    assert np.abs(result.balance()["residual"]).max() < 1e-13


@pytest.mark.parametrize(("element", "functional"), CONICAL, ids=ids)
def test_uniform_pressure_on_a_cone(element, functional, make):
    """A cone in a conical seat in the state u = -e x, which reaches the axis in its tip."""
    slope, e = 0.5, 0.01
    p = 3 * e * E / 3 / (1 - 2 * NU)
    flat = make.box(element, TICKS, np.linspace(0, 1, 4))
    mesh = make.remesh(flat, np.array([flat.p[0], flat.p[1] + slope * flat.p[0]]))
    n = np.array([slope, -1.0]) / np.hypot(slope, 1)
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=NU, **RING)
    body.load("top", p * n).load("right", (-p, 0.0))
    problem = ContactProblem(body, "bottom", lambda x: -e * (n @ x.reshape(2, -1)).reshape(
        x.shape[1:]), functional=functional)  # fmt: skip
    result = problem.solve()
    assert np.abs(result.pressure / p - 1).max() < 1e-10
    # On the cone the force along the axis is the pressure times the disc's area.
    assert result.resultant == pytest.approx([0.0, p * np.pi], rel=1e-11)
    assert np.abs(result.sample(mesh.p) + e * mesh.p).max() < 1e-12


def quarter_disc(element, n, second):
    """A quarter of the unit disc beside the axis, its sides of equal length."""
    grid = MeshQuad.init_tensor(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    if element in (ElementTriP1, ElementTriP2):
        grid = grid.to_meshtri(style="x" if element is ElementTriP1 else None)
    mesh = CURVED[element].from_mesh(grid) if second else grid
    a, b = mesh.doflocs
    p = np.array([a * np.sqrt(1 - b * b / 2), b * np.sqrt(1 - a * a / 2)])
    return type(mesh)(p, mesh.t).with_boundaries(
        {
            "middle": lambda x: np.abs(x[1]) < 1e-9,
            "outer": lambda x: (np.hypot(*x) > 0.9) & (x[0] > 1e-9) & (x[1] > 1e-9),
        }
    )


@pytest.mark.filterwarnings("ignore:the cells are not parallelograms")
@pytest.mark.parametrize(
    ("element", "second"),
    [*((e, False) for e in PLANE), (ElementTriP2, True), (ElementQuad2, True)],
)
def test_uniform_pressure_on_a_ball(element, second):
    """A ball in a hollow that is smaller by d: 3 K d / R, of second order up to the pole."""
    d, cells, errors, poles = 0.01, (4, 8, 16), [], []
    p = d * E / (1 - 2 * NU)
    for n in cells:
        mesh = quarter_disc(element, n, second)
        body = ElasticBody.from_mesh(mesh, element(), E=E, nu=NU, **RING).fix("middle", "y")
        result = ContactProblem(body, "outer", -d).solve()
        errors.append(rms(result, p))
        poles.append(abs(result.pressure / p - 1)[np.argmin(result.x[0])])
    if second:  # cells that follow the sphere
        assert order(cells, errors) > 2.2
        assert errors[-1] < 5e-5
        assert result.system.rows.weights.sum() == pytest.approx(2 * np.pi, rel=1e-6)
    else:
        assert 1.7 < order(cells, errors) < 2.7
        assert errors[-1] < 1e-3
        assert order(cells, poles) > 1.7
        assert poles[-1] < 1e-3


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuadBFS])
def test_gauss_points_of_cubic_traces_are_refused(element, make):
    mesh = make.box(element, TICKS, TICKS)
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=NU, **RING)
    with pytest.raises(InputError, match=r"functional='gauss'.*centroid"):
        ContactProblem(body, "bottom", 0.0, functional="gauss")


def two_discs(make, element, ticks, z, moduli, nu):
    """The upper pressed by .2 on the lower one."""
    upper, lower = (
        ElasticBody.from_mesh(make.box(element, r, at), element(), E=E, nu=nu, **RING)
        for r, at, E in zip(ticks, z, moduli, strict=True)
    )
    return upper.load("top", (0.0, -0.2)), lower.fix("bottom", "y")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("functional", ["dual", "standard", "hat"])
@pytest.mark.parametrize("ratio", [(2, 7), (7, 2), (5, 5)], ids=str)
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_two_discs(element, ratio, functional, make):
    """Uniform pressure between two discs whose meshes do not match, the axis included."""
    ticks = [np.linspace(0, 1, n + 1) ** 1.3 for n in ratio]
    z = [np.array([z, z + 0.4, z + 1.0]) for z in (0.0, -1.0)]
    upper, lower = two_discs(make, element, ticks, z, (1.0, 2.0), NU)
    problem = ContactProblem(upper, "bottom", lower.surface("top"), functional=functional)
    result = problem.solve()
    assert np.abs(result.pressure / 0.2 - 1).max() < 1e-10
    assert result.resultants == pytest.approx(np.array([[0.0, 0.2 * np.pi]]), rel=1e-11)
    assert result[lower].resultant == pytest.approx([0.0, -0.2 * np.pi], rel=1e-11)
    assert result.system.rows.weights.sum() == pytest.approx(np.pi, rel=1e-13)


def test_small_areas_at_the_axis_keep_their_points(make):
    """A point at the axis is no sliver: it stays, though its area is a millionth of others."""
    r = np.concatenate(([0.0], 1e-3 * 2.0 ** np.arange(11)))
    z = [np.array([z, z + 1.0]) for z in (0.0, -1.0)]
    upper, lower = two_discs(make, ElementQuadAdini, (r, r), z, (1.0, 1.0), 0.0)
    found = ContactProblem(upper, "bottom", lower.surface("top"))
    w = found.rows.weights
    assert w.min() < 1e-6 * w.max()
    mesh = make.box(ElementQuadAdini, r, z[0])
    flat = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=1.0, nu=0.0)
    assert w.size == ContactProblem(flat, "bottom", 0.0).rows.weights.size
    assert np.abs(found.solve().pressure / 0.2 - 1).max() < 1e-6
