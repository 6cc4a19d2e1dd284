"""Nothing comes out of a file that does not solve the problem beside it, or was changed there."""

import io
import json
import logging
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import skfem
from skfem import Basis, ElementQuad2, ElementVector, MeshQuad

from contact import ContactProblem, ContactResult, ElasticBody, InputError
from skfem_adini import ElementQuadBFS
from skfem_adini.ground.archives import checksum


def edited(path, change, forged):
    """The archive with some arrays changed; forged: with their own checksum, or without one."""
    with np.load(path) as archive:
        arrays = dict(archive)
    written = arrays.pop("checksum", None)
    change(arrays)
    if forged is not None:
        arrays["checksum"] = np.array(checksum(arrays)) if forged else written
    np.savez(path, **arrays)


def scaled(name, factor):
    def change(arrays):
        arrays[name] = factor * arrays[name]

    return change


def said(name, key, value):
    """One word of the JSON in an archive."""

    def change(arrays):
        about = json.loads(str(arrays[name]))
        about[key] = value
        arrays[name] = np.array(json.dumps(about))

    return change


def entry(name, value, place=0):
    def change(arrays):
        array = arrays[name].copy()
        array.reshape(-1)[place] = value
        arrays[name] = array

    return change


# What residuals see, whatever the checksum says.
EQUATIONS = {
    "law tresca": said("step", "law", "tresca"),
    "law none": said("step", "law", None),
    "law unknown": said("step", "law", "mine"),
    "friction negative": scaled("friction", -1.0),
    "friction half": scaled("friction", 0.5),
    "friction NaN": entry("friction", np.nan),
    "u": scaled("u", 1.5),
    "u a little": scaled("u", 1 + 1e-7),
    "u NaN": entry("u", np.nan),
    "mu": scaled("mu", 1.01),
    "t": scaled("multiplier_t", -1.0),
    "E": scaled("E", 1.001),
    "E negative": scaled("E", -1.0),
    "nu": scaled("nu", 0.9),
    "coordinates": scaled("p", 2.0),
    "coordinate infinite": entry("p", np.inf),
    "load": scaled("load", 0.99),
    "u0": scaled("u0", 2.0),
    "gap": scaled("rows/gap", 0.9),
    "gap NaN": entry("rows/gap", np.nan),
    "plane": said("about", "plane", "stress"),
    "element": said("about", "element", "ElementQuadBFS"),
    "element unknown": said("about", "element", "Basis"),
    "element private": said("about", "element", "__builtins__"),
    "mesh": said("about", "mesh", "MeshTri1"),
    "mesh unknown": said("about", "mesh", "utils"),
    "cells": entry("t", 10**6),
    "cells negative": entry("t", -1),
    "weights negative": scaled("rows/weights", -1.0),
    "normals": scaled("rows/normals", -1.0),
    "normals long": scaled("rows/normals", 1.001),
    "tangents": scaled("rows/tangents", -1.0),
    "rows": scaled("rows/G/data", 1.0001),
    "places": scaled("rows/x", np.nan),
    "boundary": entry("boundary/0", 10**7),
    "index": entry("rows/G/indices", 10**8),
    "index negative": entry("rows/T/indices", -5),
    "index of supports": entry("constraint/indices", 2**31 - 1),
    "pointer": entry("rows/G/indptr", 10**8, 1),
    "shape": entry("rows/T/shape", 3),
    "shape huge": entry("constraint/shape", 10**12),
}
# What they do not see: names, scales of what is reported, gaps out of reach, the history.
UNSEEN = {
    "weights": scaled("rows/weights", 2.0),
    "places": scaled("rows/x", 2.0),
    "nominal places": scaled("rows/x_nominal", 2.0),
    "names": said("about", "boundaries", ["a", "b", "c", "d"]),
    "functional": said("about", "functional", "gauss"),
    "method": said("step", "method", "pdas"),
    "history": said("step", "history", []),
    "tolerance": said("step", "tol", 0.5),
}


@pytest.fixture(scope="module")
def made(make):
    """A block that slips, held and pressed by a prescribed displacement too."""
    body = make.block(4, sides=("left",)).fix("right", "y", lambda x: -0.01 - 0.01 * x[1])
    result = ContactProblem(body, "bottom", 0.01, 0.3).solve()
    assert np.any(result.status == 2)
    return result


