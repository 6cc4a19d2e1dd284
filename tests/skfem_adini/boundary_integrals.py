"""Eigenvalues of the Laplacian by boundary integrals, an oracle for domains with smooth boundaries.

With the single layer potential of a density s, fundamental solution i/4 H_0(k r), a function
satisfies -lap u = k^2 u inside; u = 0, d_n u = 0 or d_n u + a u = 0 on the boundary where

    S s = 0,    (1/2 + K') s = 0    or    (1/2 + K' + a S) s = 0.

The integrals over closed curves are those of R. Kress, Linear Integral Equations (Springer, 3rd ed.
2014), section 12.3: the logarithm is integrated with the weights of the trigonometric interpolant,
the rest by the trapezoidal rule, so errors fall faster than any power. The eigenvalue nearest to a
guess comes from successive linear problems T(k) s = theta T'(k) s, k <- k - theta (A. Ruhe, SIAM
Journal on Numerical Analysis 10 (1973), 674-689).
"""

import numpy as np
from scipy.special import hankel1, jv


class Curve:
    """A closed smooth curve z(t) = x + i y, t in [0, 2 pi], the domain on its left."""

    def __init__(self, z, count):
        t = 2 * np.pi * np.arange(count) / count
        self.z = z(t)
        wave = 1j * np.fft.fftfreq(count, 1 / count)
        wave[count // 2] = 0
        self.slope = np.fft.ifft(wave * np.fft.fft(self.z))
        self.bend = np.fft.ifft(wave**2 * np.fft.fft(self.z))
        self.speed = np.abs(self.slope)
        self.normal = -1j * self.slope / self.speed
        self.t, self.step = t, 2 * np.pi / count

    @property
    def length(self):
        return self.step * self.speed.sum()

    @property
    def area(self):
        return self.step * (self.z.conj() * self.slope).imag.sum() / 2


def dot(a, b):
    return (a.conj() * b).real


def logarithmic_weights(count):
    half = count // 2
    t = 2 * np.pi * np.arange(count) / count
    order = np.arange(1, half)
    row = -(2 / half) * (np.cos(np.outer(t, order)) / order).sum(axis=1)
    row = np.pi * (row - np.cos(half * t) / half**2)
    return row[(np.arange(count)[:, None] - np.arange(count)) % count]


def layers(k, target, source):
    """Matrices of S and K' from one curve to another or to itself."""
    d = target.z[:, None] - source.z
    same = target is source
    r = np.abs(d) + (np.eye(len(d)) if same else 0)
    towards = dot(target.normal[:, None], d) / r
    S, K = 0.25j * hankel1(0, k * r), -0.25j * k * hankel1(1, k * r) * towards
    if not same:
        return S * source.speed * source.step, K * source.speed * source.step
    S_log, K_log = -jv(0, k * r) / (4 * np.pi), k * jv(1, k * r) * towards / (4 * np.pi)
    angle = source.t[:, None] - source.t
    logarithm = np.log(4 * np.sin(angle / 2) ** 2 + np.eye(len(d)))
    S, K = S - S_log * logarithm, K - K_log * logarithm
    diagonal = np.arange(len(d))
    S_log[diagonal, diagonal] = -1 / (4 * np.pi)
    S[diagonal, diagonal] = (
        0.25j - np.euler_gamma / (2 * np.pi) - np.log(k * source.speed / 2) / (2 * np.pi)
    )
    K_log[diagonal, diagonal] = 0
    K[diagonal, diagonal] = dot(source.normal, source.bend) / (4 * np.pi * source.speed**2)
    weights = logarithmic_weights(len(d))
    return tuple(
        (weights * log + source.step * rest) * source.speed
        for log, rest in ((S_log, S), (K_log, K))
    )


def operator(k, curves, robin):
    rows = [[layers(k, target, source) for source in curves] for target in curves]
    S, K = (np.block([[pair[i] for pair in row] for row in rows]) for i in (0, 1))
    return S if robin is None else np.eye(len(S)) / 2 + K + robin * S


def eigenvalue(curves, guess, robin=None):
    """Return the eigenvalue nearest to a guess; robin None for u = 0, 0 for d_n u = 0."""
    k, d = np.sqrt(guess), 1e-4
    for _ in range(8):
        slope = (operator(k + d, curves, robin) - operator(k - d, curves, robin)) / (2 * d)
        inverse = np.linalg.eigvals(np.linalg.solve(operator(k, curves, robin), slope))
        step = 1 / inverse[np.abs(inverse).argmax()]
        k = (k - step).real
        if abs(step) < 1e-12 * k:
            break
    return k**2
