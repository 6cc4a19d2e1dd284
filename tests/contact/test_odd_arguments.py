"""Anything may be passed to anything: it is taken as a number is, or refused by an InputError."""

from contextlib import suppress

import numpy as np
import pytest
from families import half_disk
from skfem import ElementQuad1, MeshQuad

from contact import (
    ClosestPoint,
    ContactError,
    ContactProblem,
    Cylinder,
    DynamicStepper,
    ElasticBody,
    InputError,
    LayeredBlock,
    LoadStepper,
    Parabola,
    Plane,
    Rigid,
    SignedDistance,
    Sphere,
    SurfaceMesh,
    uniqueness,
)

# Warnings of what is odd but possible are another test's matter.
pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
MESH = MeshQuad().refined(1).with_defaults()


class Odd:
    """No number, no sequence, no function."""


ODD = {
    "None": None,
    "NaN": np.nan,
    "infinity": np.inf,
    "negative": -1,
    "zero": 0,
    "nine tenths": 0.9,
    "huge": 10**30,
    "complex": 1j,
    "word": "abc",
    "no word": "",
    "bytes": b"x",
    "empty list": [],
    "dict": {},
    "set": {1},
    "object": Odd(),
    "class": Odd,
    "True": True,
    "three": [1, 2, 3],
    "ragged": [[1], [2, 3]],
    "None inside": [None],
    "array": np.zeros((2, 3)),
    "words": np.array(["a"]),
    "NaNs": np.array([np.nan, 1.0]),
    "complex array": np.array([1j, 2]),
    "objects": np.array([None, 1], dtype=object),
    "masked": np.ma.masked_array([1.0, 2.0], [0, 1]),
    "date": np.datetime64("2020-01-01"),
    "function of nothing": lambda: 0.0,
    "function of two": lambda x, y: x,
    "function to None": lambda x: None,
    "function to words": lambda x: "x",
    "function to complex": lambda x: 1j * x,
    "function to NaN": lambda x: np.nan * x,
    "mesh": MESH,
}


def body():
    made = ElasticBody.from_mesh(MESH, ElementQuad1(), E=1.0, nu=0.3)
    return made.fix("top", "xy").load("right", (0.0, -0.01))


def contact(obstacle=0.0, boundary="bottom", **options):
    return ContactProblem(body(), boundary, obstacle, **options)


def layers(lengths=1.0, layer=(1.0, 2, 1.0, 0.3), **options):
    return LayeredBlock(lengths, [layer], **options)


@pytest.fixture(scope="module")
def solved():
    problem = contact(friction=0.3)
    return problem, problem.solve(), half_disk((7, 4))


