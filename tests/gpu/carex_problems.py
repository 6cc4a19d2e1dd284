"""Riccati benchmark problems from their published formulas, with exact solutions where known.

P. Benner, A. J. Laub and V. Mehrmann, A collection of benchmark examples for the numerical
solution of algebraic Riccati equations I: continuous-time case, report SPC 95_22, TU Chemnitz
1995; parameters and conventions as in CAREX 2.0 (J. Abels and P. Benner, SLICOT note 1999-14).
"""

from typing import NamedTuple

import numpy as np

SQRT2 = np.sqrt(2.0)


class Example(NamedTuple):
    A: np.ndarray
    B: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    X: np.ndarray | None = None


def example_1_1():
    return Example(
        np.array([[0.0, 1], [0, 0]]), np.array([[0.0], [1]]), np.diag([1.0, 2]), np.eye(1),
        np.array([[2.0, 1], [1, 2]]),
    )  # fmt: skip


def example_1_2():
    Q = np.array([[9.0, 6], [6, 4]])
    A, B = np.array([[4.0, 3], [-4.5, -3.5]]), np.array([[1.0], [-1]])
    return Example(A, B, Q, np.eye(1), (1 + SQRT2) * Q)


def example_1_3():
    """L-1011 aircraft: S. Beale and B. Shafai, Int. J. Control 50 (1989)."""
    A = np.array(
        [[0, 1, 0, 0], [0, -1.89, 0.39, -5.53], [0, -0.034, -2.98, 2.43],
         [0.034, -0.0011, -0.99, -0.21]],
    )  # fmt: skip
    B = np.array([[0, 0], [0.36, -1.6], [-0.95, -0.032], [0.03, 0]])
    Q = np.array(
        [[2.313, 2.727, 0.688, 0.023], [2.727, 4.271, 1.148, 0.323],
         [0.688, 1.148, 0.313, 0.102], [0.023, 0.323, 0.102, 0.083]],
    )  # fmt: skip
    return Example(A, B, Q, np.eye(2))


def example_1_4():
    """Binary distillation column: S. P. Bhattacharyya et al., IEEE TAC 28 (1983); Q indefinite."""
    A = np.diag([-0.991, -1.051, -1.118, -1.548, -1.640, -1.721, -1.823, -1.943])
    A += np.diag([0.529, 0.596, 0.596, 0.718, 0.799, 0.901, 1.021], 1)
    A += np.diag([0.522, 0.522, 0.522, 0.922, 0.922, 0.922, 0.922], -1)
    B = 1e-3 * np.array(
        [[3.84, 4.00, 37.60, 3.08, 2.36, 2.88, 3.08, 3.00],
         [-2.88, -3.04, -2.80, -2.32, -3.32, -3.82, -4.12, -3.96]],
    ).T  # fmt: skip
    Q = np.diag([1, 1, 1, 1, 0.1, 0.1, 0.1, 0.1])
    Q[0, 4] = Q[4, 0] = Q[2, 5] = Q[5, 2] = 0.5
    Q[0, 7] = Q[7, 0] = Q[1, 4] = Q[4, 1] = 0.1
    return Example(A, B, Q, np.eye(2))


def example_1_5():
    """Tubular ammonia reactor: L. M. Patnaik et al., IEEE TAC 25 (1980)."""
    A = np.zeros((9, 9))
    A[:5, :5] = [
        [-4.019, 5.12, 0, 0, -2.082], [-0.346, 0.986, 0, 0, -2.34],
        [-7.909, 15.407, -4.069, 0, -6.45], [-21.816, 35.606, -0.339, -3.87, -17.8],
        [-60.196, 98.188, -7.907, 0.34, -53.008],
    ]  # fmt: skip
    A[:5, 8] = [0.87, 0.97, 2.68, 7.39, 20.4]
    A[5, 4:8] = [94, -147.2, 0, 53.2]
    A[6, 5:7] = [94, -147.2]
    A[7, 5:8] = [12.8, 0, -31.6]
    A[8, 4:9] = [12.8, 0, 0, 18.8, -31.6]
    B = np.zeros((9, 3))
    B[:5, 0] = [0.01, 0.003, 0.009, 0.024, 0.068]
    B[:5, 1] = [-0.011, -0.021, -0.059, -0.162, -0.445]
    B[0, 2] = -0.151
    return Example(A, B, np.eye(9), np.eye(3))


def example_2_1(e):
    T = np.hypot(1.0, e)
    x12 = 1 / (2 + T)
    X = np.array([[(1 + T) / e / e, x12], [x12, (1 - e * x12) * (1 + e * x12) / 4]])
    return Example(np.diag([1.0, -2]), np.array([[e], [0.0]]), np.ones((2, 2)), np.eye(1), X)


def example_2_2(e):
    C = np.array([[10.0, 100]])
    R = np.array([[1 + e, 1], [1, 1]])
    return Example(np.diag([-0.1, -0.02]), np.array([[0.1, 0], [0.001, 0.01]]), C.T @ C, R)


def example_2_3(e):
    T = np.sqrt(1 + 2 * e)
    X = np.array([[T / e, 1], [1, T]])
    return Example(np.array([[0, e], [0, 0]]), np.array([[0.0], [1]]), np.eye(2), np.eye(1), X)


def example_2_4(e):
    T = e + 1.0
    x = (2 * T + SQRT2 * (np.sqrt(T * T + 1) + e)) / 2
    y = x / (x - T)
    X = np.array([[x, y], [y, x]])
    return Example(np.array([[T, 1], [1, T]]), np.eye(2), e * e * np.eye(2), np.eye(2), X)


