"""Bodies of large strain on a device: results of the host, and what is refused. The cuDSS of tests
without a device is an imitation on NumPy."""

import numpy as np
import pytest
from fake_cudss import FakeCudss
from skfem import ElementHex1, ElementQuad2, ElementTriP2, LinearForm, MeshHex, MeshQuad, MeshTri
from skfem.helpers import ddot, det, grad, inv, transpose

from contact import (
    ContactProblem,
    ElasticBody,
    FinitePlasticity,
    MooneyRivlin,
    NeoHooke,
    NonlinearBody,
    NonlinearStepper,
    Ogden,
    Pair,
    Plane,
    Plasticity,
    SaintVenant,
    Viscous,
)
from contact.errors import InputError, MissingDependency, NotConverged
from skfem_adini.ground.arrays import host
from skfem_adini.solvers import cudss_library


@pytest.fixture(params=["fake", pytest.param("device", marks=pytest.mark.gpu)])
def xp(request, monkeypatch):
    """The module of arrays, with cuDSS or its imitation."""
    if request.param == "fake":
        FakeCudss().put_in_place(monkeypatch)
        return np
    try:
        cudss_library.load_cudss()
        return cudss_library.device_arrays()
    except MissingDependency as error:
        pytest.skip(str(error))


def own_rubber(F):
    return F - transpose(inv(F)) * (1.0 - 9.0 * np.log(det(F)))


LAWS = {
    "neo-hooke": NeoHooke(1.0, 9.0),
    "mooney": MooneyRivlin(0.3, 0.2, 50.0),
    "ogden": Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0), K=100.0),
    "saint-venant": SaintVenant(1.0, 0.3),
    "own": own_rubber,
    "plastic": Plasticity(1e3, 0.3, 1.0),
    "finite plastic": FinitePlasticity(1e3, 0.3, 1.0, 10.0),
    "viscous": Viscous(NeoHooke(1.0, 9.0), 0.5, 1.0),
}


def block(kind, stress):
    plane = MeshQuad.init_tensor(np.linspace(-1, 1, 5), np.linspace(0, 1, 3)).with_defaults()
    ring = MeshTri.init_tensor(np.linspace(1, 2, 4), np.linspace(0, 1, 3)).with_defaults()
    cube = MeshHex.init_tensor(*3 * [np.linspace(0, 1, 3)]).with_defaults()
    mesh, element, more = {
        "strain": (plane, ElementQuad2(), {}),
        "mean": (plane, ElementQuad2(), {"dilatation": "mean"}),
        "stress": (plane, ElementQuad2(), {"plane": "stress"}),
        "ring": (ring, ElementTriP2(), {"plane": "axisymmetric"}),
        "cube": (cube, ElementHex1(), {"dilatation": "mean"}),
    }[kind]
    return NonlinearBody.from_mesh(mesh, element, stress=stress, **more)


@pytest.mark.parametrize("kind", ["strain", "mean", "stress", "ring", "cube"])
@pytest.mark.parametrize("law", LAWS)
def test_forces_and_tangents_are_those_of_the_host(xp, kind, law):
    cells = block(kind, LAWS[law]).cells
    there, rng = cells.on_device(xp), np.random.default_rng(0)
    u = 0.02 * rng.uniform(-1, 1, cells.basis.N)
    state = {name: v + 1e-4 * rng.uniform(0, 1, v.shape) for name, v in cells.rest.items()}
    f, K = cells.at(u, state, 0.1), cells.tangent(u, state, 0.1)
    np.testing.assert_allclose(there.at(u, state, 0.1), f, atol=1e-12 * np.abs(f).max())
    found = there.tangent(u, state, 0.1)
    np.testing.assert_allclose(host(found.data), K.data, atol=1e-12 * np.abs(K.data).max())
    np.testing.assert_allclose(found @ u, K @ u, atol=1e-11 * np.abs(f).max())
    assert there.least_volume(u) == pytest.approx(det(cells.gradient(cells.of_cells(u))).min())


FLOOR = Plane((0.0, 0.0), (0.0, 1.0))


@pytest.mark.parametrize("kind", ["strain", "mean", "cube"])
@pytest.mark.parametrize("law", ["own", "finite plastic", "viscous"])
def test_frictional_contact_is_that_of_the_host(xp, kind, law):
    floor = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)) if kind == "cube" else FLOOR
    depth, results = 0.05 if law == "finite plastic" else 0.2, []
    for device in ("cpu", "cuda"):
        problem = ContactProblem(block(kind, LAWS[law]).fix("top"), "bottom", floor, friction=0.3)
        stepper = NonlinearStepper(problem, device=device).move("top", "y", -depth)
        results.append(stepper.move("top", "x", 0.5 * depth).run([0.5, 1.0]).results[-1])
    here, there = results
    np.testing.assert_allclose(there.u, here.u, atol=1e-9)
    np.testing.assert_allclose(there.mu, here.mu, atol=1e-8 * np.abs(here.mu).max())
    assert max(there.certificate[name] for name in ("balance", "contact")) < 1e-9
    assert len(there.history) <= len(here.history) + 1


