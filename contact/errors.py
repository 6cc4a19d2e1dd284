"""Warnings of the package, and the exceptions that it shares with the others."""

from __future__ import annotations

from typing import Any

from skfem_adini.ground import errors
from skfem_adini.ground.errors import (  # noqa: F401
    AdiniError,
    Infeasible,
    InputError,
    MissingDependency,
    NotConverged,
    Unbounded,
)

ContactError = AdiniError


class NoEquilibrium(NotConverged):
    """With adhesion: no stable equilibrium was found near that of the step before.

    The loading has passed an instability, such as pull-off or a jump into contact, or the step is
    too large. Take smaller steps, control the motion instead of the force, or refine where the
    cohesive zone has few points.

    Attributes
    ----------
    history : tuple of Iteration
        One entry an iteration, as in `ContactResult.history`.

    Examples
    --------
    A load beyond the tension that holds a plane:

    >>> from skfem import MeshQuad
    >>> from contact import Adhesion, ContactProblem, ElasticBody, NoEquilibrium
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, 0.03))
    >>> try:
    ...     ContactProblem(body, "bottom", 0.0, adhesion=Adhesion(0.02, 1e-4)).solve()
    ... except NoEquilibrium as error:
    ...     print(type(error).__name__)
    NoEquilibrium
    """

    def __init__(self, message: str, history: tuple[Any, ...] = ()) -> None:
        super().__init__(message, history)


CHANGED = 0.25  # change of the gap relative to the penetration that causes a warning


class ContactWarning(UserWarning):
    """The problem is well posed, but probably not the intended one; the message says what to do.

    The returned result is certified. Follow the message, or filter the warning if the problem is
    intended.

    Examples
    --------
    A roller that lies beside the block:

    >>> import warnings
    >>> from contact import ContactProblem, Cylinder, ElasticBody
    >>> from skfem import MeshQuad
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     problem = ContactProblem(body.fix("top", "xy"), "bottom", Cylinder((5.0, -1.0), 1.0))
    >>> print(found[0].message)
    obstacle: no normal of the contact boundary meets the Cylinder, so that nothing can touch; ...
    """


class LargeMotionWarning(ContactWarning):
    """Loaded points have moved along the obstacle so far that their gaps have changed.

    Contact is linearised in the undeformed state: points keep their partners, normals and gaps. Let
    bodies slide, and rigid shapes move and turn, with `LoadStepper(..., sliding="finite")`; place a
    rigid obstacle where it has moved to, as `LoadStepper.obstacle` does, instead of a large motion
    of a `Rigid`; or measure the gap by `ClosestPoint`, which a motion along a plane does not
    change. If the gaps change by more
    than the penetration, the result is refused with an `InputError`.

    Examples
    --------
    A roller of radius 1, pressed into a block by .02 and rolled on by .05:

    >>> import warnings
    >>> from contact import ContactProblem, Cylinder, ElasticBody, Rigid
    >>> from skfem import MeshQuad
    >>> mesh = MeshQuad().refined(5).translated((-0.5, -1.0)).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("bottom", "xy")
    >>> roller = Rigid(Cylinder((0.0, 1.0), 1.0), displacement=(0.05, -0.02))
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     result = ContactProblem(body, "top", roller).solve()
    >>> print(found[0].category.__name__)
    LargeMotionWarning
    """


class JumpWarning(ContactWarning):
    """With adhesion: the step has passed an instability, to an equilibrium that is not near.

    The state is certified, but the path to it was not followed: the energy released in between is
    lost. `result.jump` says which way. Filter the warning if jumps are what you are after.

    Examples
    --------
    A ball that is pulled off within one step:

    >>> import warnings
    >>> from contact import Adhesion, GridContact, HalfSpace, JumpWarning, Parabola, Rigid
    >>> ground, ball = HalfSpace((1.0, 1.0), (32, 32), 1.0, 0.3), Parabola((0.5, 0.5, 0.0), 2.0)
    >>> steps = [Rigid(ball, displacement=(0.0, 0.0, h)) for h in (0.002, -0.1)]
    >>> contact = GridContact(ground, steps[0], adhesion=Adhesion(0.01, 1e-5))
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     last = contact.history(steps)[-1]
    >>> print(found[0].category.__name__, last.jump)
    JumpWarning pull-off
    """


def warn(message: str, category: type[ContactWarning] = ContactWarning) -> None:
    """Issue a warning that points at the line which called this package."""
    errors.warn(message, category)