def example_2_5(e):
    A, B = np.array([[3 - e, 1], [4, 2 - e]]), np.ones((2, 1))
    Q = np.array([[4 * e - 11, 2 * e - 5], [2 * e - 5, 2 * e - 2]])
    return Example(A, B, Q, np.eye(1), np.array([[2.0, 1], [1, 1]]))


def example_2_6(e):
    V = np.eye(3) - 2 / 3
    i, q = np.arange(1, 4), np.array([1 / e, 1, e])
    # Each entry solves x^2 / e - 2 e i x - q = 0.
    x = e * (e * i + np.sqrt((e * i) ** 2 + q / e))
    A, Q, X = (V @ np.diag(d) @ V for d in (e * i, q, x))
    return Example(A, np.eye(3), (Q + Q.T) / 2, e * np.eye(3), X)


def example_2_7(e):
    A = np.zeros((4, 4))
    A[0, 1], A[1, 2] = 0.4, 0.345
    A[2, 1:] = np.array([-0.524, -0.465, 0.262]) / e
    A[3, 3] = -1 / e
    B = np.array([[0.0], [0], [0], [1 / e]])
    return Example(A, B, np.diag([1.0, 0, 1, 0]), np.eye(1))


def example_2_8(e):
    A = np.array([[-e, 1, 0, 0], [-1, -e, 0, 0], [0, 0, e, 1], [0, 0, -1, e]])
    return Example(A, np.ones((4, 1)), np.ones((4, 4)), np.eye(1))


def example_3_1(vehicles):
    n = 2 * vehicles - 1
    A, B, Q = np.zeros((n, n)), np.zeros((n, vehicles)), np.zeros((n, n))
    speed, distance = np.arange(0, n, 2), np.arange(1, n, 2)
    A[speed, speed] = -1.0
    A[distance, distance - 1], A[distance, distance + 1] = 1.0, -1.0
    B[speed, np.arange(vehicles)] = 1.0
    Q[distance, distance] = 10.0
    return Example(A, B, Q, np.eye(vehicles))


def example_3_2(n):
    A = -2 * np.eye(n) + np.roll(np.eye(n), 1, axis=0) + np.roll(np.eye(n), -1, axis=0)
    c = np.cos(2 * np.pi * np.arange(n) / n)
    column = np.fft.ifft(-2 + 2 * c + np.sqrt(5 - 8 * c + 4 * c * c)).real
    X = column[(np.arange(n)[:, None] - np.arange(n)) % n]
    return Example(A, np.eye(n), np.eye(n), np.eye(n), X)


def example_4_1(n, q=1.0, r=1.0):
    """A chain of integrators; only X[0, n-1] = sqrt(q r) is known."""
    B, Q = np.zeros((n, 1)), np.zeros((n, n))
    B[-1], Q[0, 0] = 1.0, q
    return Example(np.eye(n, k=1), B, Q, r * np.eye(1))


def example_4_2(n, a=0.05, b=1.0, c=1.0, support=(0.2, 0.3)):
    """Heat equation, linear elements, as E x' = A x + B u: returns it with its mass matrix."""
    h = 1.0 / (n + 1)
    A = a / h * (np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n))
    E = h / 6 * (np.eye(n, k=1) + np.eye(n, k=-1) + 4 * np.eye(n))
    nodes = np.arange(1, n + 1) * h
    points = np.linspace(*support, 2001)
    hats = np.maximum(0.0, 1 - np.abs(points - nodes[:, None]) / h)
    load = np.trapezoid(hats, points, axis=1)[:, None]
    return Example(A, b * load, c * c * load @ load.T, np.eye(1)), E


def example_4_3(masses, mu=1.0, delta=4.0, kappa=1.0):
    """Masses coupled by springs, forces at both ends; the chain is free to move as a whole."""
    n = masses
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-kappa / mu * K, -delta / mu * np.eye(n)]])
    B = np.zeros((2 * n, 2))
    B[n, 0], B[-1, 1] = 1 / mu, -1 / mu
    return Example(A, B, np.eye(2 * n), np.eye(2)), kappa * K


# By parameters: benign and hard ones with a known solution, and others.
BENIGN = {
    "1.1": example_1_1(),
    "1.2": example_1_2(),
    **{f"2.1 e={e}": example_2_1(e) for e in (1.0, 1e-2)},
    **{f"2.3 e={e}": example_2_3(e) for e in (1.0, 1e2)},
    **{f"2.4 e={e}": example_2_4(e) for e in (1.0,)},
    **{f"2.5 e={e}": example_2_5(e) for e in (1.0,)},
    **{f"2.6 e={e}": example_2_6(e) for e in (1.0,)},
    **{f"3.2 n={n}": example_3_2(n) for n in (3, 64)},
}
HARD = {
    "2.1 e=1e-06": example_2_1(1e-6),
    **{f"2.3 e={e}": example_2_3(e) for e in (1e6, 1e-6)},
    **{f"2.4 e={e}": example_2_4(e) for e in (1e-5, 1e-7)},
    **{f"2.5 e={e}": example_2_5(e) for e in (1e-3, 1e-6)},
    **{f"2.6 e={e}": example_2_6(e) for e in (1e-3, 1e3, 1e6)},
}
UNKNOWN = {
    "1.3": example_1_3(),
    "1.5": example_1_5(),
    **{f"2.2 e={e}": example_2_2(e) for e in (1.0, 1e-8)},
    **{f"2.7 e={e}": example_2_7(e) for e in (1.0, 1e-6)},
    **{f"2.8 e={e}": example_2_8(e) for e in (1.0, 1e-6)},
    "3.1 l=20": example_3_1(20),
    "4.1 n=21": example_4_1(21),
    "4.3 l=30": example_4_3(30)[0],
}
