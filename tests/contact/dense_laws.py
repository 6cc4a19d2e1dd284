"""Contact on a grid by the dense solvers of the package: the compliance as a matrix of products."""

import numpy as np

from contact import NotConverged
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.laws.condensed_newton import Condensed
from contact.laws.friction import Coulomb, Tresca
from contact.laws.methods import signorini
from contact.laws.newton import newton, proximal_point
from contact.spectral.grid_problem import GridProblem


def dense(problem: GridProblem) -> tuple[BoundaryProblem, float]:
    """The same problem in rows, scaled so that the compliance of a point alone is one."""
    dim, m = len(problem.v0), problem.gap.size
    unit = np.eye(dim * m).reshape(dim * m, *problem.v0.shape)
    W = np.array([problem.W(e).ravel() for e in unit])
    s = np.sqrt(W[0, 0])
    C = np.zeros((dim * m, len(problem.free)))
    for column, i in enumerate(problem.free):
        C[i * m : (i + 1) * m, column] = 1.0
    rows = np.arange(dim * m).reshape(dim, m)
    return (
        BoundaryProblem(
            W / s**2,
            problem.v0.ravel() / s,
            C,
            problem.force[problem.free] * s,
            problem.gap.ravel() / s,
            rows[0],
            rows[1:].T,
            np.zeros((m, dim - 1)),
        ),
        s,
    )


def forces_of(problem, friction, law):
    """Forces (dim, nx[, ny]) by the dense solvers."""
    rows, s = dense(problem)
    free_n = np.array([i == 0 for i in problem.free], dtype=bool)
    normal = BoundaryProblem(
        rows.W,
        rows.v0,
        rows.C[:, free_n],
        rows.s[free_n],
        rows.gap,
        rows.normal,
        np.full_like(rows.tangent, -1),
        rows.prescribed_slip,
    )
    found = signorini(normal, tol=1e-12)
    a = np.zeros(len(problem.free))
    a[free_n] = found.a
    if friction is not None:
        given = np.broadcast_to(friction, problem.gap.shape).ravel()
        rule = Coulomb(given) if law == "coulomb" else Tresca(given * s)
        t = np.zeros(rows.tangent.shape)
        for column, i in enumerate(problem.free):
            if i:
                t[:, i - 1] = found.mu * rows.s[column] / max(found.mu.sum(), 1e-300)
        start, laws = Forces(found.mu, t, a), Condensed(rows, rule)
        try:
            found = newton(laws, start, tol=1e-13)
        except NotConverged:
            found = proximal_point(laws, start, tol=1e-13)
    shape = problem.gap.shape
    return (
        np.array([found.mu, *(found.t.T if friction is not None else 0 * found.t.T)]).reshape(
            -1, *shape
        )
        / s
    )