@pytest.fixture
def path(made, tmp_path):
    return made.save(tmp_path / "result.npz")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("forged", [False, True], ids=["stale checksum", "forged checksum"])
@pytest.mark.parametrize("name", EQUATIONS)
def test_changes_that_residuals_see(name, forged, path):
    edited(path, EQUATIONS[name], forged)
    with pytest.raises(InputError, match=r"result\.npz"):
        ContactResult.load(path)


@pytest.mark.parametrize("name", UNSEEN)
def test_changes_that_residuals_do_not_see(name, path):
    edited(path, UNSEEN[name], forged=False)
    with pytest.raises(InputError, match=r"result\.npz.*changed"):
        ContactResult.load(path)


def test_what_was_found_is_said(path, caplog):
    with caplog.at_level(logging.INFO, logger="contact"):
        ContactResult.load(path)
    assert "equilibrium" in caplog.text
    edited(path, lambda arrays: None, forged=None)
    with pytest.raises(InputError, match="without a checksum"):
        ContactResult.load(path)
    edited(path, scaled("u", 1.5), forged=True)
    with pytest.raises(InputError, match=r"does not solve.*equilibrium \d"):
        ContactResult.load(path)


def test_tolerance_is_kept(make, tmp_path):
    """A result of low accuracy is certified to the accuracy that it was asked for."""
    problem = make.problem(4, friction=0.3)
    rough = problem.solve("fixed_point", tol=1e-4, eps=1e-5)
    assert max(rough.kkt.values()) > 1e-10
    loaded = ContactResult.load(rough.save(tmp_path / "rough.npz"))
    assert (loaded.tol, loaded.slack, loaded.kkt) == (1e-4, rough.slack, rough.kkt)


def test_format_before_checksums(path, made, caplog):
    """Files of version 0.1.0 load, certified, with a warning of what cannot be shown."""

    def old(arrays):
        about, step = (json.loads(str(arrays[name])) for name in ("about", "step"))
        for i, name in enumerate(about.pop("boundaries")):
            arrays[f"boundary/{name}"] = arrays.pop(f"boundary/{i}")
        for name in ("quadrature/X", "quadrature/W"):
            del arrays[name]
        del about["subdomains"], step["tol"], step["slack"]
        arrays["about"] = np.array(json.dumps(about | {"format": 2}))
        arrays["step"] = np.array(json.dumps(step))

    edited(path, old, None)
    loaded, result = ContactResult.load(path), made
    assert "without a checksum" in caplog.text
    assert loaded.kkt == result.kkt
    assert set(loaded.system.body.mesh.boundaries) == set(result.system.body.mesh.boundaries)
    edited(path, scaled("u", 1.5), None)
    with pytest.raises(InputError, match="does not solve"):
        ContactResult.load(path)
    edited(path, said("about", "format", 1), None)
    with pytest.raises(InputError, match=r"format 1.*0\.1\.0"):
        ContactResult.load(path)


def encrypted(path):
    content = bytearray(path.read_bytes())
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        start = content.find(mark)
        while start >= 0:
            content[start + at] |= 1
            start = content.find(mark, start + 1)
    path.write_bytes(content)


def header(*shape):
    def write(path):
        file = io.BytesIO()
        about = {"descr": "<f8", "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(file, about)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("u.npy", file.getvalue() + bytes(64))

    return write


def bomb(path):
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("u.npy", "w") as file,
    ):
        for _ in range(80):
            file.write(bytes(1 << 20))


def two_of_one_name(path):
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("u.npy", b"")


@pytest.mark.parametrize("bodies", [[0.5], [3], ["0"], 1, "all"])
def test_bodies_that_are_none_of_the_file(bodies, path):
    """The words of a file that name bodies whose forces come from strains."""
    edited(path, said("step", "strains", bodies), forged=True)
    with pytest.raises(InputError, match=r"result\.npz"):
        ContactResult.load(path)


ILL_WILL = {
    "encrypted": encrypted,
    "80 terabytes": header(10**13),
    "sizes that overflow": header(2**62, 2**62),
    "bomb": bomb,
    "objects": lambda path: np.savez(path, about=np.array([{"format": 3}], dtype=object)),
    "twice": two_of_one_name,
    "nested": lambda path: np.savez(path, about=np.array("[" * 100_000)),
    "no archive": lambda path: path.write_bytes(b"PK\x03\x04" + bytes(1000)),
    "text": lambda path: path.write_text("u = 1"),
}


