"""Thermal strains: free and hindered expansion, a bimetal strip, two blocks, histories."""

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID, STRAIGHT
from scipy.spatial.transform import Rotation
from skfem import ElementQuad1, ElementQuad2, ElementTriP2, MeshQuad

from contact import (
    ContactProblem,
    ElasticBody,
    InputError,
    LoadHistory,
    LoadStepper,
    Orthotropic,
    Pair,
)
from skfem_adini import ElementQuadAdini

ORTHOTROPIC = Orthotropic((11.0, 2.0, 1.0), (0.35, 0.3, 0.4), (0.9, 0.7, 0.3), rotation=0.4)
MATERIALS = [{"E": 3.0, "nu": 0.3}, {"material": ORTHOTROPIC}]
EVERY = [*PLANE_AND_BFS, *SOLID]


def standing(body):
    """Held by smooth walls left, in front and below: nothing hinders its expansion."""
    body = body.fix("left", "x").fix("bottom", "y")
    return body if body.dim == 2 else body.fix("front", "z")


def without_contact(body):
    return ContactProblem(body, "right", 1e3).solve()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("material", MATERIALS, ids=["isotropic", "orthotropic"])
@pytest.mark.parametrize(
    ("element", "plane"),
    [(e, p) for e in PLANE_AND_BFS for p in ("strain", "stress")] + [(e, None) for e in SOLID],
)
def test_free_expansion_has_no_stress_in_the_plane(element, material, plane):
    mesh = STRAIGHT[element]().refined(1).with_defaults()
    body = ElasticBody.from_mesh(mesh, element(), plane=plane, **material)
    across = 0.0 if plane == "strain" else 3e-4  # eps_zz is prevented in plane strain
    expansion = (1e-4, 2e-4, across)
    result = without_contact(standing(body.heat(20.0, expansion)))
    # The stress of hindered expansion would be 3 * 2e-3; solves with a matrix of condition 1e3.
    assert np.abs(result.stress()).max() < 1e-12
    assert np.abs(result.nodal_stress()).max() < 1e-12
    assert np.abs(result.cell_stress()).max() < 1e-12
    assert np.abs(result.von_mises()).max() < 1e-12
    x = mesh.p[:, -1:]
    assert result.sample(x)[:, 0] == pytest.approx(20 * x[:, 0] * expansion[: len(x)], abs=1e-12)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("units", [1.0, 1e11])
@pytest.mark.parametrize("element", EVERY, ids=lambda e: e.__name__)
def test_hindered_expansion(element, units):
    """Smooth walls all around: -E alpha T / (1 - 2 nu) in every direction."""
    mesh = STRAIGHT[element]().refined(1).with_defaults()
    nu, alpha, T = 0.3, 1e-5, 40.0
    body = ElasticBody.from_mesh(mesh, element(), E=units, nu=nu).heat(T, alpha)
    body = standing(body).fix("top", "y")
    if body.dim == 3:
        body.fix("back", "z")
    result = ContactProblem(body, "right", 0.0).solve()
    p = units * alpha * T / (1 - 2 * nu)
    assert np.abs(result.pressure / p - 1).max() < 1e-9
    expected = -p * np.eye(3)[:, :, None]
    assert np.abs(result.nodal_stress() - expected).max() < 1e-9 * p
    assert np.abs(result.cell_stress() - expected).max() < 1e-9 * p
    assert result.von_mises().max() < 1e-7 * p  # the root of a rounding error


@pytest.mark.parametrize("element", [ElementQuad2, ElementTriP2, ElementQuadAdini])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_sigma_zz_of_one_body_in_two_and_three_dimensions(element, plane):
    """Plane stress and strain against the three conditions on a tensor, solved one by one."""
    C, T, alpha = ORTHOTROPIC.C, 7.0, np.array([1e-4, 3e-4, 2e-4])
    mesh = STRAIGHT[element]().refined(1).with_defaults()
    body = ElasticBody.from_mesh(mesh, element(), material=ORTHOTROPIC, plane=plane).heat(T, alpha)
    thermal = np.array([*(T * alpha), 0.0, 0.0, 0.0])
    sigma = -C @ thermal
    if plane == "stress":  # eps_zz such that sigma_zz vanishes
        sigma = sigma - C[:, 2] * sigma[2] / C[2, 2]
    law, free = body.law, body.thermal_strain_in(body.basis.X)
    found = -law.stress(law.in_plane(free))
    expected = sigma[[0, 5, 5, 1]].reshape(2, 2)
    assert np.abs(found - expected[:, :, None, None]).max() < 1e-14
    assert np.abs(law.out_of_plane(found, free) - sigma[2]).max() < 1e-14


def test_bimetal_strip():
    """Curvature 24 (a2 - a1) T / (h (12 + ...)) of Timoshenko 1925, layers of equal thickness."""
    length, h, n, T = 40.0, 1.0, 1.7, 100.0
    mesh = MeshQuad.init_tensor(np.linspace(0, length, 81), np.linspace(0, h, 5)).with_defaults()
    upper = mesh.p[1, mesh.t].mean(axis=0) > h / 2
    E, alpha = np.where(upper, n, 1.0), np.where(upper, 1e-5, 2e-5)
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=E, nu=0.0, plane="stress")
    body.fix("left", "xy").heat(T, alpha[:, None, None])
    u = ContactProblem(body, "bottom", 1e3).solve()
    tip = u.sample(np.array([[length], [h / 2]]))[1, 0]
    # With m = 1: kappa = 6 (a1 - a2) T (1 + m)^2 / (h (3 (1 + m)^2 + (1 + m n) (m^2 + 1 / (m n)))).
    kappa = 24 * 1e-5 * T / (h * (12 + (1 + n) * (1 + 1 / n)))
    assert tip == pytest.approx(kappa * length**2 / 2, rel=5e-3)


