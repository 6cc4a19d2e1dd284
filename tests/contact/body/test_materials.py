"""Isotropic and anisotropic bodies: stiffness, uniform stress, rotated axes, Hertz' pressure."""

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID, STRAIGHT
from fields import without_contact
from scipy.spatial.transform import Rotation
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad1,
    ElementQuad2,
    ElementTriP2,
    ElementVector,
    MeshHex,
    MeshQuad,
)
from skfem.helpers import sym_grad
from skfem.models.elasticity import lame_parameters, linear_elasticity, plane_stress

from contact import Anisotropic, ContactProblem, ElasticBody, Orthotropic
from contact.body.cell_strains import internal_forces, strain_rows
from skfem_adini import ElementQuadAdini, ElementQuadBFS

ORTHOTROPIC = (11.0, 2.0, 1.0), (0.35, 0.3, 0.4), (0.9, 0.7, 0.3)
ISOTROPIC = (2.0,) * 3, (0.3,) * 3, (2.0 / 2.6,) * 3
TURN = Rotation.from_euler("zyx", [0.4, -0.7, 1.1])
EVERY = [(e, p) for e in PLANE_AND_BFS for p in ("strain", "stress")] + [(e, None) for e in SOLID]
every = pytest.mark.parametrize(("element", "plane"), EVERY)
TICKS = np.array([0.0, 0.3, 1.0, 1.4])


def mesh_of(element):
    dim = element().dim
    return STRAIGHT[element].init_tensor(*(TICKS[: 6 - dim],) * dim)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("each_cell", [False, True])
@pytest.mark.parametrize(("element", "plane"), [c for c in EVERY if c[0] is not ElementQuadBFS])
def test_stiffness_is_that_of_scikit_fem(element, plane, each_cell):
    mesh, rng, E, nu = mesh_of(element), np.random.default_rng(5), 2.0, 0.3
    if each_cell:
        E, nu = rng.uniform(1, 3, mesh.nelements), rng.uniform(-0.3, 0.45, mesh.nelements)
    at = (E[:, None], nu[:, None]) if each_cell else (E, nu)
    moduli = plane_stress(*at) if plane == "stress" else lame_parameters(*at)
    basis = Basis(mesh, ElementVector(element()), intorder=2 * element.maxdeg)
    expected = linear_elasticity(*moduli).assemble(basis)
    more = {"E": E, "nu": nu, "plane": plane}
    bodies = ElasticBody(basis, **more), ElasticBody.from_mesh(mesh, element(), **more)
    for body in bodies:
        # A few sums of products of order one.
        assert abs(body.stiffness - expected).max() < 1e-14 * abs(expected).max()


