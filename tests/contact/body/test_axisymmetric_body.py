"""Axisymmetric bodies beside closed forms: strains, loads, supports, stresses."""

from contextlib import nullcontext

import numpy as np
import pytest
from convergence import order
from families import CURVED, PLANE_AND_BFS
from fields import linear_dofs, without_contact
from skfem import ElementQuad1, ElementQuad2, ElementTriP1, ElementTriP2, MeshQuad

from contact import ContactProblem, ElasticBody, Orthotropic, Unbounded
from contact.body.cell_strains import internal_forces, strain_rows
from contact.body.rigid_modes import describe_motion, rigid_modes
from contact.result.body_result import nodal_stress
from skfem_adini import ElementQuadAdini

RING = {"plane": "axisymmetric"}
E, NU = 3.0, 0.3
TICKS = np.array([0.0, 0.13, 0.2, 0.41, 0.55, 0.8, 1.0])


def section(element, make, inner=0.0, r=TICKS, z=(0.0, 0.4, 1.0, 1.3), **more):
    mesh = make.box(element, inner + np.asarray(r), z)
    material = {"E": E, "nu": NU} | more if "material" not in more else more
    return ElasticBody.from_mesh(mesh, element(), **RING, **material)


@pytest.mark.parametrize("inner", [0.0, 0.5], ids=["solid", "hollow"])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_uniform_stress_is_exact(element, inner, make):
    """u_r = a r, u_z = b z under tractions on every side, through the axis and round a hole."""
    side, axial = 0.1, 0.2
    body = section(element, make, inner).fix("bottom", "y")
    body.load("top", (0.0, -axial)).load("right", (-side, 0.0))
    if inner:
        body.load("left", (side, 0.0))
    u, (r, z) = without_contact(body), body.mesh.p
    radial, along = (-side + NU * (side + axial)) / E, (-axial + 2 * NU * side) / E
    exact = np.array([radial * r, along * z])
    assert np.abs(body.displacement(u, body.mesh.p) - exact).max() < 1e-11 * np.abs(exact).max()
    wanted = np.diag([-side, -axial, -side])[:, :, None]
    assert np.abs(nodal_stress(body, u) - wanted).max() < 1e-10 * axial


@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_loads_are_forces_of_the_whole_ring(element, make):
    body, area = section(element, make, 0.5), np.pi * (1.5**2 - 0.5**2)
    body.load("top", (0.3, -2.0))
    assert body.total(body.f) == pytest.approx([0.0, -2.0 * area], rel=1e-13)
    body.f = 0 * body.f
    # Work on u_r = r: the traction times r, on the area of the outer cylinder.
    work = body.load("right", (0.7, 0.0)).f @ linear_dofs(body, np.diag([1.0, 0.0]))
    assert work == pytest.approx(0.7 * 1.5 * 2 * np.pi * 1.5 * 1.3, rel=1e-12)
    body.f = 0 * body.f
    body.body_force((0.0, -9.81))
    assert body.total(body.f)[1] == pytest.approx(-9.81 * area * 1.3)


def lame(r, inner, outer, p):
    """Displacement and stresses of a thick cylinder in plane strain under an inner pressure."""
    A = p * inner**2 / (outer**2 - inner**2)
    u = (1 + NU) / E * A * ((1 - 2 * NU) * r + outer**2 / r)
    return u, A * (1 - outer**2 / r**2), A * (1 + outer**2 / r**2)


ORDERS = {ElementTriP1: 2, ElementQuad1: 2, ElementTriP2: 3, ElementQuad2: 3, ElementQuadAdini: 4}


