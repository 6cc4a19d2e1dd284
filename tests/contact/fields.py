"""Displacements without contact, dofs of linear fields, and errors of pressures."""

import numpy as np
from random_bodies import ADINI, BFS
from scipy import sparse
from scipy.sparse.linalg import spsolve


def without_contact(body):
    """Displacement of all dofs under loads and supports alone, by unknowns in one unit."""
    P, u0 = body.constraint
    B = P @ sparse.diags_array(1.0 / body.lengths[1])
    z = spsolve(sparse.csc_array(B.T @ body.stiffness @ B), B.T @ (body.f - body.stiffness @ u0))
    return B @ z + u0


def linear_dofs(body, H, middle=0.0, shift=0.0):
    """Dofs of the displacement H (x - middle) + shift."""
    u, where = np.zeros(body.basis.N), body.basis.doflocs
    middle, shift = (np.broadcast_to(v, body.dim) for v in (middle, shift))
    kind = body.basis.elem.elem
    slopes = isinstance(kind, ADINI + BFS)
    for i, dofs in enumerate(body.basis.element_dofs):
        c, derivative = i % body.dim, (i // body.dim) % kind.nodal_dofs if slopes else 0
        if derivative == 0:
            u[dofs] = H[c] @ (where[:, dofs] - middle[:, None]) + shift[c]
        elif derivative <= body.dim:
            u[dofs] = H[c][derivative - 1]
    return u


def rms(result, exact=1.0):
    """Rms of the pressure's error over the contact boundary, in parts of the exact pressure."""
    w = result.system.rows.weights
    return float(np.sqrt(w @ (result.pressure / exact - 1) ** 2 / w.sum()))
