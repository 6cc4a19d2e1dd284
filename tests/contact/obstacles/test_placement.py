"""Obstacles that cannot be meant where they are: refused, or warned of with a remedy."""

import warnings

import numpy as np
import pytest
from skfem import ElementHex1, MeshQuad, MeshTri, MeshTri2

from contact import (
    ClosestPoint,
    ContactProblem,
    ContactWarning,
    Cylinder,
    ElasticBody,
    InputError,
    LayeredBlock,
    LoadStepper,
    Parabola,
    Plane,
    Rigid,
    SignedDistance,
    Sphere,
)


def square():
    mesh = MeshQuad().refined(2).with_defaults()
    return ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("top", "xy")


def shaft():
    """A disk with curved sides."""
    mesh = MeshTri2.init_circle(3)
    mesh = mesh.with_boundaries({"rim": mesh.boundary_facets()})
    return ElasticBody.from_mesh(mesh, E=1.0, nu=0.3)


def ring():
    mesh = MeshTri.init_tensor(np.linspace(1, 2, 5), np.linspace(0, 2, 9)).with_defaults()
    r, angle = mesh.p
    bent = MeshTri(np.array([r * np.cos(angle), r * np.sin(angle)]), mesh.t)
    bent = bent.with_boundaries({"rim": mesh.boundaries["left"]})
    return ElasticBody.from_mesh(bent, E=1.0, nu=0.3)


BODIES = {
    "plane": lambda make: square(),
    "layers": lambda make: LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)], top="xy"),
    "space": lambda make: make.dome(ElementHex1, 2).body,
}


@pytest.mark.parametrize("wrap", [lambda o: o, ClosestPoint, lambda o: Rigid(o, force=None)])
@pytest.mark.parametrize("name", BODIES)
def test_plane_with_its_normal_the_wrong_way(name, wrap, make):
    """The message holds the normal that is right; with it the body touches."""
    body = BODIES[name](make)
    down = np.zeros(body.dim)
    down[-1] = -2.0
    with pytest.raises(InputError, match="faces the plane") as caught:
        ContactProblem(body, "bottom", wrap(Plane(-0.01 * np.abs(down), down)))
    right = tuple((0.0 - down).tolist())
    assert f"towards the body: normal={right}" in str(caught.value)
    ContactProblem(body, "bottom", wrap(Plane(0.005 * down, -down)))


def test_one_plane_of_several_and_one_turned_in_a_load_history():
    planes = [Plane((0, -0.1), (0, 1)), Plane((1.1, 0), (1, 0))]
    with pytest.raises(InputError, match=r"normal=\(-1"):
        ContactProblem(square(), ["bottom", "right"], planes)
    stepper = LoadStepper(ContactProblem(square(), "bottom", Plane((0, 0), (0, 1))))
    stepper.obstacle(lambda t: Plane((0, 0), (0, 1 - 2 * t)))
    stepper.run([0.1])
    with pytest.raises(InputError, match="faces the plane"):
        stepper.run([1.0])


def disk(centre, radius):
    return SignedDistance(lambda x: np.hypot(x[0] - centre[0], x[1] - centre[1]) - radius)


FAR, OVER, WITHIN = "nothing can touch", "overlaps it by more than 1", "its surface from within"
WARNED = [
    (square, Cylinder((5.0, -2.0), 1.0), FAR),
    (square, Sphere((5.0, -2.0), 1.0), FAR),
    (square, Cylinder((0.5, 3.0), 1.0), FAR),  # behind
    (square, Cylinder((9.0, 0.0), 2.0, hollow=True), FAR),  # a bore around another place
    (square, disk((5.0, -2.0), 1.0), FAR),
    (square, SignedDistance(lambda x: x[1] + 2, reach=1.0), FAR),
    (square, lambda x: np.full(x.shape[1:], np.inf), FAR),
    (square, -2.0, OVER),
    (square, lambda x: -2 - x[0], OVER),
    (square, Plane((0, 2), (0, 1)), OVER),
    (square, Parabola((0.5, 0), 1.0, offset=-3.0), OVER),
    (ring, Cylinder((0, 0), 0.9, hollow=True), "hollow=False"),
    (shaft, Cylinder((0.0, 0.0), 1.02), r"Cylinder\(\.\.\., hollow=True\)"),
    *(
        (shaft, wrap(kind((0.0, 0.0), radius)), WITHIN)
        for radius in (1.0 + 1e-6, 1.01, 1.5)
        for kind in (Cylinder, Sphere, disk)
        for wrap in (lambda o: o, ClosestPoint)
    ),
]


@pytest.mark.parametrize(("body", "obstacle", "words"), WARNED)
def test_warned_of(body, obstacle, words):
    with pytest.warns(ContactWarning, match=words) as caught:
        problem = ContactProblem(body(), "bottom" if body is square else "rim", obstacle)
    assert caught[0].filename == __file__
    if words is FAR:
        assert problem.solve().contact_force == 0.0


MEANT = {
    "above": Plane((0, -0.1), (0.3, 1)),
    "overlap": Plane((0, 0.3), (0, 1)),
    "roller beside": Cylinder((1.2, -0.5), 0.5),
    "roller overlapping": Cylinder((0.5, -0.8), 1.1),
    "far below": Cylinder((0.5, -50.0), 1.0),
    "closest, beside": ClosestPoint(Cylinder((3.0, -0.5), 0.5)),
    "number": np.inf,
}


@pytest.mark.parametrize("name", MEANT)
def test_no_warning_where_it_may_be_meant(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ContactProblem(square(), "bottom", MEANT[name])
        ContactProblem(square(), ["bottom", "right"], MEANT[name])
        bore = Cylinder((0.0, 0.0), 0.99, hollow=True)
        if name == "above":
            assert ContactProblem(shaft(), "rim", bore, friction=0.1).solve().pressure.min() > 0
