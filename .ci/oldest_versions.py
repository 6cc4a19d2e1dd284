"""Constraints for pip: the oldest version of each dependency that pyproject.toml allows."""

import re
import tomllib
from pathlib import Path

EXTRAS = ("mkl", "amg", "io")

project = tomllib.loads(Path(__file__).parents[1].joinpath("pyproject.toml").read_text())["project"]
extras = [line for name in EXTRAS for line in project["optional-dependencies"][name]]
for requirement in project["dependencies"] + extras:
    name, version = re.fullmatch(r"([\w-]+)>=([\d.]+)", requirement).groups()
    print(f"{name}=={version}")
