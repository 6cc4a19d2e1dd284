"""Errata of the dissertation: what is printed, what is right, and numbers that tell them apart.

A check returns two errors, that of the printed form and that of the corrected one, measured
against a third computation that uses neither.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from skfem import InteriorFacetBasis, MeshQuad

from skfem_adini import ElementQuadAdini

Pair = tuple[float, float]


def cubic_derivative() -> Pair:
    """(2.23) against the derivative of (2.22), by a central difference."""
    u0, u1, v0, v1, h, x, e = 0.3, 1.1, -0.7, 0.4, 0.2, -0.06, 1e-5

    def cubic(x: float) -> float:
        a2, a3 = (2 * v1 + v0) * h - 3 * (u1 - u0), (v1 + v0) * h - 2 * (u1 - u0)
        return u1 + v1 * x + a2 / h**2 * x**2 + a3 / h**3 * x**3

    def slope(sign: int) -> float:
        a2 = 2 * (2 * v1 + sign * v0) * h - 6 * (u1 - u0)
        a3 = 3 * (v1 + sign * v0) * h - 6 * (u1 - u0)
        return v1 + a2 / h**2 * x + a3 / h**3 * x**2

    exact = (cubic(x + e) - cubic(x - e)) / (2 * e)
    return abs(slope(-1) - exact), abs(slope(1) - exact)


def tangents() -> Pair:
    """The left tangent of (2.17) at the left node, where it must take the node's value."""
    h, u, v = 0.2, 0.3, -0.7
    x = -h / 2
    return abs((x - h / 2) * v + u - u), abs((x + h / 2) * v + u - u)


def crossing() -> Pair:
    """The abscissa x* of (2.17): distance of the two tangents there."""
    h, u0, u1, v0, v1 = 0.2, 0.3, 0.32, 0.7, -0.4
    top = (v1 + v0) * h - 2 * (u1 - u0)
    apart = [
        abs(u0 + (x + h / 2) * v0 - u1 - (x - h / 2) * v1)
        for x in (top / (2 * (u1 - u0)), top / (2 * (v1 - v0)))
    ]
    return apart[0], apart[1]


def branches() -> Pair:
    """(2.18) for concave data at the left node: the larger tangent, or the smaller one."""
    h, u0, u1, v1 = 0.2, 0.3, 0.3, -0.7
    left, right = u0, u1 - h * v1
    return abs(max(left, right) - u0), abs(min(left, right) - u0)


def _flow(x: float, t: float) -> float:
    """Where the point x of x' = x - x^3 is after t."""
    return float(x * np.exp(t) / np.sqrt(1 - x**2 + x**2 * np.exp(2 * t)))


def _bell(x: float) -> float:
    return float(np.exp(-10 * x**2))


def _density(x: float, t: float) -> float:
    """The solution of example 2 from the flow alone: u0(y) dy/dx."""
    e = 1e-6
    return _bell(_flow(x, -t)) * (_flow(x + e, -t) - _flow(x - e, -t)) / (2 * e)


def duhamel() -> Pair:
    """(2.13): the derivative of p after a step, against differences of the exact p."""
    x, dt = 0.4, 0.3
    e = 1e-4
    exact = (_density(x + e, dt) - _density(x - e, dt)) / (2 * e)
    node, weight = np.polynomial.legendre.leggauss(20)

    def integral(f: Callable[[float], float], a: float, b: float) -> float:
        s = (a + b) / 2 + (b - a) / 2 * node
        return float((b - a) / 2 * sum(w * f(each) for w, each in zip(weight, s, strict=True)))

    def growth(s: float) -> float:  # exp(-2 int_s^0 c'(x(t)) dt)
        return float(np.exp(-2 * integral(lambda t: 1 - 3 * _flow(x, t) ** 2, s, 0.0)))

    def source(s: float) -> float:  # c'' p on the characteristic
        return -6 * _flow(x, s) * _density(_flow(x, s), dt + s)

    y = _flow(x, -dt)
    start = growth(-dt) * -20 * y * _bell(y)
    printed = start - integral(lambda s: growth(-s) * source(s), -dt, 0.0)
    right = start - integral(lambda s: growth(s) * source(s), -dt, 0.0)
    return abs(printed / exact - 1), abs(right / exact - 1)


