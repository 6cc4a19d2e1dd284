"""Results of contact on a grid are saved and loaded: equal bits, and no edited file is believed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from skfem import ElementQuad1

from contact import (
    ContactProblem,
    ContactResult,
    ElasticBody,
    GridContact,
    GridResult,
    HalfSpace,
    InputError,
    PeriodicLayers,
    Rigid,
)
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from skfem_adini.ground.archives import read_arrays, write_arrays

FIELDS = ("pressure", "shear", "u", "opening", "slip", "status", "motion", "forces")
TWO = [(0.2, 3, 1.0, 0.3), (0.3, 2, 5.0, 0.2)]


def layers(width, cells, **settings):
    return lambda unit, xp=np: PeriodicLayers(
        np.multiply(width, unit).tolist(),
        [(h * unit, n, E, nu) for h, n, E, nu in TWO],
        cells,
        xp=xp,
        **settings,
    )


BODIES = {
    "half plane": lambda unit, xp=np: HalfSpace(1.3 * unit, 48, 2.0, 0.3, xp=xp),
    "half plane above": lambda unit, xp=np: HalfSpace(1.3, 48, 2.0, 0.3, normal=(0, 2), xp=xp),
    "half space": lambda unit, xp=np: HalfSpace((unit, 0.7 * unit), (12, 10), 2.0, 0.3, xp=xp),
    "layers": layers(1.0, 24),
    "plane stress": layers(1.0, 24, plane="stress", top="y"),
    "rollers": layers(1.0, 24, sides="x"),
    "held sides": layers(1.0, 24, sides="y"),
    "on a half plane": layers(1.0, 24, base=(3.0, 0.25)),
    "Adini": layers(1.0, 24, element=ElementQuadAdini(), interfaces="kinked"),
    "BFS": layers(1.0, 24, element=ElementQuadBFS()),
    "bricks": layers((1.0, 0.7), (8, 6), sides=("periodic", "y")),
    "moved top": layers((1.0, 0.7), (8, 6), motion=(0.0, 0.001, -0.002)),
    "Adini bricks": layers((1.0, 0.7), (6, 6), element=ElementHexAdini()),
}
LAWS = {"frictionless": (0.0, "coulomb"), "coulomb": (0.3, "coulomb"), "tresca": (2e-3, "tresca")}


def contact(body, law="coulomb", unit=1.0, xp=np):
    """A wave pressed into the body by a motion, or where nothing holds it by a force."""
    compliance = BODIES[body](unit, xp)
    shape, dim = compliance.shape, len(compliance.shape) + 1
    axes = [np.arange(m) / m for m in shape]
    wave = sum(-np.cos(2 * np.pi * x) for x in np.meshgrid(*axes, indexing="ij"))
    gap, up = 2e-3 * unit * (dim - 1 - wave), -float(np.asarray(compliance.normal)[-1])
    driven = np.array(compliance.constant)
    # Nothing holds the mean displacement there.
    driven[-1] |= isinstance(compliance, HalfSpace) or compliance.base is not None
    motion, force = [2e-3 * unit] + [0.0] * (dim - 1), [None] * dim
    motion[-1] = 3e-3 * unit * up
    for i in np.flatnonzero(driven):
        motion[i], force[i] = None, 0.0
    if driven[-1]:
        force[-1] = 1e-3 * unit ** (dim - 1) * up
    if driven[0] and law == "coulomb":
        force[0] = 1e-4 * unit ** (dim - 1)
    friction = LAWS[law][0] * (1 + 0.1 * np.arange(np.prod(shape)).reshape(shape) / np.prod(shape))
    return GridContact(compliance, Rigid(gap, motion, force), friction, LAWS[law][1])


@pytest.mark.sampled(8)
@pytest.mark.parametrize(
    ("body", "law", "unit"),
    [
        *((body, law, 1.0) for body in BODIES for law in LAWS),
        ("layers", "coulomb", 1e-9),
        ("layers", "coulomb", 1e6),
    ],
)
def test_what_is_loaded_is_what_was_saved(body, law, unit, tmp_path):
    result = contact(body, law, unit).solve()
    path = result.save(tmp_path / "step.1")
    assert path.name == "step.1.npz"
    again = GridResult.load(path)
    assert again.pressure.max() > 0
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    assert again.kkt == result.kkt
    assert list(map(str, again.history)) == list(map(str, result.history))
    assert again.area == result.area
    np.testing.assert_array_equal(again.resultant, result.resultant)
    if hasattr(result.compliance, "layers"):
        dim = len(again.compliance.shape) + 1
        inside = np.tile(np.linspace(0.1, 0.4, 5), (dim, 1)) * unit
        np.testing.assert_array_equal(again.sample(inside), result.sample(inside))
        np.testing.assert_array_equal(again.stress(inside), result.stress(inside))
    twice = GridResult.load(again.save(tmp_path / "twice"))
    np.testing.assert_array_equal(twice.pressure, result.pressure)


def dragged_on(problem):
    """The same with the obstacle further along its way."""
    rigid = problem.obstacle
    ahead = [None if v is None else 1.3 * v for v in rigid.displacement]
    more = [None if v is None else 1.2 * v for v in rigid.force]
    return replace(problem, obstacle=Rigid(rigid.obstacle, ahead, more))


def edited(path, change, words=None):
    """The file with one array changed, or a word, and a checksum that is right again."""
    arrays, _ = read_arrays(path)
    about = json.loads(str(arrays["about"]))
    (words or (lambda about: None))(about)
    arrays["about"] = np.array(json.dumps(about))
    change(arrays)
    return write_arrays(path.with_name("edited.npz"), arrays)


def times(name, factor):
    def change(arrays):
        arrays[name] = arrays[name] * factor

    return change


@pytest.mark.parametrize("body", ["half space", "rollers", "Adini"])
def test_an_edited_number_is_not_believed(body, tmp_path):
    problem = contact(body)
    path = dragged_on(problem).solve(after=problem.solve()).save(tmp_path / "result")
    GridResult.load(edited(path, lambda arrays: None))
    arrays, _ = read_arrays(path)
    names = ["gap", "friction", "motion", "force", "forces", "a", "slip_from"]
    names = [name for name in names if np.any(np.nan_to_num(arrays[name]))]
    assert len(names) >= 5
    for name in names:
        with pytest.raises(InputError, match="does not solve the problem beside it"):
            GridResult.load(edited(path, times(name, 1.01)))


@pytest.mark.parametrize(
    ("body", "edits"),
    [
        ("half space", {"E": 2.1, "nu": 0.2, "lengths": [1.1, 0.7]}),
        (
            "layers",
            {"layers": [[0.2, 3, 1.1, 0.3], [0.3, 2, 5.0, 0.2]], "element": "ElementQuadBFS"},
        ),
        ("rollers", {"sides": "y"}),
        ("Adini", {"interfaces": "smooth"}),
        ("on a half plane", {"base": [4.0, 0.25]}),
        ("plane stress", {"plane": "strain"}),
        ("moved top", {"motion": [0.0, 0.001, -0.003]}),
    ],
)
def test_an_edited_body_is_not_believed(body, edits, tmp_path):
    path = contact(body).solve().save(tmp_path / "result")
    for name, value in edits.items():

        def change(about, name=name, value=value):
            assert about["compliance"][name] != value
            about["compliance"][name] = value

        with pytest.raises(InputError, match="does not solve the problem beside it"):
            GridResult.load(edited(path, lambda arrays: None, change))


def shorter(arrays):
    arrays["gap"] = arrays["gap"][1:]


def spoiled(name, value):
    def change(arrays):
        arrays[name] = arrays[name].copy()
        arrays[name].flat[0] = value

    return change


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    return contact("half plane above").solve().save(tmp_path_factory.mktemp("grids") / "result")


@pytest.mark.parametrize(
    ("change", "words", "message"),
    [
        (shorter, None, "gap: expected shape"),
        (spoiled("forces", np.nan), None, "forces: holds numbers that are not finite"),
        (spoiled("friction", np.inf), None, "friction: holds numbers that are not finite"),
        (spoiled("friction", -0.1), None, "a negative coefficient"),
        (spoiled("gap", np.nan), None, "hold NaN"),
        (spoiled("motion", np.nan), None, "one of the two must be NaN"),
        (lambda arrays: arrays.pop("forces"), None, "cannot be read"),
        (None, lambda about: about.update(format=7), "it has format 7"),
        (None, lambda about: about.update(tol=2.0), "tolerance 2.0"),
        (None, lambda about: about.update(law="glue"), "law 'glue'"),
        (None, lambda about: about.pop("kind"), "it holds no GridResult"),
        (None, lambda about: about["compliance"].update(E=-1.0), "E=-1.0: expected a positive"),
        (
            None,
            lambda about: about["compliance"].update({"class": "Sponge"}),
            "expected HalfSpace or PeriodicLayers",
        ),
    ],
)
def test_files_that_contradict_themselves(change, words, message, stored):
    with pytest.raises(InputError, match=message):
        GridResult.load(edited(stored, change or (lambda arrays: None), words))


def test_damaged_and_missing_files_and_those_of_the_other_kind(make, tmp_path):
    result = contact("layers").solve()
    path = result.save(tmp_path / "result")
    with pytest.raises(InputError, match=r"a GridResult; GridResult\.load"):
        ContactResult.load(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError, match="cannot be read"):
        GridResult.load(path)
    with pytest.raises(InputError, match="does not exist"):
        GridResult.load(tmp_path / "nothing")
    with pytest.raises(InputError, match="an archive of NumPy"):
        result.save(tmp_path / "result.vtu")
    mesh = make.box(ElementQuad1, *[np.linspace(0, 1, 4)] * 2)
    body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("top", value=-0.01)
    of_body = ContactProblem(body, "bottom", 0.0).solve().save(tmp_path / "body")
    with pytest.raises(InputError, match=r"no GridResult; ContactResult\.load"):
        GridResult.load(of_body)


def test_what_no_file_holds(tmp_path):
    class Stiffer(HalfSpace):
        def apply(self, forces):
            return 0.5 * super().apply(forces)

    problem = contact("half plane above")
    own = replace(problem, compliance=Stiffer(1.3, 48, 2.0, 0.3, normal=(0, 2)))
    with pytest.raises(InputError, match="a compliance of Stiffer cannot be saved"):
        own.solve().save(tmp_path / "own")

    class Bilinear(ElementQuad1):
        pass

    block = PeriodicLayers(1.0, TWO, 24, element=Bilinear())
    with pytest.raises(InputError, match="Bilinear cannot be saved"):
        replace(contact("layers"), compliance=block).solve().save(tmp_path / "own")
    assert not list(tmp_path.iterdir())


@pytest.mark.gpu
@pytest.mark.parametrize("body", ["half space", "bricks", "Adini"])
def test_files_are_exchanged_with_a_device(body, tmp_path):
    cupy = pytest.importorskip("cupy")
    there = contact(body, xp=cupy).solve()
    here = GridResult.load(there.save(tmp_path / "there"))
    again = GridResult.load(here.save(tmp_path / "here"), xp=cupy)
    size = there.pressure.max()
    for one in (here, again):
        assert np.abs(one.pressure - there.pressure).max() <= 1e-12 * size
        assert np.abs(one.u - there.u).max() <= 1e-12 * np.abs(there.u).max()
    assert isinstance(again.compliance.initial, cupy.ndarray)
