"""Domains with known eigenvalues, and the discrete problems on them, for the tests."""

from functools import lru_cache

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import jn_zeros, jnp_zeros, jv, jvp, y0
from skfem import Basis, BilinearForm, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import AdiniExtension, CutDomain, ElementQuadAdini, nitsche

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


def unit_square(n):
    return MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)


def disk_eigenvalues(count, neumann=False):
    zeros = jnp_zeros if neumann else jn_zeros
    found = [np.repeat(zeros(m, 6), 1 if m == 0 else 2) for m in range(8)]
    values = np.sort(np.concatenate([*found, [0.0] * neumann]))
    return (values[:count] / R) ** 2


@lru_cache
def lowest_by_particular_solutions(radius, folds, functions, low, high):
    """The lowest Dirichlet eigenvalue of a star-shaped domain, by the method of particular
    solutions (L. Fox, P. Henrici, C. Moler, SIAM Journal on Numerical Analysis 4 (1967), 89-102).

    Its function is sum_k c_k J_{mk}(sqrt(lambda) r) cos(m k theta), with the m-fold symmetry and
    the axis of the domain; it vanishes at as many boundary points where the determinant does.
    """
    orders = folds * np.arange(functions)
    theta = np.pi / folds * (np.arange(functions) + 0.5) / functions
    r = radius(theta)

    def determinant(value):
        columns = jv(orders, np.sqrt(value) * r[:, None]) * np.cos(orders * theta[:, None])
        scale = jv(orders, np.sqrt(value) * r.max())
        return np.linalg.det(columns / scale)

    return brentq(determinant, low, high, xtol=1e-11, rtol=1e-15)


def ellipse_eigenvalue(functions=14):
    return lowest_by_particular_solutions(_ellipse_radius, 2, functions, 40, 55)


@lru_cache
def flower_eigenvalue(sources=40, shift=0.1):
    """The lowest Dirichlet eigenvalue of the flower, by fundamental solutions outside.

    The least sine of the angle between functions of the space on the boundary and zero (T. Betcke
    and L. N. Trefethen, SIAM Review 47 (2005), 469-491) has a corner at the eigenvalue.
    """

    def curve(t):
        return (0.35 + 0.07 * np.cos(5 * t)) * np.exp(1j * t)

    turns = np.exp(2j * np.pi * np.arange(5) / 5)
    outside = curve(np.pi / 5 * (np.arange(sources) + 0.5) / sources - 1j * shift)
    poles = np.concatenate([np.outer(turns, outside), np.outer(turns, outside.conj())])
    boundary = curve(np.pi / 5 * (np.arange(100) + 0.5) / 100)
    rng = np.random.default_rng(0)
    inner = curve(rng.uniform(0, np.pi / 5, 40)) * np.sqrt(rng.uniform(0, 0.9, 40))
    distance = np.abs(np.append(boundary, inner)[:, None, None] - poles)

    def sine(value):
        columns = y0(np.sqrt(value) * distance).sum(axis=1)
        U, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
        return np.linalg.svd(U[: len(boundary), s > 1e-14 * s[0]], compute_uv=False)[-1]

    near = minimize_scalar(sine, bounds=(56.4, 56.7), method="bounded", options={"xatol": 1e-7}).x
    d = 1e-3
    left2, left1, right1, right2 = (sine(near + k * d) for k in (-2, -1, 1, 2))
    fall, rise = left1 - left2, right2 - right1
    return near + d * (left1 - right1 + fall + rise) / (rise - fall)


def _ellipse_radius(theta):
    return 1 / np.hypot(np.cos(theta) / 0.43, np.sin(theta) / 0.27)


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