def example_1_outside() -> Pair:
    """The solution of example 1 at x = 1.5, t = 1, where the characteristic came from infinity."""
    x, t = 1.5, 1.0
    printed = np.exp(-10 * x**2 * np.exp(-2 * t) / (1 - x**2 + np.exp(-2 * t) * x**2))
    return float(printed), 0.0


def example_2_solution() -> Pair:
    """The solution of example 2 at x = .5, t = 1, relative."""
    x, t = 0.5, 1.0
    E = np.exp(2 * t)
    power = ((-2 * t + 2 * t * x**2) * E - 2 * x**2 * (-5 + t)) / (-(x**2) - E + E * x**2)
    root = np.sqrt((x**2 + E - E * x**2) / x**2)
    printed = np.exp(power) / (root * ((-x + x**3) * E - x**3))
    d = 1 - x**2 + x**2 / E
    right = _bell(x * np.exp(-t) / np.sqrt(d)) * np.exp(-t) * d**-1.5
    exact = _density(x, t)
    return abs(printed / exact - 1), abs(right / exact - 1)


def advection_factor() -> Pair:
    """(3.14) for c = (x1 x2, sin x1): the factor against the determinant of the map of feet."""

    def rate(z: np.ndarray) -> np.ndarray:  # x1, x2 and (3.13)
        return np.array([z[0] * z[1], np.sin(z[0]), -z[1] * z[2]])

    def back(x: np.ndarray, dt: float = 0.3, steps: int = 200) -> np.ndarray:
        z, h = np.append(x, 1.0), -dt / steps
        for _ in range(steps):
            k1 = rate(z)
            k2 = rate(z + h / 2 * k1)
            k3 = rate(z + h / 2 * k2)
            z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(z + h * k3))
        return np.asarray(z)

    x, e = np.array([0.7, 0.4]), 1e-5
    columns = [(back(x + e * d)[:2] - back(x - e * d)[:2]) / (2 * e) for d in np.eye(2)]
    exact, y3 = np.linalg.det(np.array(columns)), back(x)[2]
    return abs(y3 / exact - 1), abs(1 / (y3 * exact) - 1)


def smoothed_product() -> Pair:
    """|lambda u| of the smoothed modulus, lambda = u / max(eps, |u|), over the eps of u."""
    u, eps = np.linspace(-3, 3, 61), 1.0
    exact = np.abs(u / np.maximum(eps, np.abs(u)) * u)
    printed = np.abs(u) * np.maximum(0, np.abs(u) - eps)
    right = np.abs(u) * np.minimum(1, np.abs(u) / eps)
    return float(np.abs(printed - exact).max()), float(np.abs(right - exact).max())


def descent() -> Pair:
    """The inequality in the proof of Theorem 1: share of random pairs that violate it."""
    rng, eps = np.random.default_rng(0), 0.5
    old, new = rng.standard_normal((2, 10000, 2))

    def psi(s: np.ndarray) -> np.ndarray:
        return np.where(s >= eps, s, s**2 / (2 * eps) + eps / 2)

    sizes = np.linalg.norm(old, axis=1), np.linalg.norm(new, axis=1)
    scale = np.maximum(eps, sizes[0])
    left = np.sum(new * (new - old), axis=1) / scale
    rise = psi(sizes[1]) - psi(sizes[0])
    moved = np.sum((new - old) ** 2, axis=1) / (2 * scale)
    return float(np.mean(left > rise + 1e-12)), float(np.mean(left < rise + moved - 1e-12))


def second_derivative() -> Pair:
    """psi'' for |s| > eps in two dimensions, against differences of psi' = s / |s|."""
    s, e = np.array([0.8, -0.5]), 1e-6
    size = np.linalg.norm(s)
    exact = np.array([((s + e * d) / np.linalg.norm(s + e * d)
                       - (s - e * d) / np.linalg.norm(s - e * d)) / (2 * e)
                      for d in np.eye(2)])  # fmt: skip
    right = (np.eye(2) - np.outer(s, s) / size**2) / size
    return float(np.abs(exact).max()), float(np.abs(exact - right).max())


def rotation_energy() -> Pair:
    """Energy density of the rotation (-y, x) in section 5.1.1, mu = lambda = 1; it must be zero."""
    u1_y, u2_x = -1.0, 1.0
    squares = u1_y**2 + u2_x**2
    return abs(squares + u1_y * u2_x), abs(squares + 2 * u1_y * u2_x)


