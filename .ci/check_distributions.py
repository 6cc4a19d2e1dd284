"""Fail unless the wheel and the source distribution in a folder hold what they should."""

import sys
import tarfile
import zipfile
from pathlib import Path

from packaging.metadata import Metadata

PACKAGES = {"skfem_adini", "contact", "cip", "gpu"}
BESIDES = {"README.md", "CHANGELOG.md", "CITATION.cff", "LICENSE", "pyproject.toml", "PKG-INFO"}

folder = Path(sys.argv[1])
(wheel,), (source,) = folder.glob("*.whl"), folder.glob("*.tar.gz")

with zipfile.ZipFile(wheel) as archive:
    names = archive.namelist()
    (info,) = {name.split("/")[0] for name in names if ".dist-info/" in name}
    metadata = Metadata.from_email(archive.read(f"{info}/METADATA"), validate=True)
assert {name.split("/")[0] for name in names} == PACKAGES | {info}, names
assert {f"{package}/py.typed" for package in PACKAGES} <= set(names)
assert f"{info}/licenses/LICENSE" in names

with tarfile.open(source) as archive:
    inside = {name.partition("/")[2] for name in archive.getnames()}
# The tests too: whoever packages the project runs them; nothing of CI and of what was made.
assert BESIDES | {"tests/conftest.py"} <= inside, BESIDES - inside
assert {f"{package}/py.typed" for package in PACKAGES} <= inside
assert not [name for name in inside if name.startswith((".ci", "out/", ".venv"))]

assert metadata.description_content_type == "text/markdown"
assert metadata.description == Path("README.md").read_text()
assert metadata.license_expression == "BSD-3-Clause"
print(f"{wheel.name} and {source.name}: contents and metadata are right")