@pytest.mark.parametrize("linear", [False, True])
def test_two_bodies_under_a_pressure_that_follows(xp, linear):
    upper = block("strain", NeoHooke(1.0, 9.0)).fix("top")
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 4), np.linspace(-1, 0, 3)).with_defaults()
    if linear:
        lower = ElasticBody.from_mesh(mesh, E=20.0, nu=0.3).fix("bottom")
    else:
        lower = NonlinearBody.from_mesh(mesh, stress=MooneyRivlin(0.5, 0.2, 9.0)).fix("bottom")
    results = []
    for device in ("cpu", "cuda"):
        pair = Pair(upper, "bottom", lower, "top", friction=0.2)
        problem = ContactProblem([upper, lower], [pair])
        stepper = NonlinearStepper(problem, device=device).pressure("left", 0.3, body=0)
        stepper.move("top", "y", -0.1, body=0)
        results.append(stepper.run([0.5, 1.0]).results[-1])
    here, there = results
    np.testing.assert_allclose(there.u, here.u, atol=1e-9)
    np.testing.assert_allclose(there.mu, here.mu, atol=1e-8 * np.abs(here.mu).max())


def test_periodic_supports_and_histories_go_on_elsewhere(xp, tmp_path):
    def stepper(device):
        body = block("strain", Viscous(NeoHooke(1.0, 9.0), 0.5, 1.0)).fix("top")
        body.periodic("left", "right")
        problem = ContactProblem(body, "bottom", FLOOR, friction=0.1)
        return NonlinearStepper(problem, device=device).move("top", "y", -0.1)

    expected = stepper("cpu").run([0.5, 1.0, 1.5]).results[-1]
    stepper("cuda").run([0.5, 1.0], path=tmp_path)
    found = stepper("cpu").resume(tmp_path, [0.5, 1.0, 1.5]).results[-1]
    np.testing.assert_allclose(found.u, expected.u, atol=1e-9)


def test_a_path_is_that_of_the_host(xp):
    results = []
    for device in ("cpu", "cuda"):
        body = block("strain", NeoHooke(1.0, 9.0)).fix("top")
        problem = ContactProblem(body, "bottom", FLOOR)
        stepper = NonlinearStepper(problem, device=device).load("left", (-0.3, 0.0))
        results.append(stepper.follow(0.02, 2).results[-1])
    np.testing.assert_allclose(results[1].u, results[0].u, atol=1e-9)


def test_a_body_that_nothing_holds_is_named(xp):
    problem = ContactProblem(block("strain", NeoHooke(1.0, 9.0)), "bottom", FLOOR)
    stepper = NonlinearStepper(problem, halvings=0, device="cuda").load("top", (0.1, -0.1))
    with pytest.raises(NotConverged, match="singular"):
        stepper.run([1.0])


def test_what_a_device_does_not_take(xp):
    @LinearForm
    def internal(v, w):
        return ddot(grad(w["u"]), grad(v))

    mesh = MeshQuad().with_defaults()
    forms = NonlinearBody.from_forms(mesh, internal=internal).fix("top")
    with pytest.raises(InputError, match="weak forms run on the host"):
        NonlinearStepper(ContactProblem(forms, "bottom", FLOOR), device="cuda")
    body = block("strain", NeoHooke(1.0, 9.0)).fix("top")
    problem = ContactProblem(body, "bottom", FLOOR)
    with pytest.raises(InputError, match="one device"):
        NonlinearStepper(problem, device=("cuda:0", "cuda:1"))
    with pytest.raises(InputError, match="device='gpu'"):
        NonlinearStepper(problem, device="gpu")
    if xp is not np:
        listed = block("strain", lambda F: np.array([[*row] for row in F])).fix("top")
        with pytest.raises(InputError, match="does not take arrays of CuPy"):
            NonlinearStepper(ContactProblem(listed, "bottom", FLOOR), device="cuda")


def test_without_a_device(monkeypatch):
    body = block("strain", NeoHooke(1.0, 9.0)).fix("top")
    problem = ContactProblem(body, "bottom", FLOOR)
    monkeypatch.setitem(__import__("sys").modules, "cupy", None)
    with pytest.raises(MissingDependency, match=r"skfem-adini\[cudss\]"):
        NonlinearStepper(problem, device="cuda")
    assert not NonlinearStepper(problem, device="auto")._forces.cells[0].device
