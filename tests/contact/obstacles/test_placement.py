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


def shaft(radius=1.0):
    """A disk with curved sides."""
    mesh = MeshTri2.init_circle(3)
    mesh = type(mesh)(radius * mesh.doflocs, mesh.t)
    return ElasticBody.from_mesh(
        mesh.with_boundaries({"rim": mesh.boundary_facets()}), E=1.0, nu=0.3
    )


def cube(make):
    return make.dome(ElementHex1, 2).body


BODIES = {
    "plane": lambda make: square(),
    "layers": lambda make: LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)], top="xy"),
    "space": cube,
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


def test_plane_turned_in_a_load_history():
    stepper = LoadStepper(ContactProblem(square(), "bottom", Plane((0, 0), (0, 1))))
    stepper.obstacle(lambda t: Plane((0, 0), (0, 1 - 2 * t)))
    stepper.run([0.1])
    with pytest.raises(InputError, match="faces the plane"):
        stepper.run([1.0])


def test_one_of_several_planes_the_wrong_way():
    planes = [Plane((0, -0.1), (0, 1)), Plane((1.1, 0), (1, 0))]
    with pytest.raises(InputError, match=r"normal=\(-1"):
        ContactProblem(square(), ["bottom", "right"], planes)


AWAY = {
    "disk": Cylinder((5.0, -2.0), 1.0),
    "ball": Sphere((5.0, -2.0), 1.0),
    "disk behind": Cylinder((0.5, 3.0), 1.0),
    "bore around another place": Cylinder((9.0, 0.0), 2.0, hollow=True),
    "distance": SignedDistance(lambda x: np.hypot(x[0] - 5, x[1] + 2) - 1),
    "distance out of reach": SignedDistance(lambda x: x[1] + 2, reach=1.0),
    "callable": lambda x: np.full(x.shape[1:], np.inf),
}


@pytest.mark.parametrize("name", AWAY)
def test_obstacle_out_of_every_normal(name):
    with pytest.warns(ContactWarning, match="nothing can touch"):
        problem = ContactProblem(square(), "bottom", AWAY[name])
    assert problem.solve().contact_force == 0.0


def distance_of_a_disk(centre, radius):
    return SignedDistance(lambda x: np.hypot(x[0] - centre[0], x[1] - centre[1]) - radius)


@pytest.mark.parametrize("wrap", [lambda o: o, ClosestPoint])
@pytest.mark.parametrize("kind", [Cylinder, Sphere, distance_of_a_disk])
@pytest.mark.parametrize("radius", [1.0 + 1e-6, 1.01, 1.5])
def test_round_obstacle_used_as_a_bore(kind, radius, wrap):
    with pytest.warns(ContactWarning, match="face its surface from within"):
        ContactProblem(shaft(), "rim", wrap(kind((0.0, 0.0), radius)))


def test_the_remedy_of_a_bore_is_named_and_works():
    with pytest.warns(ContactWarning, match=r"Cylinder\(\.\.\., hollow=True\)"):
        ContactProblem(shaft(), "rim", Cylinder((0.0, 0.0), 1.02))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = ContactProblem(
            shaft(), "rim", Cylinder((0.0, 0.0), 0.99, hollow=True), friction=0.1
        ).solve()
    assert result.pressure.min() > 0


def test_hollow_obstacle_used_as_a_shaft():
    mesh = MeshTri.init_tensor(np.linspace(1, 2, 5), np.linspace(0, 2, 9)).with_defaults()
    r, angle = mesh.p
    ring = MeshTri(np.array([r * np.cos(angle), r * np.sin(angle)]), mesh.t)
    ring = ring.with_boundaries(dict(mesh.boundaries))
    body = ElasticBody.from_mesh(ring, E=1.0, nu=0.3)
    with pytest.warns(ContactWarning, match="hollow=False"):
        ContactProblem(body, "left", Cylinder((0, 0), 0.9, hollow=True))


@pytest.mark.parametrize(
    "obstacle",
    [-2.0, lambda x: -2 - x[0], Plane((0, 2), (0, 1)), Parabola((0.5, 0), 1.0, offset=-3.0)],
)
def test_overlap_beyond_the_size_of_the_body(obstacle):
    with pytest.warns(ContactWarning, match="overlaps it by more than 1"):
        ContactProblem(square(), "bottom", obstacle)


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


def test_warning_points_at_the_caller():
    with pytest.warns(ContactWarning) as caught:
        ContactProblem(square(), "bottom", Cylinder((5.0, -2.0), 1.0))
    assert caught[0].filename == __file__


def test_a_class_is_no_obstacle():
    with pytest.raises(InputError, match="is a class"):
        ContactProblem(square(), "bottom", Plane)


def test_vectors_are_kept_as_given():
    """Edited afterwards, an array does not reach an obstacle whose gaps were read."""
    normal = np.array([0.0, 1.0])
    plane = Plane([0.0, 0.0], normal)
    normal[1] = -1.0
    assert plane == Plane((0.0, 0.0), (0.0, 1.0))
