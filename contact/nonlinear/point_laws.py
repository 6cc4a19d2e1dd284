"""Material laws, as examples of what `NonlinearBody` takes.

All take F of shape (3, 3, ...) and return the first Piola-Kirchhoff stress P; those with a state
also the new one. They contain no abs or norm: complex steps go through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from contact.errors import InputError
from contact.nonlinear.cell_forces import cofactor, det
from skfem_adini.ground.arguments import finite_number

__all__ = [
    "FinitePlasticity",
    "MooneyRivlin",
    "NeoHooke",
    "Ogden",
    "Plasticity",
    "SaintVenant",
    "Viscous",
]


def _positive(**given: float) -> None:
    for name, value in given.items():
        finite_number(name, value)
        if value <= 0.0:
            raise InputError(f"{name}={value!r}: expected a positive number")


def lame(E: float, nu: float) -> tuple[float, float]:
    """Lame constants (lam, mu); InputError for E <= 0 or nu outside (-1, 1/2)."""
    _positive(E=E)
    finite_number("nu", nu)
    if not -1.0 < nu < 0.5:
        raise InputError(f"nu={nu!r}: expected a number between -1 and 1/2")
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


def _unit(like: Any) -> Any:
    found = np.zeros_like(like, shape=(3, 3, *(1,) * (like.ndim - 2)), dtype=float)
    for i in range(3):
        found[i, i] = 1.0
    return found


def _times(A: Any, B: Any) -> Any:
    return np.einsum("ij...,jk...->ik...", A, B)


def _dot(A: Any, B: Any) -> Any:
    return (A * B).sum(axis=(0, 1))


def _trace(A: Any) -> Any:
    return A[0, 0] + A[1, 1] + A[2, 2]


def _deviator(A: Any) -> Any:
    return A - _trace(A) / 3.0 * _unit(A)


def _turned(A: Any) -> Any:
    return A.swapaxes(0, 1)


@dataclass(frozen=True)
class SaintVenant:
    r"""Saint Venant-Kirchhoff: Hooke's law of the Green strain, for large rotations.

    .. math:: P = F (\lambda \operatorname{tr} E\, I + 2 \mu E), \qquad E = (F^T F - I) / 2

    It softens in compression, without bound below a stretch of .58: take `NeoHooke` there.

    Parameters
    ----------
    E, nu : float
        Young's modulus and Poisson's ratio for small strains.

    Raises
    ------
    InputError
        A constant outside its range.

    References
    ----------
    J. Bonet and R. D. Wood, Nonlinear Continuum Mechanics, 2nd ed. 2008, section 6.4.1.

    Examples
    --------
    >>> F = np.diag([1.1, 1.0, 1.0])
    >>> round(float(SaintVenant(E=1.0, nu=0.0)(F)[0, 0]), 6)  # 1.1 (1.1^2 - 1) / 2
    0.1155
    """

    E: float
    nu: float

    def __post_init__(self) -> None:
        lame(self.E, self.nu)

    def __call__(self, F: Any) -> Any:
        """First Piola-Kirchhoff stress, shape as F."""
        lam, mu = lame(self.E, self.nu)
        strain = 0.5 * (_times(_turned(F), F) - _unit(F))
        return _times(F, lam * _trace(strain) * _unit(F) + 2 * mu * strain)

    def energy(self, F: Any) -> Any:
        """Stored energy per undeformed volume."""
        lam, mu = lame(self.E, self.nu)
        strain = 0.5 * (_times(_turned(F), F) - _unit(F))
        return 0.5 * lam * _trace(strain) ** 2 + mu * _dot(strain, strain)


@dataclass(frozen=True)
class NeoHooke:
    r"""Compressible neo-Hooke, the plainest law of rubber.

    .. math::
        \psi = \tfrac{\mu}{2} (\operatorname{tr} F^T F - 3 - 2 \ln J) + \tfrac{\lambda}{2} (\ln J)^2

    Parameters
    ----------
    mu, lam : float
        Lame constants for small strains. Of nearly incompressible rubber lam is a hundred or more
        times mu: take ``NonlinearBody(..., dilatation="mean")``.

    Raises
    ------
    InputError
        A constant that is not positive.

    References
    ----------
    J. Bonet and R. D. Wood, Nonlinear Continuum Mechanics, 2nd ed. 2008, equation (6.27).

    Examples
    --------
    >>> F = np.diag([2.0, 2.0**-0.5, 2.0**-0.5])
    >>> round(float(NeoHooke(mu=1.0, lam=9.0)(F)[0, 0]), 6)  # 2 - 1 / 2, for J = 1
    1.5
    """

    mu: float
    lam: float

    def __post_init__(self) -> None:
        _positive(mu=self.mu, lam=self.lam)

    def __call__(self, F: Any) -> Any:
        """First Piola-Kirchhoff stress, shape as F."""
        J = det(F)
        return self.mu * F + (self.lam * np.log(J) - self.mu) / J * cofactor(F)

    def energy(self, F: Any) -> Any:
        """Stored energy per undeformed volume."""
        log = np.log(det(F))
        return 0.5 * self.mu * (_dot(F, F) - 3 - 2 * log) + 0.5 * self.lam * log**2


@dataclass(frozen=True)
class MooneyRivlin:
    r"""Mooney-Rivlin with the invariants of the volume-preserving part of F.

    .. math::
        \psi = c_1 (\bar I_1 - 3) + c_2 (\bar I_2 - 3) + \tfrac{K}{2} (J - 1)^2, \qquad
        \bar I_1 = J^{-2/3} I_1, \quad \bar I_2 = J^{-4/3} I_2

    Parameters
    ----------
    c1, c2 : float
        Half the shear modulus together; c2 may be zero.
    K : float
        Bulk modulus.

    Raises
    ------
    InputError
        A constant that is not positive, c2 negative.

    References
    ----------
    G. A. Holzapfel, Nonlinear Solid Mechanics, Wiley 2000, section 6.5.

    Examples
    --------
    >>> F = np.diag([2.0, 1.0, 0.5])
    >>> P = MooneyRivlin(c1=0.3, c2=0.2, K=100.0)(F)
    >>> round(float(2.0 * P[0, 0] - 0.5 * P[2, 2]), 6)  # 2 (4 - 1/4) (c1 + c2 1)
    3.75
    """

    c1: float
    c2: float
    K: float

    def __post_init__(self) -> None:
        _positive(c1=self.c1, K=self.K)
        finite_number("c2", self.c2)
        if self.c2 < 0:
            raise InputError(f"c2={self.c2!r}: expected zero or a positive number")

    def __call__(self, F: Any) -> Any:
        """First Piola-Kirchhoff stress, shape as F."""
        J, C = det(F), _times(_turned(F), F)
        one = _trace(C)
        two, inverse = 0.5 * (one**2 - _dot(C, C)), cofactor(F) / J
        first = 2 * self.c1 * J ** (-2 / 3) * (F - one / 3 * inverse)
        second = 2 * self.c2 * J ** (-4 / 3) * (one * F - _times(F, C) - 2 * two / 3 * inverse)
        return first + second + self.K * (J - 1) * J * inverse

    def energy(self, F: Any) -> Any:
        """Stored energy per undeformed volume."""
        J, C = det(F), _times(_turned(F), F)
        one = _trace(C)
        two = 0.5 * (one**2 - _dot(C, C))
        first, second = J ** (-2 / 3) * one - 3, J ** (-4 / 3) * two - 3
        return self.c1 * first + self.c2 * second + 0.5 * self.K * (J - 1) ** 2


@dataclass(frozen=True)
class Ogden:
    r"""Ogden's law through the principal stretches of the volume-preserving part of F.

    .. math::
        \psi = \sum_p \tfrac{\mu_p}{\alpha_p}
            (\bar\lambda_1^{\alpha_p} + \bar\lambda_2^{\alpha_p} + \bar\lambda_3^{\alpha_p} - 3)
            + \tfrac{K}{2} (J - 1)^2, \qquad \bar\lambda_i = J^{-1/3} \lambda_i

    Parameters
    ----------
    mu, alpha : float or sequence of float
        Pairs of constants, each with a positive product; half the sum of the products is the shear
        modulus.
    K : float
        Bulk modulus.

    Raises
    ------
    InputError
        Lists of different lengths, or a constant outside its range.

    References
    ----------
    R. W. Ogden, Large deformation isotropic elasticity, Proc. R. Soc. Lond. A 326 (1972), 565-584.
    G. A. Holzapfel, Nonlinear Solid Mechanics, Wiley 2000, section 6.5.

    Examples
    --------
    Treloar's rubber, in units of N/mm^2:

    >>> law = Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0), K=1000.0)
    >>> F = np.diag([2.0, 1.0, 0.5])
    >>> expected = sum(m * (2.0**a - 0.5**a) for m, a in zip(law.mu, law.alpha))
    >>> P = law(F)
    >>> bool(abs(2.0 * P[0, 0] - 0.5 * P[2, 2] - expected) < 1e-12)
    True
    """

    mu: Any
    alpha: Any
    K: float

    def __post_init__(self) -> None:
        _positive(K=self.K)
        if len(np.atleast_1d(self.mu)) != len(np.atleast_1d(self.alpha)):
            raise InputError("mu, alpha: expected as many of one as of the other")
        for mu, alpha in self._terms():
            finite_number("mu", mu)
            finite_number("alpha", alpha)
            if not mu * alpha > 0.0:
                raise InputError(f"mu={mu!r}, alpha={alpha!r}: expected a positive product")

    def _terms(self) -> list[tuple[Any, Any]]:
        return list(zip(np.atleast_1d(self.mu), np.atleast_1d(self.alpha), strict=True))

    def __call__(self, F: Any) -> Any:
        """First Piola-Kirchhoff stress, shape as F."""
        J, C = det(F), _times(_turned(F), F)
        powers = _powers(C, [alpha / 2 for _, alpha in self._terms()])
        S = self.K * (J - 1) * J * _unit(F)
        for (mu, alpha), power in zip(self._terms(), powers, strict=True):
            S = S + mu * J ** (-alpha / 3) * _deviator(power)
        return _times(cofactor(F) / J, S)

    def energy(self, F: Any) -> Any:
        """Stored energy per undeformed volume."""
        J, C = det(F), _times(_turned(F), F)
        found = 0.5 * self.K * (J - 1) ** 2
        powers = _powers(C, [alpha / 2 for _, alpha in self._terms()])
        for (mu, alpha), power in zip(self._terms(), powers, strict=True):
            found = found + mu / alpha * (J ** (-alpha / 3) * _trace(power) - 3)
        return found


def _powers(C: Any, exponents: Sequence[float]) -> list[Any]:
    """Real powers of symmetric positive matrices (3, 3, ...), also for small imaginary parts.
    These follow the derivative by divided differences of the eigenvalues, which are as exact where
    eigenvalues are equal (Yu. L. Daleckii and S. G. Krein, AMS Transl. 47 (1965), 1-30)."""
    own = np.moveaxis(np.real(C), (0, 1), (-2, -1))
    finite = np.isfinite(own).all(axis=(-2, -1), keepdims=True)
    values, Q = np.linalg.eigh(np.where(finite, own, 0.0))
    values = np.maximum(values, 0.0) + np.where(values > 0.0, 0.0, np.nan)  # beyond use
    log = np.log(values)
    apart = log[..., :, None] - log[..., None, :]
    same, found = np.abs(apart) < 1e-14, []
    back = Q.swapaxes(-1, -2)
    for b in exponents:
        A = (Q * values[..., None, :] ** b) @ back
        if np.iscomplexobj(C):
            ratio = np.expm1(b * apart) / np.where(same, 1.0, np.expm1(apart))
            slope = values[..., None, :] ** (b - 1) * np.where(same, b, ratio)
            part = back @ np.moveaxis(np.imag(C), (0, 1), (-2, -1)) @ Q
            A = A + 1j * (Q @ (slope * part) @ back)
        found.append(np.moveaxis(A, (-2, -1), (0, 1)))
    return found


@dataclass(frozen=True)
class Plasticity:
    r"""Von Mises plasticity of small strains with linear isotropic hardening (J2 flow).

    .. math:: |s| \le \sqrt{2/3}\, (\sigma_y + H \alpha)

    by radial return of the trial stress; :math:`\alpha` is the equivalent plastic strain.

    Parameters
    ----------
    E, nu : float
    yield_stress : float
        In uniaxial tension.
    hardening : float
        H, the slope of the yield stress over the plastic strain; not negative.

    Attributes
    ----------
    state : dict
        "ep", plastic strain (3, 3), and "alpha".

    Raises
    ------
    InputError
        A constant outside its range.

    References
    ----------
    J. C. Simo and T. J. R. Hughes, Computational Inelasticity, Springer 1998, Box 3.2.

    Examples
    --------
    >>> law = Plasticity(E=1000.0, nu=0.3, yield_stress=1.0)
    >>> rest = {"ep": np.zeros((3, 3)), "alpha": 0.0}
    >>> F = np.eye(3) + 0.01 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]])
    >>> round(float(law(F, rest, 1.0)[0][0, 1]), 6)  # 1 / sqrt(3)
    0.57735
    """

    E: float
    nu: float
    yield_stress: float
    hardening: float = 0.0
    state: dict[str, Any] = field(
        init=False, repr=False, default_factory=lambda: {"ep": np.zeros((3, 3)), "alpha": 0.0}
    )

    def __post_init__(self) -> None:
        lame(self.E, self.nu)
        _check_yield(self.yield_stress, self.hardening)

    def __call__(self, F: Any, state: Any, dt: float) -> tuple[Any, dict[str, Any]]:
        """Stress (3, 3, ...), and the new state."""
        lam, mu = lame(self.E, self.nu)
        elastic = 0.5 * (F + _turned(F)) - _unit(F) - state["ep"]
        s = 2 * mu * _deviator(elastic)
        n, gamma, alpha = _returned(self, s, state["alpha"], 2 * mu)
        pressure = (lam + 2 * mu / 3) * _trace(elastic)
        stress = pressure * _unit(F) + s - 2 * mu * gamma * n
        return stress, {"ep": state["ep"] + gamma * n, "alpha": alpha}


@dataclass(frozen=True)
class FinitePlasticity:
    r"""Von Mises plasticity of large strains: elastic and plastic parts of F multiply.

    The Kirchhoff stress is :math:`\tfrac{K}{2} (J^2 - 1) I + \mu \operatorname{dev} \bar b^e`, and
    returns radially onto the yield surface; plastic flow keeps the volume up to the scheme's order.

    Parameters
    ----------
    E, nu, yield_stress, hardening
        As for `Plasticity`.

    Attributes
    ----------
    state : dict
        "Cp", the inverse of the plastic metric (3, 3) without volume change, and "alpha".

    Raises
    ------
    InputError
        A constant outside its range.

    References
    ----------
    J. C. Simo and T. J. R. Hughes, Computational Inelasticity, Springer 1998, Box 9.1.

    Examples
    --------
    >>> law = FinitePlasticity(E=1000.0, nu=0.3, yield_stress=1.0)
    >>> F = np.eye(3)
    >>> F[0, 1] = 0.5
    >>> P, _ = law(F, {"Cp": np.eye(3), "alpha": 0.0}, 1.0)
    >>> bool(abs((P @ F.T)[0, 1]) < 1 / 3**0.5)
    True
    """

    E: float
    nu: float
    yield_stress: float
    hardening: float = 0.0
    state: dict[str, Any] = field(
        init=False, repr=False, default_factory=lambda: {"Cp": np.eye(3), "alpha": 0.0}
    )

    def __post_init__(self) -> None:
        lame(self.E, self.nu)
        _check_yield(self.yield_stress, self.hardening)

    def __call__(self, F: Any, state: Any, dt: float) -> tuple[Any, dict[str, Any]]:
        """Stress (3, 3, ...), and the new state."""
        lam, mu = lame(self.E, self.nu)
        J = det(F)
        f = J ** (-1 / 3) * F
        b = _times(_times(f, state["Cp"]), _turned(f))
        mean = _trace(b) / 3
        s = mu * _deviator(b)
        n, gamma, alpha = _returned(self, s, state["alpha"], 2 * mu * mean)
        s = s - 2 * mu * mean * gamma * n
        kirchhoff = 0.5 * (lam + 2 * mu / 3) * (J**2 - 1) * _unit(F) + s
        back = cofactor(f)  # f^-T, for det f = 1
        b = s / mu + mean * _unit(F)
        new = _times(_times(_turned(back), b), back)
        return _times(kirchhoff, cofactor(F) / J), {"Cp": new, "alpha": alpha}


def _check_yield(yield_stress: float, hardening: float) -> None:
    _positive(yield_stress=yield_stress)
    finite_number("hardening", hardening)
    if hardening < 0.0:
        raise InputError(f"hardening={hardening!r}: softening has no unique solution; at least 0")


def _returned(law: Any, s: Any, alpha: Any, stiffness: Any) -> tuple[Any, Any, Any]:
    """Direction, plastic multiplier and new alpha for a trial deviator s; `stiffness` is 2 mu."""
    root = np.sqrt(2 / 3)
    square = _dot(s, s)
    size = np.sqrt(np.where(square == 0, 1.0, square))
    over = size - root * (law.yield_stress + law.hardening * alpha)
    plastic = np.real((square != 0) & (over.real > 0))
    gamma = np.where(plastic, over, 0.0) / (stiffness + 2 * law.hardening / 3)
    return s / size, gamma, alpha + root * gamma


@dataclass(frozen=True)
class Viscous:
    r"""Any elastic law with a part of its stress that relaxes: one term of a Prony series.

    .. math:: S = (1 - g) S_e + h, \qquad \dot h + h / \tau = g \dot S_e

    with the second Piola-Kirchhoff stress S_e of the law at once after loading; after a time much
    longer than tau a part 1 - g of the stress is left.

    Parameters
    ----------
    law : callable
        ``law(F) -> P`` without a state, such as `NeoHooke`.
    g : float
        The part that relaxes, between 0 and 1.
    tau : float
        Relaxation time.

    Attributes
    ----------
    state : dict
        "relaxing" and "Se", both (3, 3).

    Raises
    ------
    InputError
        A constant outside its range, or a law with a state.

    References
    ----------
    J. C. Simo and T. J. R. Hughes, Computational Inelasticity, Springer 1998, section 10.3.

    Examples
    --------
    >>> law = Viscous(NeoHooke(1.0, 9.0), g=0.5, tau=1.0)
    >>> law.state["relaxing"].shape
    (3, 3)
    """

    law: Any
    g: float
    tau: float
    state: dict[str, Any] = field(
        init=False,
        repr=False,
        default_factory=lambda: {"relaxing": np.zeros((3, 3)), "Se": np.zeros((3, 3))},
    )

    def __post_init__(self) -> None:
        _positive(tau=self.tau, g=self.g)
        if self.g >= 1.0:
            raise InputError(f"g={self.g!r}: expected a number between 0 and 1")
        if not callable(self.law) or getattr(self.law, "state", None):
            raise InputError(f"law={self.law!r}: expected an elastic law, stress(F) -> P")

    def __call__(self, F: Any, state: Any, dt: float) -> tuple[Any, dict[str, Any]]:
        """Stress (3, 3, ...), and the new state."""
        elastic = _times(_turned(cofactor(F) / det(F)), self.law(F))
        x = dt / self.tau
        rate = -np.expm1(-x) / x if x > 0 else 1.0  # exact for a constant rate of S_e
        h = np.exp(-x) * state["relaxing"] + self.g * rate * (elastic - state["Se"])
        return _times(F, (1 - self.g) * elastic + h), {"relaxing": h, "Se": elastic}
