"""A saved result comes back bit for bit, problem included, or not at all."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementTetP1, ElementTriP2, MeshTri

from contact import ContactProblem, ContactResult, ElasticBody, InputError
from skfem_adini import ElementQuadAdini


def dome_result(make, element):
    return make.dome(element).solve()


def layered(make):
    """A material of each cell, a prescribed displacement, facets without a name."""
    mesh = MeshTri.init_circle(2)
    mesh = mesh.with_boundaries({"top": lambda x: x[1] > 0.5})
    rng = np.random.default_rng(0)
    body = ElasticBody.from_mesh(
        mesh, ElementTriP2(), E=rng.uniform(1, 2, mesh.nelements), nu=0.2, plane="stress"
    )
    body.fix("top", "y", -0.05).fix("top", "x")
    below = mesh.facets_satisfying(lambda x: x[1] < -0.3, boundaries_only=True)
    return ContactProblem(body, below, lambda x: 1.0 + x[1], 0.2).solve()


RESULTS = {
    "Adini": lambda make: make.solved()[1],
    "Adini-gauss-tresca": lambda make: make.solved(law="tresca", friction=0.05, functional="gauss")[
        1
    ],
    "TriP2": lambda make: make.solved(element=ElementTriP2, friction=0.4)[1],
    "layered-disk": layered,
    "held-by-contact": lambda make: make.solved(friction=0.0, sides=("left",))[1],
    "Hex1": lambda make: dome_result(make, ElementHex1),
    "TetP1": lambda make: dome_result(make, ElementTetP1),
    "no-obstacle": lambda make: ContactProblem(
        make.block(6), "bottom", None, 0.03, "tresca"
    ).solve(),
}


# The disk has few facets, and the warning of their sagitta is right.
@pytest.mark.sampled(3)
@pytest.mark.filterwarnings("ignore:the pressures are")
@pytest.mark.parametrize("name", RESULTS)
def test_round_trip(name, tmp_path, make):
    result = RESULTS[name](make)
    loaded = ContactResult.load(result.save(tmp_path / "result.npz"))
    for field in ("u", "mu", "t", "x", "x_nominal", "pressure", "shear", "gap", "status", "slip"):
        assert np.array_equal(getattr(loaded, field), getattr(result, field)), field
    assert np.array_equal(loaded.zone, result.zone, equal_nan=True)
    assert loaded.kkt == result.kkt
    assert loaded.method == result.method
    # NaN in the history is not equal to itself.
    assert repr(loaded.history) == repr(result.history)
    for field in ("load", "friction"):
        assert np.array_equal(getattr(loaded.system, field), getattr(result.system, field))
    assert loaded.system.law == result.system.law
    assert loaded.system.rows.functional == result.system.rows.functional
    points = result.system.body.mesh.p[:, result.system.body.mesh.t].mean(axis=1)
    assert np.array_equal(loaded.sample(points), result.sample(points))
    assert np.array_equal(loaded.stress(points), result.stress(points))
    assert np.array_equal(loaded.von_mises(), result.von_mises())
    assert np.array_equal(loaded.balance()["residual"], result.balance()["residual"])


def test_names_of_boundaries_survive(tmp_path, make):
    _, result = make.solved()
    loaded = ContactResult.load(result.save(tmp_path / "result.npz"))
    assert set(loaded.system.body.mesh.boundaries) == set(result.system.body.mesh.boundaries)
    for name, facets in result.system.body.mesh.boundaries.items():
        assert np.array_equal(loaded.system.body.facets(name), np.unique(facets))


def test_loaded_result_starts_a_solve(tmp_path, make):
    problem, result = make.solved()
    loaded = ContactResult.load(result.save(tmp_path / "result.npz"))
    again = problem.solve(start=loaded)
    # Rounding times the condition of the body's stiffness.
    assert np.abs(again.u - result.u).max() < 1e-11 * np.abs(result.u).max()


def test_suffix_is_added(tmp_path, make):
    _, result = make.solved()
    path = result.save(tmp_path / "step.1")
    assert path.name == "step.1.npz"
    assert ContactResult.load(path).contact_force == result.contact_force
    assert [p.name for p in tmp_path.iterdir()] == ["step.1.npz"]  # nothing temporary is left


def test_overwriting_is_atomic(tmp_path, make, monkeypatch):
    """A write that fails leaves the old file, and nothing else."""
    _, result = make.solved()
    path = result.save(tmp_path / "result.npz")
    before = path.read_bytes()

    def fail(*args, **arrays):
        args[0].write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="disk full"):
        result.save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.999])
def test_truncated_file(share, tmp_path, make):
    path = make.solved()[1].save(tmp_path / "result.npz")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"result\.npz"):
        ContactResult.load(path)


@pytest.mark.parametrize("place", np.linspace(0.05, 0.9, 8))
def test_damaged_file(place, tmp_path, make):
    """A flipped byte is seen by the archive's checksums, or was no data."""
    _, result = make.solved()
    path = result.save(tmp_path / "result.npz")
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 0xFF
    path.write_bytes(content)
    try:
        loaded = ContactResult.load(path)
    except InputError:
        return
    assert np.array_equal(loaded.u, result.u)
    assert loaded.kkt == result.kkt


def foreign(path):
    np.savez(path, x=np.zeros(3))


def other_format(path):
    np.savez(path, about=np.array('{"format": 99}'))


def no_json(path):
    np.savez(path, about=np.array("hello"))


def missing_arrays(path):
    np.savez(path, about=np.array('{"format": 1}'))


@pytest.mark.parametrize("write", [foreign, other_format, no_json, missing_arrays])
def test_foreign_archive(write, tmp_path):
    write(tmp_path / "other.npz")
    with pytest.raises(InputError, match=r"other\.npz"):
        ContactResult.load(tmp_path / "other.npz")


def test_element_that_cannot_be_built_again(tmp_path, make):
    class ElementMine(ElementQuadAdini):
        pass

    _, result = make.solved(n=4)
    mesh = result.system.body.mesh
    body = ElasticBody.from_mesh(mesh, ElementMine(), E=1.0, nu=0.3)
    from dataclasses import replace

    mine = replace(result, system=replace(result.system, body=body))
    with pytest.raises(InputError, match="ElementMine"):
        mine.save(tmp_path / "result.npz")
    assert not list(tmp_path.iterdir())
