"""Adini finite elements for scikit-fem.

The names of `face` are loaded at first access (PEP 562), because `cip` and `gpu`, which import
`skfem_adini.ground`, do not need scikit-fem.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skfem_adini.face import *  # noqa: F403

__version__ = "1.0.0rc1"


def __dir__() -> list[str]:
    """The public names, without the submodules."""
    return [*import_module("skfem_adini.face").__all__, "__version__"]


if not TYPE_CHECKING:  # a type checker would take every name for one of ours

    def __getattr__(name: str) -> Any:
        """Load a public name, together with all others."""
        if name == "__all__" or not name.startswith("__"):
            face = import_module("skfem_adini.face")
            globals().update({key: getattr(face, key) for key in ("__all__", *face.__all__)})
        if name in globals():
            return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