def compliance(sigma, constants):
    """Strain of a stress in the material axes, from the engineering constants one by one."""
    (E1, E2, E3), (n12, n13, n23), (G12, G13, G23) = constants
    eps = np.zeros((3, 3))
    eps[0, 0] = sigma[0, 0] / E1 - n12 / E1 * sigma[1, 1] - n13 / E1 * sigma[2, 2]
    eps[1, 1] = -n12 / E1 * sigma[0, 0] + sigma[1, 1] / E2 - n23 / E2 * sigma[2, 2]
    eps[2, 2] = -n13 / E1 * sigma[0, 0] - n23 / E2 * sigma[1, 1] + sigma[2, 2] / E3
    eps[0, 1] = eps[1, 0] = sigma[0, 1] / (2 * G12)
    eps[0, 2] = eps[2, 0] = sigma[0, 2] / (2 * G13)
    eps[1, 2] = eps[2, 1] = sigma[1, 2] / (2 * G23)
    return eps


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", ["isotropic", "along", "turned"])
@every
def test_uniform_stress(element, plane, kind, make):
    """Pulled by tractions, the displacement prescribed on the left side alone."""
    dim, limit = element().dim, 1e-11 if kind == "isotropic" else 1e-8
    constants = ISOTROPIC if kind == "isotropic" else ORTHOTROPIC
    angle = 0.6 if kind == "turned" and dim == 2 else 0.0
    turn = TURN if kind == "turned" and dim == 3 else Rotation.from_euler("z", angle)
    R = turn.as_matrix()
    sigma = np.array([[0.8, 0.25, -0.2], [0.25, -0.6, 0.4], [-0.2, 0.4, 0.7]])
    if dim == 2:
        sigma[2] = sigma[:, 2] = 0.0
    if plane == "strain":  # the sigma_zz without which eps_zz would not vanish
        unit = np.diag([0.0, 0.0, 1.0])
        inner = compliance(R.T @ sigma @ R, constants)[2, 2]
        sigma[2, 2] = -inner / compliance(unit, constants)[2, 2]
    strain = R @ compliance(R.T @ sigma @ R, constants) @ R.T
    material = {"material": Orthotropic(*constants, rotation=turn if dim == 3 else angle)}
    if kind == "isotropic":
        material = {"E": 2.0, "nu": 0.3}
    mesh = make.box(element, *(TICKS[: 6 - dim],) * dim)
    body = ElasticBody.from_mesh(mesh, element(), plane=plane, **material)
    for c in range(dim):
        body.fix("left", c, lambda x, c=c: np.tensordot(strain[c, :dim], x, 1))
    up, across = np.eye(dim)[-1], np.eye(dim)[1]
    normals = {"right": np.eye(dim)[0], "top": up, "bottom": -up}
    normals |= {"front": -across, "back": across} if dim == 3 else {}
    for side, n in normals.items():
        body.load(side, sigma[:dim, :dim] @ n)
    result = ContactProblem(body, "bottom", 1e3).solve()  # far out of reach
    deviator = sigma - np.trace(sigma) / 3 * np.eye(3)
    mises = np.sqrt(1.5 * np.sum(deviator**2))
    at = np.random.default_rng(2).uniform(0, 1.0, (dim, 20))
    assert np.abs(result.stress() - sigma[:dim, :dim, None, None]).max() < limit
    assert np.abs(result.stress(at) - sigma[:dim, :dim, None]).max() < limit
    assert np.abs(result.nodal_stress() - sigma[:, :, None]).max() < limit
    assert np.abs(result.cell_stress() - sigma[:, :, None]).max() < limit
    assert np.abs(result.von_mises() - mises).max() < limit
    assert np.abs(result.von_mises(at) - mises).max() < limit
    grid = result.to_pyvista()
    assert np.abs(grid.point_data["nodal_stress"] - sigma.ravel()).max() < limit
    assert np.abs(grid.point_data["nodal_von_mises"] - mises).max() < limit


def isotropic(young, nu):
    """Voigt stiffness of an isotropic material."""
    lam, mu = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 + 2 * nu)
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    return C


def check_strains(body):
    """Forces and energy from the strains of the cells are those of the matrix."""
    u = np.random.default_rng(4).normal(size=body.f.size)
    forces = body.stiffness @ u
    assert np.abs(internal_forces(body, u) - forces).max() < 1e-12 * np.abs(forces).max()
    rows, dofs = strain_rows(body), body.basis.element_dofs.T
    energy = sum(np.sum((A @ u[at]) ** 2) for A, at in zip(rows, dofs, strict=True))
    assert energy == pytest.approx(u @ forces, rel=1e-12)


@pytest.mark.parametrize("nu", [0.3, -0.4])
@every
def test_isotropy_given_as_a_tensor(element, plane, nu):
    mesh = STRAIGHT[element]().refined(1).with_defaults()
    usual = ElasticBody.from_mesh(mesh, element(), E=3.0, nu=nu, plane=plane)
    tensor = Anisotropic(isotropic(3.0, nu))
    tensor = ElasticBody.from_mesh(mesh, element(), material=tensor, plane=plane)
    scale = abs(usual.stiffness).max()
    assert abs(usual.stiffness - tensor.stiffness).max() < 1e-13 * scale
    for body in (usual, tensor):
        check_strains(body)


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuad1, ElementTriP2])
def test_few_classes_of_cells_give_the_matrix_of_all(element):
    """Two materials on equal cells: four local matrices at most, against scikit-fem's sum."""
    mesh = STRAIGHT[element].init_tensor(np.linspace(0, 1, 9), np.linspace(0, 2, 5))
    angle = np.where(np.arange(mesh.nelements) % 3, 0.4, -0.7)
    material = Orthotropic(*ORTHOTROPIC, rotation=angle)
    body = ElasticBody.from_mesh(mesh, element(), material=material)
    classes, local = body.law.classes(body.basis)
    assert len(classes.cells) == len(local) <= 4
    basis = Basis(mesh, ElementVector(element()))
    tensor = np.broadcast_to(body.law.tensor[..., None], (2, 2, 2, 2, *basis.dx.shape))

    @BilinearForm
    def energy(u, v, w):
        return np.einsum("ijkleq,kleq,ijeq->eq", tensor, sym_grad(u), sym_grad(v))

    expected = energy.assemble(basis)
    assert abs(body.stiffness - expected).max() < 1e-13 * abs(expected).max()
    assert abs(body.stiffness - body.stiffness.T).max() == 0.0
    check_strains(body)


