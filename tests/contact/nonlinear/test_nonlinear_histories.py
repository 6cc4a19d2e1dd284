"""Histories of large strain: interruption, files, pictures, failures that say why."""

import logging

import numpy as np
import pytest
from rubber_blocks import FAR, FLOOR, cube, pressed
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTriP1, LinearForm, MeshQuad
from skfem.helpers import ddot, grad

from contact import (
    ContactProblem,
    Cylinder,
    ElasticBody,
    FinitePlasticity,
    InputError,
    LoadStepper,
    NeoHooke,
    NonlinearBody,
    NonlinearStepper,
    NotConverged,
    Pair,
    Plasticity,
    Rigid,
    Viscous,
)
from skfem_adini import ElementQuadAdini, ElementQuadBFS
from skfem_adini.ground.archives import read_arrays, write_arrays

RUBBER = NeoHooke(1.0, 9.0)
METAL = FinitePlasticity(100.0, 0.3, 1.0, 10.0)
TIMES = [0.25, 0.5, 0.75, 1.0]


def stepper_of(law=METAL, friction=0.2, depth=0.1):
    return pressed(cube(ElementQuad1, law, n=3), friction, depth, Cylinder((0.4, -1.0), 1.0))


class _Interrupted(Exception):
    pass


@pytest.mark.parametrize(
    "law", [METAL, Viscous(RUBBER, 0.5, 1.0), RUBBER], ids=["metal", "visco", "rubber"]
)
def test_resumed_history_is_that_of_one_run(tmp_path, law):
    whole = stepper_of(law).run(TIMES)

    def stop(result):
        if result.time == 0.5:
            raise _Interrupted

    with pytest.raises(_Interrupted):
        stepper_of(law).run(TIMES, path=tmp_path / "run", callback=stop)
    resumed = stepper_of(law).resume(tmp_path / "run", TIMES)
    for one, other in zip(whole, resumed, strict=True):
        assert np.array_equal(one.u, other.u)
        assert np.array_equal(one.mu, other.mu)
        assert all(np.array_equal(one.states[0][n], other.states[0][n]) for n in one.states[0])
        assert other.certificate["balance"] <= 1e-9
    with pytest.raises(InputError, match="resume"):
        stepper_of(law).run(TIMES, path=tmp_path / "run")


@pytest.mark.parametrize(
    "other",
    [
        lambda: (stepper_of(RUBBER), TIMES),
        lambda: (stepper_of(friction=0.3), TIMES),
        lambda: (stepper_of(depth=0.2), TIMES),
        lambda: (stepper_of(), [0.2, 0.5]),
    ],
    ids=["law", "friction", "depth", "times"],
)
def test_steps_of_another_run_are_refused(tmp_path, other):
    stepper_of().run(TIMES[:2], path=tmp_path / "run")
    stepper, times = other()
    with pytest.raises(InputError, match="another problem"):
        stepper.resume(tmp_path / "run", times)


def test_a_changed_step_fails_its_certificate(tmp_path):
    stepper_of(RUBBER).run(TIMES[:1], path=tmp_path / "run")
    file = next((tmp_path / "run").glob("*.npz"))
    known, _ = read_arrays(file)
    known["end/u"][5] += 1e-3
    write_arrays(file, known)
    with pytest.raises(NotConverged, match="certificate"):
        stepper_of(RUBBER).resume(tmp_path / "run", TIMES[:1])


