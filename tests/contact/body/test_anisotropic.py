"""Anisotropic bodies: linear displacements, rotated axes, and isotropy given as a tensor."""

import copy
import pickle
from functools import partial

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID, STRAIGHT
from scipy.sparse.linalg import spsolve
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
    MeshTri,
)
from skfem.helpers import sym_grad

from contact import (
    Anisotropic,
    ContactProblem,
    ContactResult,
    CutBody,
    ElasticBody,
    InputError,
    Orthotropic,
)
from contact.body.cell_strains import internal_forces, strain_rows
from skfem_adini import ElementQuadAdini

E, NU, G = (11.0, 2.0, 1.0), (0.35, 0.3, 0.4), (0.9, 0.7, 0.3)
TURN = Rotation.from_euler("zyx", [0.4, -0.7, 1.1])


def compliance(sigma):
    """Strain of a stress in the material axes, from the engineering constants one by one."""
    (E1, E2, E3), (n12, n13, n23), (G12, G13, G23) = E, NU, G
    eps = np.zeros((3, 3))
    eps[0, 0] = sigma[0, 0] / E1 - n12 / E1 * sigma[1, 1] - n13 / E1 * sigma[2, 2]
    eps[1, 1] = -n12 / E1 * sigma[0, 0] + sigma[1, 1] / E2 - n23 / E2 * sigma[2, 2]
    eps[2, 2] = -n13 / E1 * sigma[0, 0] - n23 / E2 * sigma[1, 1] + sigma[2, 2] / E3
    eps[0, 1] = eps[1, 0] = sigma[0, 1] / (2 * G12)
    eps[0, 2] = eps[2, 0] = sigma[0, 2] / (2 * G13)
    eps[1, 2] = eps[2, 1] = sigma[1, 2] / (2 * G23)
    return eps


def isotropic(young, nu):
    """Voigt stiffness of an isotropic material."""
    lam, mu = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 + 2 * nu)
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    return C


def tied(body, strain):
    """The body with the displacement ``strain @ x`` prescribed on its whole boundary."""
    dim = body.dim
    for c in range(dim):
        body.fix(body.mesh.boundary_facets(), c, lambda x, c=c: np.tensordot(strain[c], x, 1))
    return body


def free_solution(body):
    """Displacement without contact."""
    P, u0 = body.constraint
    S = body.stiffness
    return u0 + P @ spsolve((P.T @ S @ P).tocsc(), P.T @ (body.f - S @ u0))


@pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)
@pytest.mark.parametrize("turn", [Rotation.identity(), TURN], ids=["along", "turned"])
def test_uniform_stress_in_three_dimensions(element, turn):
    R = turn.as_matrix()
    sigma = np.array([[1.0, 0.3, -0.2], [0.3, -0.5, 0.4], [-0.2, 0.4, 0.7]])
    strain = R @ compliance(R.T @ sigma @ R) @ R.T
    mesh = STRAIGHT[element]().refined(1)
    material = Orthotropic(E, NU, G, rotation=turn)
    body = tied(ElasticBody.from_mesh(mesh, element(), material=material), strain)
    u = free_solution(body)
    gradient = np.asarray(body.basis.interpolate(u).grad)
    found = body.law.stress(gradient)
    assert np.abs(found - sigma[:, :, None, None]).max() < 1e-10
    # Inside, the internal forces of a uniform stress vanish.
    P, _ = body.constraint
    assert np.abs(P.T @ (body.stiffness @ u)).max(initial=0.0) < 1e-10


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("element", PLANE_AND_BFS, ids=lambda e: e.__name__)
def test_uniform_stress_in_the_plane(element, plane):
    angle = 0.6
    R = Rotation.from_euler("z", angle).as_matrix()
    inner = np.zeros((3, 3))
    inner[:2, :2] = [[0.8, 0.25], [0.25, -0.6]]
    sigma = inner.copy()
    if plane == "strain":  # the sigma_zz without which eps_zz would not vanish
        unit = np.zeros((3, 3))
        unit[2, 2] = 1.0
        sigma[2, 2] = -compliance(R.T @ inner @ R)[2, 2] / compliance(unit)[2, 2]
    strain = R @ compliance(R.T @ sigma @ R) @ R.T
    mesh = STRAIGHT[element]().refined(2).with_defaults()
    material = Orthotropic(E, NU, G, rotation=angle)
    body = ElasticBody.from_mesh(mesh, element(), material=material, plane=plane)
    # Pulled by tractions, the displacement fixed on the left side alone.
    for c in range(2):
        body.fix("left", c, lambda x, c=c: np.tensordot(strain[c, :2], x, 1))
    for side, n in {"right": (1, 0), "top": (0, 1), "bottom": (0, -1)}.items():
        body.load(side, sigma[:2, :2] @ n)
    result = ContactProblem(body, "bottom", 1e3).solve()
    assert np.abs(result.stress() - sigma[:2, :2, None, None]).max() < 1e-8
    assert np.abs(result.nodal_stress() - sigma[:, :, None]).max() < 1e-8
    assert np.abs(result.cell_stress() - sigma[:, :, None]).max() < 1e-8
    deviator = sigma - np.trace(sigma) / 3 * np.eye(3)
    mises = np.sqrt(1.5 * np.sum(deviator**2))
    assert np.abs(result.von_mises() - mises).max() < 1e-8
    at = np.array([[0.3, 0.71], [0.2, 0.9]])
    assert np.abs(result.stress(at) - sigma[:2, :2, None]).max() < 1e-8
    assert np.abs(result.von_mises(at) - mises).max() < 1e-8


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("element", [*PLANE_AND_BFS, *SOLID], ids=lambda e: e.__name__)
def test_isotropy_given_as_a_tensor(element, plane):
    mesh = STRAIGHT[element]().refined(1).with_defaults()
    if mesh.dim() == 3 and plane == "stress":
        plane = None
    usual = ElasticBody.from_mesh(mesh, element(), E=3.0, nu=0.3, plane=plane)
    tensor = ElasticBody.from_mesh(
        mesh, element(), material=Anisotropic(isotropic(3.0, 0.3)), plane=plane
    )
    scale = abs(usual.stiffness).max()
    assert abs(usual.stiffness - tensor.stiffness).max() < 1e-13 * scale
    u = np.random.default_rng(4).normal(size=usual.f.size)
    forces = usual.stiffness @ u
    assert np.abs(internal_forces(tensor, u) - forces).max() < 1e-12 * np.abs(forces).max()
    rows, dofs = strain_rows(tensor), tensor.basis.element_dofs.T
    energy = sum(np.sum((A @ u[at]) ** 2) for A, at in zip(rows, dofs, strict=True))
    assert energy == pytest.approx(u @ forces, rel=1e-12)


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuad1, ElementTriP2])
def test_few_classes_of_cells_give_the_matrix_of_all(element):
    """Two materials on equal cells: four local matrices at most, against scikit-fem's sum."""
    kind = MeshTri if element is ElementTriP2 else MeshQuad
    mesh = kind.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 2, 5))
    angle = np.where(np.arange(mesh.nelements) % 3, 0.4, -0.7)
    body = ElasticBody.from_mesh(mesh, element(), material=Orthotropic(E, NU, G, rotation=angle))
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


def test_energy_of_the_strain_rows_with_a_tensor_a_cell():
    mesh = MeshHex().refined(1)
    turns = Rotation.random(mesh.nelements, random_state=3)
    body = ElasticBody.from_mesh(mesh, material=Orthotropic(E, NU, G, rotation=turns))
    u = np.random.default_rng(4).normal(size=body.f.size)
    rows, dofs = strain_rows(body), body.basis.element_dofs.T
    energy = sum(np.sum((A @ u[at]) ** 2) for A, at in zip(rows, dofs, strict=True))
    forces = body.stiffness @ u
    assert energy == pytest.approx(u @ forces, rel=1e-12)
    assert np.abs(internal_forces(body, u) - forces).max() < 1e-12 * np.abs(forces).max()


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_a_turned_body_is_one_of_turned_material(plane):
    """Turning mesh, loads and axes together turns the displacement."""
    angle = 0.7
    R = Rotation.from_euler("z", angle).as_matrix()[:2, :2]
    mesh = MeshTri().refined(3).with_defaults()
    turned = type(mesh)(R @ mesh.p, mesh.t, sort_t=False).with_boundaries(mesh.boundaries)
    found = []
    for place, more, Q in ((mesh, 0.0, np.eye(2)), (turned, angle, R)):
        material = Orthotropic(E, NU, G, rotation=0.2 + more)
        body = ElasticBody.from_mesh(place, ElementTriP2(), material=material, plane=plane)
        body = body.fix("left", "xy").load("right", Q @ (0.1, -0.2))
        found.append(free_solution(body).reshape(-1, 2) @ Q)
    assert np.abs(found[0] - found[1]).max() < 1e-10 * np.abs(found[0]).max()