@pytest.mark.parametrize("element", ORDERS)
def test_thick_cylinder(element, make):
    r, cells, errors = np.linspace(1.03, 1.97, 40), (4, 8, 16), []
    for n in cells:
        z = np.linspace(0, 0.5, n // 2 + 1)
        body = section(element, make, 1.0, np.linspace(0, 1, n + 1), z).fix(["bottom", "top"], "y")
        u = without_contact(body.load("left", (0.2, 0.0)))
        exact, *_ = lame(r, 1.0, 2.0, 0.2)
        found = body.displacement(u, np.array([r, 0.21 + 0 * r]))[0]
        errors.append(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    assert ORDERS[element] - 0.3 < order(cells, errors) < ORDERS[element] + 1.3
    assert errors[-1] < {2: 2e-3, 3: 2e-5, 4: 1e-6}[ORDERS[element]]
    _, radial, hoop = lame(body.mesh.p[0], 1.0, 2.0, 0.2)
    stress = nodal_stress(body, u)[:, :, : body.mesh.nvertices]
    bound = {2: 0.2, 3: 0.01, 4: 4e-4}[ORDERS[element]]  # first order for linear cells
    for i, wanted in ((0, radial), (2, hoop), (1, NU * (radial + hoop))):
        assert np.abs(stress[i, i] - wanted).max() < bound * 0.2


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2])
def test_thick_sphere(element):
    """Lame's hollow sphere under an inner pressure, on curved cells that touch the axis."""
    p, inner, outer, cells, errors = 0.2, 1.0, 2.0, (3, 6, 12), []
    A = p * inner**3 / (outer**3 - inner**3)
    for n in cells:
        grid = MeshQuad.init_tensor(np.linspace(1, 2, n + 1), np.linspace(0, 1, n + 1))
        grid = grid.to_meshtri() if element is ElementTriP2 else grid
        mesh = CURVED[element].from_mesh(grid)
        rho, angle = mesh.doflocs[0], 0.5 * np.pi * mesh.doflocs[1]
        at = np.array([rho * np.cos(angle), rho * np.sin(angle)])
        at[:, mesh.doflocs[1] == 1.0] = np.array([0 * rho, rho])[:, mesh.doflocs[1] == 1.0]
        mesh = type(mesh)(at, mesh.t).with_boundaries(
            {"inner": lambda x: np.hypot(*x) < 1.01, "middle": lambda x: x[1] < 1e-9}
        )
        body = ElasticBody.from_mesh(mesh, element(), E=E, nu=NU, **RING).fix("middle", "y")
        body.load("inner", lambda x: p * x / np.hypot(*x))
        u = without_contact(body)
        x = body.basis.doflocs
        R = np.hypot(*x)
        exact = A / E * ((1 - 2 * NU) * R + (1 + NU) / 2 * outer**3 / R**2) / R
        exact *= np.where(np.arange(u.size) % 2, x[1], x[0])
        errors.append(np.linalg.norm(u - exact) / np.linalg.norm(exact))
    assert 2.8 < order(cells, errors) < 4.5  # at nodes more than the third order of the norm
    assert errors[-1] < 1e-4


@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_one_rigid_motion(element, make):
    """The stiffness knows one motion without strain on a section round a hole, that along z."""
    body = section(element, make, 0.5, TICKS[:4], (0.0, 0.4, 1.0))
    lengths = body.lengths[0]
    S = body.stiffness.toarray() / lengths / lengths[:, None]
    assert np.abs(S - S.T).max() < 1e-13 * np.abs(S).max()
    values = np.linalg.eigvalsh(S)
    assert values[0] > -1e-12 * values[-1]
    assert np.sum(values < 1e-10 * values[-1]) == 1
    modes = rigid_modes(body)
    assert modes.shape == (body.f.size, 1)
    assert np.abs(body.stiffness @ modes).max() < 1e-12 * np.abs(S).max()
    assert describe_motion(body, modes[:, 0]) == "a translation along the axis y"
    with pytest.raises(Unbounded, match="along the axis y"):
        ContactProblem(body.load("top", (0.0, 0.1)), "bottom", 0.0).solve()


@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_the_axis_is_held_along_r(element, make):
    """No radial displacement on the axis, nor its derivative along it; du_z / dr is not held."""
    body = section(element, make)
    P, u0 = body.constraint
    u = P @ np.random.default_rng(0).standard_normal(P.shape[1]) + u0
    z = np.linspace(0.01, 1.29, 30)
    on_axis = np.array([0 * z, z])
    assert np.abs(body.displacement(u, on_axis)[0]).max() < 1e-13
    gradient = body.gradient(u, on_axis)
    assert np.abs(gradient[0, 1]).max() < 1e-11
    assert np.abs(gradient[1, 0]).min() > 1e-3
    assert np.array_equal(gradient[2, 2], gradient[0, 0])  # the limit of u_r / r