def test_near_incompressible_bodies_with_mean_dilatation():
    mesh = MeshQuad().refined(2).with_defaults()
    options = {"E": 1.0, "nu": 0.4999, "dilatation": "mean"}
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), **options).heat(10.0, (1e-4, 1e-4, 0.0))
    result = without_contact(standing(body))
    assert np.abs(result.stress()).max() < 1e-10
    # A temperature that varies is taken by its mean in each cell.
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), **options).heat(lambda x: x[0], 1e-4)
    assert body.thermal.shape == (6, mesh.nelements, 1)
    x = mesh.p[0, mesh.t].mean(axis=0)
    assert np.abs(body.thermal[0, :, 0] - 1e-4 * x).max() < 1e-15


def test_quadratic_temperature_between_walls():
    """u = 0 on a long strip with alpha T(x): sigma_xx uniform, of the mean temperature."""
    mesh = MeshQuad().refined(3).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=2.0, nu=0.0, plane="stress")
    body.heat(lambda x: 3 * x[0] ** 2, (0.01, 0.0, 0.0)).fix("left", "x").fix("bottom", "y")
    result = ContactProblem(body, "right", 0.0).solve()
    # Displacements of degree two cannot follow a strain of degree two; means do.
    assert result.pressure.mean() == pytest.approx(2.0 * 0.01, rel=1e-3)
    at = np.array([[0.13, 0.9], [0.7, 0.2]])
    free = body.thermal_strain_at(at)
    assert np.abs(free[0, 0] - 0.03 * at[0] ** 2).max() < 1e-14
    assert np.abs(free[1:]).max() == 0


def test_calls_add_and_tensors_are_turned():
    mesh = MeshQuad().refined(2).with_defaults()
    one, two, other, cold = (ElasticBody.from_mesh(mesh, E=1.0, nu=0.3) for _ in range(4))
    one.heat(3.0, 1e-3)
    two.heat(1.0, 1e-3).heat(lambda x: 2 + 0 * x[0], 1e-3)
    turned = Rotation.from_euler("z", 0.3).as_matrix()
    tensor = turned @ np.diag([1e-3] * 3) @ turned.T
    other.heat(3.0, 0.5 * (tensor + tensor.T))
    assert np.abs(one.f - two.f).max() < 1e-15
    assert np.abs(one.thermal - two.thermal).max() < 1e-15
    assert np.abs(one.f - other.f).max() < 1e-15
    assert cold.thermal is None
    with pytest.raises(InputError, match="E: the body was heated"):
        one.E = 2.0


def test_a_heating_history(tmp_path):
    """Heated and cooled between walls with friction: the first step is a single solve."""
    mesh = MeshQuad().refined(2).with_defaults()

    def stepper():
        body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("top", "xy").heat(0.5, 0.01)
        made = LoadStepper(ContactProblem(body, "bottom", 0.0, friction=0.2))
        return made.heat(lambda x: 1 + x[0], 0.01, lambda t: t)

    history = stepper().run([1.0, 2.0, 3.0], path=tmp_path / "run")
    body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("top", "xy")
    body.heat(0.5, 0.01).heat(lambda x: 1 + x[0], 0.01)
    once = ContactProblem(body, "bottom", 0.0, friction=0.2).solve()
    assert np.abs(history[0].u - once.u).max() < 1e-10 * np.abs(once.u).max()
    scale = np.abs(once.stress()).max()
    assert np.abs(history[0].stress() - once.stress()).max() < 1e-9 * scale
    assert np.abs(history[2].stress() - once.stress()).max() > 0.1 * scale
    for a, b in zip(LoadHistory.load(tmp_path / "run"), history, strict=True):
        assert np.array_equal(a.stress(), b.stress())
    resumed = stepper().resume(tmp_path / "run")
    assert np.array_equal(resumed[2].nodal_stress(), history[2].nodal_stress())
    with pytest.raises(InputError, match="another problem"):
        stepper().heat(1.0, 0.01).resume(tmp_path / "run")


def test_one_of_two_blocks_is_heated():
    """Between smooth walls, free to the side: the compliances of both carry its expansion."""
    alpha, T, E = 1e-3, 2.0, (1.0, 3.0)
    meshes = [MeshQuad().refined(k).with_defaults() for k in (2, 3)]
    upper, lower = (
        ElasticBody.from_mesh(mesh, ElementQuad2(), E=young, nu=0.3, plane="stress")
        for mesh, young in zip((meshes[0].translated((0.0, 1.0)), meshes[1]), E, strict=True)
    )
    upper, lower = upper.fix("left", "x").fix("top", "y"), lower.fix("left", "x").fix("bottom", "y")
    pair = Pair(upper, "bottom", lower, "top")
    stepper = LoadStepper(ContactProblem([upper, lower], [pair]))
    history = stepper.heat(T, alpha, body=upper).run([1.0, 2.0])
    heated = ContactProblem([upper.heat(2 * T, alpha), lower], [pair]).solve()
    p = alpha * T / (1 / E[0] + 1 / E[1])
    expected = -np.diag([0.0, 1.0])[:, :, None, None]
    for result, pressure in ((history[0], p), (history[1], 2 * p), (heated, 2 * p)):
        for body in (upper, lower):
            assert np.abs(result[body].stress() / pressure - expected).max() < 1e-8