def test_rotations_in_all_their_forms_agree():
    turn = Rotation.from_euler("z", 0.3)
    C = Orthotropic(E, NU, G, rotation=0.3).C
    for same in (turn, turn.as_matrix()):
        assert np.abs(Orthotropic(E, NU, G, rotation=same).C - C).max() < 1e-13
    each = Orthotropic(np.tile(E, (4, 1)), NU, G, rotation=np.full(4, 0.3)).C
    assert each.shape == (4, 6, 6)
    assert np.abs(each - C).max() < 1e-13
    quarter = Orthotropic(E, NU, G, rotation=np.pi / 2).C
    assert np.allclose(quarter[0, 0], Orthotropic(E, NU, G).C[1, 1])


@pytest.mark.parametrize("units", [1.0, 2.1e11])
def test_layers_of_different_axes_in_series(units):
    """Layers along y pulled along y between rigid smooth sides: their compliances add."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 3), np.linspace(0, 1, 5)).with_defaults()
    y = mesh.p[1, mesh.t].mean(axis=0)
    turns = np.where(y < 0.5, 0.0, np.pi / 2)
    material = Orthotropic(units * np.array(E), NU, units * np.array(G), rotation=turns)
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), material=material)
    body = body.fix("left", "x").fix("right", "x").fix("bottom", "y").fix("top", "y", 0.01)
    u = free_solution(body)
    C = Orthotropic(E, NU, G).C
    stress = units * 0.01 / (0.5 / C[1, 1] + 0.5 / C[0, 0])
    sigma = body.law.stress(np.asarray(body.basis.interpolate(u).grad))
    assert np.abs(sigma[1, 1] - stress).max() < 1e-10 * stress


def test_pressure_under_an_orthotropic_block_between_smooth_sides():
    """A uniform pressure C_yy times the strain."""
    mesh = MeshQuad().refined(3).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), material=Orthotropic(E, NU, G))
    body = body.fix("left", "x").fix("right", "x").fix("top", "y", -0.01)
    result = ContactProblem(body, "bottom", 0.0).solve()
    assert np.abs(result.pressure / (0.01 * body.anisotropy.C[1, 1]) - 1).max() < 1e-8


def test_slender_cells_of_an_anisotropic_body():
    mesh = MeshQuad().refined(1).with_defaults().scaled((1.0, 1e3))
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), material=Orthotropic(E, NU, G))
    assert body.slender
    body = body.fix("left", "x").fix("top", "y", -1.0)
    result = ContactProblem(body, "bottom", 0.0).solve()
    C = body.anisotropy.C
    stiff = C[1, 1] - C[0, 1] ** 2 / C[0, 0]
    assert np.abs(result.pressure / (1e-3 * stiff) - 1).max() < 1e-6


def test_storage_and_pickle(tmp_path):
    mesh = MeshQuad().refined(2).with_defaults()
    turns = np.linspace(0, 1, mesh.nelements)
    material = Orthotropic(E, NU, G, rotation=turns)
    body = ElasticBody.from_mesh(mesh, material=material, plane="stress").fix("top", "xy", -0.01)
    problem = ContactProblem(body, "bottom", 0.0, friction=0.2)
    result = problem.solve()
    again = ContactResult.load(result.save(tmp_path / "a"))
    assert np.array_equal(again.nodal_stress(), result.nodal_stress())
    assert np.array_equal(again.von_mises(), result.von_mises())
    other = pickle.loads(pickle.dumps(result))
    assert np.array_equal(other.cell_stress(), result.cell_stress())
    twin = copy.deepcopy(problem).solve()
    assert np.array_equal(twin.u, result.u)


def test_cut_bodies_take_the_tensor():
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 12), np.linspace(-1.1, 0, 7))
    disk = CutBody(mesh.with_defaults(), lambda x: x[0] ** 2 + x[1] ** 2 - 1, E=1.0, nu=0.3)
    before = disk.stiffness
    disk._set_material(E=None, nu=None, anisotropy=Anisotropic(isotropic(1.0, 0.3)))
    assert abs(disk.stiffness - before).max() < 1e-13 * abs(before).max()


def test_a_material_assigned_later_is_used():
    mesh = MeshQuad().refined(2).with_defaults()
    body = ElasticBody.from_mesh(mesh, material=Orthotropic(E, NU, G)).fix("top", "xy", -0.01)
    problem = ContactProblem(body, "bottom", 0.0)
    soft = problem.solve().contact_force
    body.anisotropy = Anisotropic(2 * body.anisotropy.C)
    assert problem.solve().contact_force == pytest.approx(2 * soft, rel=1e-9)
    assert body.E is None
    assert body.nu is None


def _with(place, value):
    C = Orthotropic(E, NU, G).C.copy()
    C[place] = value
    return C


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Orthotropic((1, 2, 0), NU, G), "E="),
        (lambda: Orthotropic(E, NU, (1, -2, 1)), "G="),
        (lambda: Orthotropic(E, (2.4, 0, 0), G), r"nu: nu12\*\*2 must be less than E1 / E2"),
        (lambda: Orthotropic(E, (0, 0, 1.5), G), r"nu: nu23\*\*2"),
        (lambda: Orthotropic((1, 1, 1), (0.9, 0.9, 0.9), G), "nu: nu12"),
        (lambda: Orthotropic((1, 2), NU, G), "E: expected three"),
        (lambda: Orthotropic(np.ones((3, 3)), np.ones((2, 3)) / 9, G), "nu: shape"),
        (lambda: Anisotropic(np.eye(5)), "C: expected"),
        (lambda: Anisotropic(-np.eye(6)), "C: must be positive definite"),
        (lambda: Anisotropic(_with((0, 1), 7.0)), "C: must be symmetric"),
        (lambda: Anisotropic(np.eye(6), rotation=np.ones((3, 3))), "rotation: expected"),
        (lambda: Anisotropic(np.eye(6), rotation="z"), "rotation"),
        (lambda: Anisotropic(np.array([np.eye(6)] * 3), rotation=[0.1, 0.2]), "rotation: 2"),
    ],
)
def test_inadmissible_constants(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_inadmissible_bodies():
    mesh, material = MeshQuad().refined(1), Orthotropic(E, NU, G)
    for message, options in (
        ("material: it takes", {"material": material, "E": 1.0, "nu": 0.3}),
        ("material: expected", {"material": np.eye(6)}),
        ("E, nu", {"E": 1.0}),
        ("dilatation", {"material": material, "dilatation": "mean", "element": ElementQuad1()}),
        ("material: in two dim", {"material": Orthotropic(E, NU, G, rotation=TURN)}),
        ("material: it has 3", {"material": Anisotropic(np.array([np.eye(6)] * 3))}),
    ):
        with pytest.raises(InputError, match=message):
            ElasticBody.from_mesh(mesh, **options)
    body = ElasticBody(Basis(mesh, ElementVector(ElementQuad2())), material=material)
    with pytest.raises(InputError, match="material: it takes"):
        body.E = 2.0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("angle", [0.0, np.pi / 2])
def test_hertz_on_an_orthotropic_half_plane(angle):
    """The pressure is Hertz', with the modulus of Sih, Paris and Irwin 1965 for the same axes."""
    material = Orthotropic(E, NU, G, rotation=angle)
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
    gap = partial(_parabola, radius, depth)
    result = ContactProblem(body, "bottom", gap).solve()
    a = np.sqrt(4 * 2 * result.contact_force * radius / (np.pi * modulus))
    assert 0.5 < a < 2.0
    x = result.x[0]
    inside = x < 0.8 * a
    exact = modulus / (2 * radius) * np.sqrt(a**2 - x[inside] ** 2)
    error = np.abs(result.pressure[inside] - exact).max() / exact.max()
    assert error < 2e-3


def _parabola(radius, depth, x):
    return x[0] ** 2 / (2 * radius) - depth
