"""What SECURITY.md says: its names exist, and no door reads objects or evaluates text."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import cip
import contact

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "SECURITY.md").read_text()
SOURCES = [
    p for name in ("contact", "cip", "gpu", "skfem_adini") for p in (ROOT / name).rglob("*.py")
]
FORBIDDEN = ("eval", "pickle.load", "pickle.loads", "marshal.loads", "yaml.load")


SUSPECT = ("eval", "load", "loads", "read_array", "entry_points")


def calls(tree):
    """Calls of functions whose names end so, by their whole names."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            last = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if last.endswith(SUSPECT):
                yield ast.unparse(node.func), node


def test_names_exist():
    named = set(re.findall(r"`(?:cip\.)?([A-Z]\w+)\.(\w+)`?", TEXT))
    assert len(named) >= 7
    for owner, name in named:
        one = getattr(contact, owner, None) or getattr(cip, owner)
        assert hasattr(one, name), (owner, name)


def test_nothing_reads_objects():
    for path in SOURCES:
        for name, call in calls(ast.parse(path.read_text())):
            assert name not in FORBIDDEN, path
            assert "entry_points" not in name, path
            if name.endswith((".load", ".read_array")) and name.startswith(("np.", "numpy.")):
                options = {k.arg: ast.unparse(k.value) for k in call.keywords}
                assert options.get("allow_pickle") == "False", path


@pytest.mark.parametrize("load", [contact.ContactResult.load, contact.GridResult.load])
def test_objects_in_a_result_are_refused(load, tmp_path):
    """An archive with an object whose unpickling would leave a trace."""

    class Trace:
        def __reduce__(self):
            return Path.touch, (tmp_path / "ran",)

    np.savez(tmp_path / "bad.npz", about=np.array([Trace()], dtype=object))
    with pytest.raises(contact.InputError):
        load(tmp_path / "bad.npz")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "text",
    ["__import__('os').getcwd()", "().__class__", "x1.real", "[x1][0]", "(lambda: 1)()", "a:=1"],
)
def test_formulas_hold_nothing_else(text):
    with pytest.raises(cip.InputError):
        cip.Velocity.from_expression(text)