def test_rotations_in_all_their_forms_agree():
    turn = Rotation.from_euler("z", 0.3)
    C = Orthotropic(*ORTHOTROPIC, rotation=0.3).C
    for same in (turn, turn.as_matrix()):
        assert np.abs(Orthotropic(*ORTHOTROPIC, rotation=same).C - C).max() < 1e-13
    E, nu, G = ORTHOTROPIC
    each = Orthotropic(np.tile(E, (4, 1)), nu, G, rotation=np.full(4, 0.3)).C
    assert each.shape == (4, 6, 6)
    assert np.abs(each - C).max() < 1e-13
    quarter = Orthotropic(*ORTHOTROPIC, rotation=np.pi / 2).C
    assert np.allclose(quarter[0, 0], Orthotropic(*ORTHOTROPIC).C[1, 1])
    mesh = MeshHex().refined(1)
    turns = Rotation.random(mesh.nelements, random_state=3)
    check_strains(ElasticBody.from_mesh(mesh, material=Orthotropic(*ORTHOTROPIC, rotation=turns)))


@pytest.mark.parametrize("units", [1.0, 2.1e11])
def test_layers_of_different_axes_in_series(units):
    """Layers along y pulled along y between rigid smooth sides: their compliances add."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 3), np.linspace(0, 1, 5)).with_defaults()
    turns = np.where(mesh.p[1, mesh.t].mean(axis=0) < 0.5, 0.0, np.pi / 2)
    E, nu, G = ORTHOTROPIC
    material = Orthotropic(units * np.array(E), nu, units * np.array(G), rotation=turns)
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), material=material)
    body = body.fix("left", "x").fix("right", "x").fix("bottom", "y").fix("top", "y", 0.01)
    C = Orthotropic(*ORTHOTROPIC).C
    stress = units * 0.01 / (0.5 / C[1, 1] + 0.5 / C[0, 0])
    sigma = body.law.stress(np.asarray(body.basis.interpolate(without_contact(body)).grad))
    assert np.abs(sigma[1, 1] - stress).max() < 1e-10 * stress


def test_slender_cells_of_an_anisotropic_body():
    """And a material that is assigned later."""
    mesh = MeshQuad().refined(1).with_defaults().scaled((1.0, 1e3))
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), material=Orthotropic(*ORTHOTROPIC))
    assert body.slender
    problem = ContactProblem(body.fix("left", "x").fix("top", "y", -1.0), "bottom", 0.0)
    C = body.anisotropy.C
    stiff = C[1, 1] - C[0, 1] ** 2 / C[0, 0]
    assert np.abs(problem.solve().pressure / (1e-3 * stiff) - 1).max() < 1e-6
    body.anisotropy = Anisotropic(2 * C)
    assert np.abs(problem.solve().pressure / (2e-3 * stiff) - 1).max() < 1e-6
    assert body.E is None
    assert body.nu is None


@pytest.mark.sampled(2)
@pytest.mark.parametrize("angle", [0.0, np.pi / 2])
def test_hertz_on_an_orthotropic_half_plane(angle):
    """The pressure is Hertz', with the modulus of Sih, Paris and Irwin 1965 for the same axes."""
    material = Orthotropic(*ORTHOTROPIC, rotation=angle)
    S = np.linalg.inv(material.C)
    b = S - np.outer(S[:, 2], S[2]) / S[2, 2]  # compliances of plane strain
    ratio = np.sqrt(b[1, 1] / b[0, 0]) + (2 * b[0, 1] + b[5, 5]) / (2 * b[0, 0])
    modulus = 1 / (np.sqrt(b[0, 0] * b[1, 1] / 2) * np.sqrt(ratio))
    fine = np.linspace(0, 2, 33)
    ticks = np.concatenate((fine, 2 + np.cumsum(0.0625 * 1.15 ** np.arange(1, 37))))
    mesh = MeshQuad.init_tensor(ticks, ticks).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), material=material)
    body.fix("left", "x").fix("top", "xy")
    radius, depth = 100.0, 0.04
    result = ContactProblem(body, "bottom", lambda x: x[0] ** 2 / (2 * radius) - depth).solve()
    a = np.sqrt(4 * 2 * result.contact_force * radius / (np.pi * modulus))
    assert 0.5 < a < 2.0
    x = result.x[0]
    inside = x < 0.8 * a
    exact = modulus / (2 * radius) * np.sqrt(a**2 - x[inside] ** 2)
    assert np.abs(result.pressure[inside] - exact).max() < 2e-3 * exact.max()