def test_files_and_pictures(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    history = stepper_of().run(TIMES[:2])
    written = history.to_pvd(tmp_path / "run.pvd", subdivide=1)
    grid = pyvista.read(tmp_path / "run_0001.vtu")
    result = history.results[-1]
    body, u = result.of_body()
    corners = body.mesh.p + u[body.basis.nodal_dofs]
    there = np.asarray(grid.points)[:, :2]
    far = np.linalg.norm(there[:, None] - corners.T[None], axis=2).min(axis=1)
    assert far.max() <= 1e-6
    assert {"det_F", "alpha"} <= set(grid.cell_data)
    assert written.read_text().count("DataSet") == 2
    line = pyvista.read(tmp_path / "run_boundary_0001.vtp")
    assert line.n_lines == 1
    assert np.array_equal(np.asarray(line.points)[:, :2], result.x.T)
    film = history.animate(tmp_path / "film.gif")
    assert film.read_bytes()[:3] == b"GIF"
    in_space = pressed(cube(ElementHex1, RUBBER, n=1), 0.0, 0.1).run([1.0]).results[-1]
    with pytest.raises(InputError, match="to_pyvista"):
        in_space.plot()


def test_a_step_too_large_is_halved_and_the_log_says_so(caplog):
    caplog.set_level(logging.INFO, "contact")
    stepper = pressed(cube(ElementQuad1, RUBBER, n=3), 0.0, 0.6)
    result = stepper.run([1.0]).results[-1]
    small = pressed(cube(ElementQuad1, RUBBER, n=3), 0.0, 0.6).run(np.linspace(0.1, 1, 10))
    assert np.abs(result.u - small.results[-1].u).max() <= 1e-7
    assert "too much for one step; halved, by way of t = 0.5" in caplog.text


def test_what_cannot_be_reached_is_said():
    stepper = pressed(cube(ElementQuad1, RUBBER), 0.0, 1.2)
    stepper.halvings = 2
    with pytest.raises(NotConverged, match="large strain"):
        stepper.run([1.0])


def body(**more):
    mesh = MeshQuad().refined(1).with_defaults()
    return NonlinearBody.from_mesh(mesh, ElementQuad1(), **({"stress": RUBBER} | more)).fix("top")


def problem(of=None, obstacle=FLOOR[2], **more):
    return ContactProblem(of or body(), "bottom", obstacle, **more)


@LinearForm
def work(v, w):
    return ddot(w["u"].grad, grad(v))


def two_bodies(**more):
    lower = body()
    mesh = MeshQuad().refined(1).translated((0.0, 1.0)).with_defaults()
    upper = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("top")
    pair = Pair(upper.named("upper"), "bottom", lower, "top", **more)
    return NonlinearStepper(ContactProblem([upper, lower], [pair]))


def turned_linear_body():
    return two_bodies().move("top", "x", lambda x: 0.3 * x[0], body="upper").run([1.0])


BAD = {
    "stress: expected a function": lambda: body(stress=3.0),
    "plane='stress'": lambda: NonlinearBody.from_forms(MeshQuad(), internal=work, plane="stress"),
    "dilatation='mean': plane": lambda: body(plane="stress", dilatation="mean"),
    "volume change of ElementTriP1": lambda: NonlinearBody.from_mesh(
        MeshQuad().to_meshtri(), ElementTriP1(), stress=RUBBER, dilatation="mean"
    ),
    "dilatation='none'": lambda: body(dilatation="none"),
    "'dt' is no name": lambda: body(state={"dt": 0.0}),
    "holds values that are not finite": lambda: body(state={"a": np.nan}),
    "internal: expected a LinearForm": lambda: NonlinearBody.from_forms(
        MeshQuad(), internal=work.form
    ),
    "update: a function": lambda: NonlinearBody.from_forms(
        MeshQuad(), internal=work, state={"a": 0.0}
    ),
    "tangent: expected a BilinearForm": lambda: NonlinearBody.from_forms(
        MeshQuad(), internal=work, tangent=work
    ),
    "heat: thermal strains": lambda: body().heat(1.0, 1e-5),
    "has no stiffness of its own": lambda: problem().solve(),
    "it has no NonlinearBody": lambda: NonlinearStepper(
        problem(ElasticBody.from_mesh(MeshQuad().with_defaults(), E=1.0, nu=0.3))
    ),
    "expected a ContactProblem": lambda: NonlinearStepper(body()),
    "says the gap at undeformed points": lambda: NonlinearStepper(problem(obstacle=0.0)),
    "a Rigid moves by small": lambda: NonlinearStepper(problem(obstacle=Rigid(FLOOR[2], (0, 0.1)))),
    "Coulomb's law or none": lambda: NonlinearStepper(problem(friction=0.1, law="tresca")),
    "and hard contact": lambda: NonlinearStepper(problem(overclosure=1.0)),
    "functional: in large": lambda: NonlinearStepper(problem(functional="nodal")),
    "E: a NonlinearBody's material": lambda: setattr(body(), "E", 2.0),
    "too large for small strains": turned_linear_body,
    "clearance: in large": lambda: two_bodies(clearance=0.1),
    "tol=": lambda: NonlinearStepper(problem(), tol=0.1),
    "time=": lambda: NonlinearStepper(problem()).step(0.0),
    "expected P of the shape": lambda: NonlinearStepper(
        problem(body(stress=lambda F: F[:2, :2]))
    ).run([1.0]),
    "gives NaN or infinity": lambda: NonlinearStepper(
        problem(body(stress=lambda F: np.nan * F))
    ).run([1.0]),
    "expected arrays named": lambda: NonlinearStepper(
        problem(
            body(
                stress=lambda F, state, dt: (0.1 * (F - np.eye(3)[..., None, None]), {}),
                state={"a": 0.0},
            )
        )
    ).run([1.0]),
    "mu=": lambda: NeoHooke(-1.0, 1.0),
    "nu=": lambda: Plasticity(1.0, 0.5, 1.0),
    "hardening=": lambda: METAL.__class__(1.0, 0.3, 1.0, -1.0),
    "g=": lambda: Viscous(RUBBER, 1.0, 1.0),
    "law=": lambda: Viscous(METAL, 0.5, 1.0),
    "forms do not say": lambda: NonlinearBody.from_forms(MeshQuad(), internal=work).cauchy_stress(
        np.zeros(18), {}
    ),
    "body: a NonlinearBody has no stiffness": lambda: LoadStepper(problem()).run([1.0]),
}


@pytest.mark.parametrize("said", BAD)
def test_bad_input(said):
    with pytest.raises(InputError) as error:
        BAD[said]()
    assert said in str(error.value)


def test_a_body_that_nothing_holds_is_named():
    mesh = MeshQuad().refined(1).with_defaults()
    loose = NonlinearBody.from_mesh(mesh, ElementQuad1(), stress=RUBBER)
    stepper = NonlinearStepper(ContactProblem(loose, "bottom", FAR[2]), halvings=0)
    with pytest.raises(NotConverged, match="not held"):
        stepper.load("top", (0.0, -0.1)).run([1.0])


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuadBFS])
def test_elements_with_derivatives_take_part(element):
    forces = []
    for one, n in ((element, 6), (ElementQuad2, 12)):
        block = cube(one, RUBBER, n=n).fix(["left", "right"], "x").fix("top", "y")
        problem = ContactProblem(block, "bottom", Cylinder((0.4, -2.0), 2.0))
        result = NonlinearStepper(problem).move("top", "y", -0.1).run([0.5, 1.0]).results[-1]
        forces.append(result.resultant)
        assert result.gap.min() >= -1e-9
    assert np.abs(forces[0] - forces[1]).max() <= 0.003 * forces[1][1]