# name: what is called with the odd value and (problem, result, cut body)
CALLS = {
    "facets": lambda v, s: body().facets(v),
    "fix boundary": lambda v, s: body().fix(v, "x").constraint,
    "fix components": lambda v, s: body().fix("left", v),
    "fix value": lambda v, s: body().fix("bottom", "y", v).constraint,
    "fix value, layers": lambda v, s: layers().fix("left", "x", v).prescribed,
    "load boundary": lambda v, s: body().load(v, (0, 1)),
    "load traction": lambda v, s: body().load("right", v),
    "load traction, layers": lambda v, s: layers().load("top", v),
    "load traction, cut": lambda v, s: s[2].load(s[2].arc(), v),
    "body_force": lambda v, s: body().body_force(v),
    "body_force, layers": lambda v, s: layers().body_force(v),
    "from_mesh mesh": lambda v, s: ElasticBody.from_mesh(v, E=1.0, nu=0.3),
    "from_mesh element": lambda v, s: ElasticBody.from_mesh(MESH, v, E=1.0, nu=0.3),
    "E": lambda v, s: ElasticBody.from_mesh(MESH, E=v, nu=0.3),
    "nu": lambda v, s: ElasticBody.from_mesh(MESH, E=1.0, nu=v),
    "plane": lambda v, s: ElasticBody.from_mesh(MESH, E=1.0, nu=0.3, plane=v),
    "dilatation": lambda v, s: ElasticBody.from_mesh(MESH, E=1.0, nu=0.3, dilatation=v),
    "basis": lambda v, s: ElasticBody(v, 1.0, 0.3),
    "f": lambda v, s: setattr(body(), "f", v),
    "problem body": lambda v, s: ContactProblem(v, "bottom", 0.0),
    "problem boundary": lambda v, s: contact(boundary=v),
    "problem boundary, layers": lambda v, s: ContactProblem(layers(), v, 0.0),
    "problem obstacle": lambda v, s: contact(v),
    "problem obstacles": lambda v, s: contact([0.0, v], ["bottom", "left"]),
    "problem friction": lambda v, s: contact(friction=v),
    "problem frictions": lambda v, s: contact([0.0, 0.1], ["bottom", "left"], friction=v),
    "problem law": lambda v, s: contact(friction=0.3, law=v),
    "problem functional": lambda v, s: contact(functional=v),
    "problem solver": lambda v, s: contact(solver=v).condense(),
    "condense device": lambda v, s: s[0].condense(v),
    "solve method": lambda v, s: s[0].solve(v),
    "solve tol": lambda v, s: s[0].solve(tol=v),
    "solve max_iterations": lambda v, s: s[0].solve(max_iterations=v),
    "solve start": lambda v, s: s[0].solve(start=v),
    "solve after": lambda v, s: s[0].solve(after=v),
    "solve eps": lambda v, s: s[0].solve("fixed_point", tol=1e-2, eps=v),
    "plane point": lambda v, s: contact(Plane(v, (0, 1))),
    "plane normal": lambda v, s: contact(Plane((0, 0), v)),
    "cylinder centre": lambda v, s: contact(Cylinder(v, 1.0)),
    "cylinder radius": lambda v, s: contact(Cylinder((0.5, -2), v)),
    "ball radius": lambda v, s: contact(Sphere((0.5, -2), v)),
    "parabola radius": lambda v, s: contact(Parabola((0.5, 0), v)),
    "parabola offset": lambda v, s: contact(Parabola((0.5, 0), 1.0, v)),
    "distance function": lambda v, s: contact(SignedDistance(v)),
    "distance reach": lambda v, s: contact(SignedDistance(lambda x: x[1] + 1, v)),
    "surface points": lambda v, s: contact(SurfaceMesh(v, [[0, 1, 2], [1, 2, 0]])),
    "surface facets": lambda v, s: contact(SurfaceMesh([[0, -1, 1], [-1, -3, -3]], v)),
    "surface file": lambda v, s: contact(SurfaceMesh.from_file(v)),
    "surface scale": lambda v, s: contact(SurfaceMesh.from_file("no.stl", v)),
    "closest point": lambda v, s: contact(ClosestPoint(v)),
    "rigid obstacle": lambda v, s: contact(Rigid(v)),
    "rigid displacement": lambda v, s: contact(Rigid(0.0, displacement=v)),
    "rigid force": lambda v, s: contact(Rigid(0.0, force=v)),
    "rigid rotation": lambda v, s: contact(Rigid(0.0, rotation=v)),
    "rigid moment": lambda v, s: contact(Rigid(0.0, moment=v)),
    "rigid centre": lambda v, s: contact(Rigid(0.0, centre=v)),
    "stepper problem": lambda v, s: LoadStepper(v),
    "stepper method": lambda v, s: LoadStepper(s[0], method=v),
    "stepper tol": lambda v, s: LoadStepper(s[0], tol=v),
    "stepper max_iterations": lambda v, s: LoadStepper(s[0], max_iterations=v),
    "stepper halvings": lambda v, s: LoadStepper(s[0], halvings=v),
    "stepper load": lambda v, s: LoadStepper(s[0]).load("right", v),
    "stepper vector": lambda v, s: LoadStepper(s[0]).load_vector(v),
    "stepper move boundary": lambda v, s: LoadStepper(s[0]).move(v, "x"),
    "stepper move components": lambda v, s: LoadStepper(s[0]).move("top", v),
    "stepper move value": lambda v, s: LoadStepper(s[0]).move("top", "x", v),
    "stepper run": lambda v, s: LoadStepper(s[0]).run(v),
    "stepper step": lambda v, s: LoadStepper(s[0]).step(v),
    "dynamic density": lambda v, s: DynamicStepper(s[0], v, 0.1),
    "dynamic dt": lambda v, s: DynamicStepper(s[0], 1.0, v),
    "dynamic scheme": lambda v, s: DynamicStepper(s[0], 1.0, 0.1, scheme=v),
    "dynamic damping": lambda v, s: DynamicStepper(s[0], 1.0, 0.1, damping=v),
    "dynamic velocity": lambda v, s: DynamicStepper(s[0], 1.0, 0.1, velocity=v),
    "dynamic displacement": lambda v, s: DynamicStepper(s[0], 1.0, 0.1, displacement=v),
    "dynamic start": lambda v, s: DynamicStepper(s[0], 1.0, 0.1, start=v),
    "dynamic run": lambda v, s: DynamicStepper(s[0], 1.0, 0.1).run(v),
    "sample": lambda v, s: s[1].sample(v),
    "stress": lambda v, s: s[1].stress(v),
    "von_mises": lambda v, s: s[1].von_mises(v),
    "layers lengths": lambda v, s: layers(v, columns=2),
    "layers": lambda v, s: LayeredBlock(1.0, v),
    "layer height": lambda v, s: layers(1.0, (v, 2, 1.0, 0.3), columns=2),
    "layer cells": lambda v, s: layers(1.0, (1.0, v, 1.0, 0.3), columns=2),
    "layer E": lambda v, s: layers(1.0, (1.0, 2, v, 0.3)),
    "layer nu": lambda v, s: layers(1.0, (1.0, 2, 1.0, v)),
    "layers sides": lambda v, s: layers(sides=v),
    "layers sides of a pair": lambda v, s: layers(sides=("x", v)),
    "layers periodic sides": lambda v, s: layers((1.0, 1.0), cells=(2, 2), sides=("periodic", v)),
    "layers path": lambda v, s: layers(path=v),
    "layers element": lambda v, s: layers(element=v),
    "layers cells in space": lambda v, s: layers((1.0, 1.0), cells=v),
    "layers top": lambda v, s: layers(top=v),
    "layers plane": lambda v, s: layers(plane=v),
    "uniqueness problem": lambda v, s: uniqueness(v, s[1]),
    "uniqueness result": lambda v, s: uniqueness(s[0], v),
    "uniqueness seed": lambda v, s: uniqueness(s[0], s[1], starts=1, seed=v),
    "arc parts": lambda v, s: s[2].arc(v),
    "arc where": lambda v, s: s[2].arc(where=v),
    "arc spacing": lambda v, s: s[2].arc(spacing=v),
    "cut fix": lambda v, s: s[2].fix(v),
}
_TAKES_LONG = {"layer cells", "layers lengths"}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CALLS)
def test_odd_arguments(name, solved):
    """Whatever comes out is typed; what is taken is taken as it is."""
    for kind, value in ODD.items():
        if name in _TAKES_LONG and kind == "huge":
            continue
        try:
            with suppress(ContactError):
                CALLS[name](value, solved)
        except Exception as error:
            raise AssertionError(f"{name}={kind}: {type(error).__name__}: {error}") from error


