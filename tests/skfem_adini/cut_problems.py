"""Domains with known eigenvalues, and the discrete problems on them, for the tests."""

from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import jn_zeros, jnp_zeros, jv, jvp
from skfem import Basis, BilinearForm, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import AdiniExtension, CutDomain, ElementQuadAdini, LevelSet, nitsche
from tests.skfem_adini.boundary_integrals import Curve, eigenvalue

R = 0.411
LEVEL_SETS = {
    "disk": lambda x: (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - R**2,
    "ellipse": lambda x: ellipse(x),
    "mild flower": lambda x: flower(x, 0.03),
    "flower": lambda x: flower(x, 0.07),
}


def ellipse(x, a=0.43, b=0.27, turn=0.3):
    c, s = np.cos(turn), np.sin(turn)
    u, v = x[0] - 0.5, x[1] - 0.5
    return ((c * u + s * v) / a) ** 2 + ((c * v - s * u) / b) ** 2 - 1


def flower(x, amplitude):
    u, v = x[0] - 0.5, x[1] - 0.5
    return np.hypot(u, v) - 0.35 - amplitude * np.cos(5 * (np.arctan2(v, u) - 0.1))


def ball(x=0.5, y=0.5, r=R):
    return LevelSet(lambda p: (p[0] - x) ** 2 + (p[1] - y) ** 2 - r**2)


def half_plane(p, normal):
    return LevelSet(lambda x: normal[0] * (x[0] - p[0]) + normal[1] * (x[1] - p[1]))


def box(left, right, bottom, top):
    sides = half_plane((left, 0), (-1, 0)) & half_plane((right, 0), (1, 0))
    return sides & half_plane((0, bottom), (0, -1)) & half_plane((0, top), (0, 1))


def unit_square(n):
    return MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)


def disk_eigenvalues(count, neumann=False):
    zeros = jnp_zeros if neumann else jn_zeros
    found = [np.repeat(zeros(m, 6), 1 if m == 0 else 2) for m in range(8)]
    values = np.sort(np.concatenate([*found, [0.0] * neumann]))
    return (values[:count] / R) ** 2


@cache
def ellipse_eigenvalue(count=80):
    """The lowest Dirichlet eigenvalue, by boundary integrals."""
    turned = 0.5 + 0.5j, np.exp(0.3j)
    z = lambda t: turned[0] + turned[1] * (0.43 * np.cos(t) + 0.27j * np.sin(t))  # noqa: E731
    return eigenvalue([Curve(z, count)], 47.0)


@cache
def flower_eigenvalue(count=140, amplitude=0.07, guess=56.55):
    z = lambda t: 0.5 + 0.5j + (0.35 + amplitude * np.cos(5 * (t - 0.1))) * np.exp(1j * t)  # noqa: E731
    return eigenvalue([Curve(z, count)], guess)


def matrices(mesh, level_set, q=8):
    """Domain, stiffness, mass and Nitsche's matrix."""
    domain, element = CutDomain(mesh, level_set, q=q), ElementQuadAdini()
    K, M = (domain.assemble(form, element) for form in (laplace, mass))
    return domain, K, M, nitsche(domain.boundary(element))[0]


def robin(domain, weight):
    """Matrix of the boundary integral of weight u v."""
    form = BilinearForm(lambda u, v, w: weight * u * v)
    return form.assemble(domain.boundary(ElementQuadAdini()))


def extended(mesh, level_set, threshold=0.5):
    """Dirichlet and Neumann stiffness matrices and mass matrix, reduced by the extension."""
    domain, K, M, B = matrices(mesh, level_set)
    extension = AdiniExtension(Basis(mesh, ElementQuadAdini(), intorder=1), domain, threshold)
    return extension.apply(K + B, K, M)


def elastic_radial_number(lame, mu):
    """First root of the traction of J_1(k r) e_r at r = R."""

    def traction(k):
        return (lame + 2 * mu) * k * jvp(1, k * R) + lame * jv(1, k * R) / R

    return brentq(traction, 0.5 / R, 3.0 / R)