@pytest.mark.parametrize(
    ("element", "dilatation"),
    [*((element, "pointwise") for element in PLANE_AND_BFS), (ElementQuad1, "mean")],
)
def test_strains_of_slender_cells(element, dilatation, make):
    z = np.array([0.0, 0.4, 1.0]) * 1e-3
    body = section(element, make, 0.0, TICKS[:4], z, dilatation=dilatation)
    u = np.random.default_rng(1).standard_normal(body.f.size) / body.lengths[0]
    forces = body.stiffness @ u
    assert np.abs(internal_forces(body, u) - forces).max() < 1e-10 * np.abs(forces).max()
    rows = np.einsum("crn,cn->cr", strain_rows(body), u[body.basis.element_dofs.T])
    assert np.sum(rows**2) == pytest.approx(u @ forces, rel=1e-10)
    result = ContactProblem(body.load("top", (0.0, -0.2)), "bottom", 0.0).solve()
    assert body.slender
    assert np.abs(result.pressure / 0.2 - 1).max() < 1e-6


def test_mean_dilatation_does_not_lock(make):
    """A bonded disc of Q1 cells, nu = .4999, next to Adini's; pointwise dilatation is far off."""
    force, ticks = {}, np.linspace(0, 1, 13)
    for element, dilatation in (
        (ElementQuad1, "mean"),
        (ElementQuad1, "pointwise"),
        (ElementQuadAdini, "pointwise"),
    ):
        locks = element is ElementQuad1 and dilatation == "pointwise"
        with pytest.warns() if locks else nullcontext():
            body = section(element, make, 0.0, ticks, ticks, nu=0.4999, dilatation=dilatation)
        body.fix("bottom", "xy").fix("top", "x").fix("top", "y", -0.1)
        forces = body.stiffness @ without_contact(body)
        on_top = np.where(body.basis.doflocs[1] == 1.0, forces, 0.0)
        force[element, dilatation] = body.total(on_top)[1]
    mean, pointwise, adini = force.values()
    assert mean == pytest.approx(adini, rel=0.03)
    assert pointwise < 1.5 * adini  # compression: both are negative


@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_thermal_strains(element, make):
    """A heated cylinder between smooth ends, T = r^2: Timoshenko and Goodier, article 151."""
    alpha, r = 0.1, np.linspace(0.05, 0.95, 30)
    ticks = np.linspace(0, 1, 9), (0.0, 0.125, 0.25)
    body, even = (section(element, make, 0.0, *ticks).fix(["bottom", "top"], "y") for _ in (0, 1))
    u = without_contact(body.heat(lambda x: x[0] ** 2, alpha))
    exact = (1 + NU) / (1 - NU) * alpha * ((1 - 2 * NU) * r / 4 + r**3 / 4)
    found = body.displacement(u, np.array([r, 0.1 + 0 * r]))[0]
    bound = {ElementTriP1: 1e-2, ElementQuad1: 1e-2, ElementTriP2: 2e-4, ElementQuad2: 2e-4}
    assert np.abs(found - exact).max() < bound.get(element, 1e-12) * exact.max()
    stress = nodal_stress(even, without_contact(even.heat(2.0, alpha)))
    wanted = np.diag([0.0, -2 * E * alpha, 0.0])[:, :, None]
    assert np.abs(stress - wanted).max() < 1e-9 * E * alpha


@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_wound_ring(element, make):
    """Stiffer along the hoop, nu = 0: u = A r^k + B r^-k with k^2 = E_t / E_r."""
    k, p = 2.0, 0.1
    material = Orthotropic((1.0, 1.0, k**2), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    ticks = np.linspace(0, 1, 17), np.linspace(0, 0.25, 3)
    body = section(element, make, 1.0, *ticks, material=material).fix("bottom", "y")
    u = without_contact(body.load("left", (p, 0.0)))
    A, B = np.linalg.solve([[k, -k], [k * 2 ** (k - 1), -k * 2.0 ** (-k - 1)]], [-p, 0.0])
    r = np.linspace(1.03, 1.97, 20)
    exact = A * r**k + B / r**k
    bound = 5e-3 if element in (ElementTriP1, ElementQuad1) else 1e-4
    found = body.displacement(u, np.array([r, 0.1 + 0 * r]))[0]
    assert np.abs(found - exact).max() < bound * np.abs(exact).max()