@pytest.mark.parametrize("what", ILL_WILL)
def test_archives_of_ill_will(what, path):
    ILL_WILL[what](path)
    with pytest.raises(InputError, match=r"result\.npz"):
        ContactResult.load(path)


def test_states_that_solve_nothing_are_not_saved(made, tmp_path):
    """The second look, with forces from strains, is one at a copy of the bodies."""
    before = made.kkt
    for wrong in (
        replace(made, u=1.5 * made.u),
        replace(made, u=1.5 * made.u),
        replace(made, mu=np.full_like(made.mu, np.nan)),
    ):
        with pytest.raises(InputError, match=r"certificate|NaN"):
            wrong.save(tmp_path / "result.npz")
        assert not made.system.body.slender
        assert made.kkt == before
    assert not list(tmp_path.iterdir())


def test_names(made, tmp_path):
    """A name without a suffix, or with a number for one, gets it, in `load` too."""
    for name in ("x.vtu", "x.pvd", "x.h5", "x.result", "a.b/x.json"):
        with pytest.raises(InputError, match=r"\.npz"):
            made.save(tmp_path / name)
    assert not list(tmp_path.iterdir())
    for name, file in (("x", "x.npz"), ("x.1", "x.1.npz"), ("x.NPZ", "x.NPZ")):
        assert made.save(tmp_path / name).name == file
        assert ContactResult.load(tmp_path / name).kkt == made.kkt
    long = "x" * 246
    assert made.save(str(tmp_path / long)).name == f"{long}.npz"
    for call in (made.save, ContactResult.load):
        with pytest.raises(InputError, match="path=None"):
            call(None)


def pressed(mesh, element, **options):
    body = ElasticBody(Basis(mesh, ElementVector(element), **options), E=1.0, nu=0.3)
    body.fix("top", "x").fix("top", "y", -0.02)
    return ContactProblem(body, "bottom", 0.01, 0.3)


def test_quadrature_boundaries_and_subdomains_come_back(tmp_path):
    """A rule that integrates inexactly gives another stiffness: it belongs to the body."""
    mesh = MeshQuad().refined(2).with_defaults()
    mesh = mesh.with_subdomains({"soft": lambda x: x[0] < 0.5})
    around = mesh.facets_around("soft")
    mesh = mesh.with_boundaries({"seam": around, "a/b\0ü": np.array([3, 5])})
    result = pressed(mesh, ElementQuad2(), intorder=2).solve()
    loaded = ContactResult.load(result.save(tmp_path / "result.npz"))
    assert loaded.kkt == result.kkt
    ours = loaded.system.body.mesh
    assert np.array_equal(ours.boundaries["seam"].ori, around.ori)
    assert np.array_equal(ours.boundaries["a/b\0ü"], [3, 5])
    assert np.array_equal(ours.subdomains["soft"], mesh.subdomains["soft"])
    assert np.array_equal(loaded.stress(), result.stress())


@pytest.mark.parametrize("name", ["ElementQuadBFS", "ElementMine"])
def test_elements_that_cannot_be_built_again(name, made, tmp_path):
    """scikit-fem's BFS rectangle is not ours, nor is a class of the same name."""
    mine = type(name, (ElementQuadBFS,), {})
    body = ElasticBody.from_mesh(made.system.body.mesh, mine(), E=1.0, nu=0.3)
    other = replace(made, system=replace(made.system, body=body))
    with pytest.raises(InputError, match=f"{name} cannot be saved"):
        other.save(tmp_path / "result.npz")
    assert not list(tmp_path.iterdir())


def test_numbering_of_its_own_is_refused(tmp_path):
    mesh, element = MeshQuad().refined(1).with_defaults(), ElementVector(ElementQuad2())
    result = pressed(mesh, ElementQuad2()).solve()
    dofs = skfem.assembly.Dofs(mesh, element)
    dofs.element_dofs = np.roll(np.arange(dofs.N), 2)[dofs.element_dofs]
    body = ElasticBody(Basis(mesh, element, dofs=dofs), E=1.0, nu=0.3)
    other = replace(result, system=replace(result.system, body=body))
    with pytest.raises(InputError, match="numbering of its own"):
        other.save(tmp_path / "result.npz")