def smoothness() -> Pair:
    """Largest jump over edges of the normal derivative, and of the value, of random dofs."""
    mesh = MeshQuad().refined(2)
    sides = [InteriorFacetBasis(mesh, ElementQuadAdini(), side=side) for side in (0, 1)]
    x = np.random.default_rng(0).standard_normal(sides[0].N)
    a, b = (side.interpolate(x) for side in sides)
    slope = np.sum((np.asarray(a.grad) - np.asarray(b.grad)) * sides[0].normals, axis=0)
    return float(np.abs(slope).max()), float(np.abs(np.asarray(a) - np.asarray(b)).max())


def friction_weights() -> Pair:
    """The sum for the friction integral of u_t = 1 on ten cells; the integral is one."""
    N = 10
    weights = np.zeros(3 * N + 1)
    for cell in range(N):
        weights[3 * cell : 3 * cell + 4] += np.array([1, 3, 3, 1]) / (8 * N)
    return float(abs(len(weights) - 1)), float(abs(weights.sum() - 1))


def complex_basis() -> Pair:
    """Step 3 of Algorithm 5 for complex eigenvectors V, Y = P V: error of Y (V^T V)^-1 V^* on V."""
    rng = np.random.default_rng(0)
    V = rng.standard_normal((8, 3)) + 1j * rng.standard_normal((8, 3))
    Y = rng.standard_normal((8, 8)) @ V
    errors = [
        np.linalg.norm(Y @ np.linalg.solve(left @ V, V.conj().T @ V) - Y) / np.linalg.norm(Y)
        for left in (V.T, V.conj().T)
    ]
    return float(errors[0]), float(errors[1])


def restart_residual() -> Pair:
    """Algorithm 6: what is missing in M V = V H + f e^T after the shifts, relative to M."""
    rng, n, m, k = np.random.default_rng(0), 40, 12, 7
    M = rng.standard_normal((n, n))
    V, H = np.zeros((n, m)), np.zeros((m, m))
    f = rng.standard_normal(n)
    for j in range(m):
        size = np.linalg.norm(f)
        V[:, j] = f / size
        if j:
            H[j, j - 1] = size
        f = M @ V[:, j]
        for _ in range(2):
            h = V[:, : j + 1].T @ f
            f, H[: j + 1, j] = f - V[:, : j + 1] @ h, H[: j + 1, j] + h
    shifts = np.sort(np.linalg.eigvals(H).real)[: m - k]
    q = np.eye(m)[-1]
    for shift in shifts:
        Q = np.linalg.qr(H - shift * np.eye(m))[0]
        H, V, q = Q.T @ H @ Q, V @ Q, q @ Q
    lack = M @ V[:, :k] - V[:, :k] @ H[:k, :k]
    right = V[:, k] * H[k, k - 1] + f * q[k - 1]
    size = np.linalg.norm(M)
    return (
        float(np.linalg.norm(lack[:, -1] - f) / size),
        float(np.linalg.norm(lack[:, -1] - right) / size),
    )


def heat_rate() -> Pair:
    """(6.11): the decay of cos(pi x) under the heat equation, relative; it is pi^2."""
    e = 1e-4
    exact = (2 * np.cos(np.pi * e) - 2) / e**2  # second difference at x = 0
    return abs(-(np.pi**4) / exact - 1), abs(-(np.pi**2) / exact - 1)


def forecast_covariance() -> Pair:
    """P^b after two steps of a random linear model, against the covariance of the whole history."""
    rng = np.random.default_rng(0)
    M0, M1, *roots = rng.standard_normal((4, 4, 4))
    P, Q = (root @ root.T for root in roots)
    history = np.hstack([M1 @ M0, M1, np.eye(4)])
    zero = np.zeros((4, 4))
    exact = history @ np.block([[P, zero, zero], [zero, Q, zero], [zero, zero, Q]]) @ history.T
    inner = M1 @ (M0 @ P @ M0.T + Q) @ M1.T
    size = np.linalg.norm(exact)
    return (
        float(np.linalg.norm(inner - exact) / size),
        float(np.linalg.norm(inner + Q - exact) / size),
    )


CHECKS: dict[str, Callable[[], Pair]] = {
    check.__name__: check
    for check in (
        *(cubic_derivative, tangents, crossing, branches, duhamel),
        *(example_1_outside, example_2_solution, advection_factor),
        *(smoothed_product, descent, second_derivative, rotation_energy, smoothness),
        *(friction_weights, complex_basis, restart_residual, heat_rate, forecast_covariance),
    )
}
