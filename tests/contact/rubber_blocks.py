"""Bodies of large strain that several tests press, pull and shear."""

import numpy as np
from families import box

from contact import ContactProblem, NonlinearBody, NonlinearStepper, Plane, Status

FAR = {2: Plane((0.0, -50.0), (0.0, 1.0)), 3: Plane((0.0, 0.0, -50.0), (0.0, 0.0, 1.0))}
FLOOR = {2: Plane((0.0, 0.0), (0.0, 1.0)), 3: Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))}


def cube(element, stress, n=2, **more):
    """A unit square or cube of n cells along each edge."""
    ticks = [np.linspace(0.0, 1.0, n + 1)] * element().dim
    return NonlinearBody.from_mesh(box(element, *ticks), element(), stress=stress, **more)


def alone(body, **options):
    """The stepper of a body that touches nothing."""
    return NonlinearStepper(ContactProblem(body, "bottom", FAR[body.dim]), **options)


def pressed(body, friction=0.0, depth=0.3, floor=None):
    """The stepper of a body held at its top and pressed onto the floor."""
    floor = FLOOR[body.dim] if floor is None else floor
    body = body.fix("top")
    problem = ContactProblem(body, "bottom", floor, friction)
    return NonlinearStepper(problem).move("top", body.dim - 1, -depth)


def stretched(body, *stretches):
    """The result with faces at 0 held normally and others moved; None leaves a direction free."""
    names = (("left", "right"), ("bottom", "top"), ("front", "back"))[: body.dim]
    if body.dim == 3:
        names = sides_in_space(body)
    for c, (low, high) in enumerate(names):
        body.fix(low, c)
        if stretches[c] is not None:
            body.fix(high, c)
    stepper = alone(body, tol=1e-12)
    for c, (_, high) in enumerate(names):
        if stretches[c] is not None:
            stepper.move(high, c, stretches[c] - 1.0)
    return stepper.run(np.linspace(0.25, 1.0, 4)).results[-1]


def sides_in_space(body):
    """Facets of a unit cube at 0 and 1 in each direction."""
    mesh = body.mesh
    return [
        tuple(mesh.facets_satisfying(lambda x, c=c, v=v: np.isclose(x[c], v)) for v in (0.0, 1.0))
        for c in range(3)
    ]


def orders(history):
    """Estimated orders of convergence from the last residuals above rounding."""
    sizes = np.log([line.residual for line in history if line.residual > 1e-12])
    return (sizes[2:] - sizes[1:-1]) / (sizes[1:-1] - sizes[:-2])


def check_laws(result, friction, size=1.0):
    """Signorini's and Coulomb's conditions of a body of some size, from what a user sees."""
    mu, t, slip = result.mu, result.t, result.touch.slip
    largest = mu.max()
    assert largest > 0
    assert mu.min() >= -1e-9 * largest
    assert result.gap.min() >= -1e-9 * size
    assert abs(mu @ result.gap) <= 1e-8 * largest * size
    assert np.all(np.linalg.norm(t, axis=1) <= friction * mu + 1e-8 * largest)
    assert np.all(np.sum(t * slip, axis=1) >= -1e-9 * largest * size)
    moving = np.linalg.norm(slip, axis=1) > 1e-6 * size
    bound = friction * mu[moving]
    assert np.abs(np.linalg.norm(t[moving], axis=1) - bound).max(initial=0.0) <= 1e-6 * largest
    assert np.array_equal(result.status == Status.OPEN, mu <= 0)