NEVER = {
    "fix components": ("nine tenths", "NaN", "complex", "ragged", "masked", "date", "huge"),
    "load traction": ("complex array", "masked", "function to complex", "function of two", "NaNs"),
    "fix value": ("complex", "function to complex", "function to NaN", "function of nothing"),
    "f": ("complex", "complex array", "NaNs", "masked"),
    "E": ("complex", "masked", "NaN", "infinity", "negative", "zero"),
    "problem friction": ("complex", "function to complex", "NaN", "negative", "masked"),
    "problem obstacle": ("complex", "function to complex", "NaN", "masked", "class"),
    "condense device": ("no word", "zero", "empty list", "dict"),
    "solve tol": ("NaN", "negative", "zero", "infinity", "complex"),
    "solve max_iterations": ("NaN", "infinity", "zero", "negative", "nine tenths"),
    "stepper run": ("masked", "NaNs", "complex array", "empty list"),
    "from_mesh element": ("class", "word", "mesh"),
    "layer cells": ("nine tenths", "NaN", "negative"),
}


@pytest.mark.parametrize(("name", "kind"), [(n, k) for n, kinds in NEVER.items() for k in kinds])
def test_never_taken(name, kind, solved):
    """Nothing is truncated, no imaginary part and no mask is lost."""
    with pytest.raises(InputError):
        CALLS[name](ODD[kind], solved)


@pytest.mark.parametrize(
    "value",
    [lambda x: np.zeros(x.shape[1:], dtype=np.float32), np.float32(0), np.array(0), True - 1],
)
def test_other_numbers_are_numbers(value):
    assert contact(value, friction=value).rows.gap.dtype == np.float64
