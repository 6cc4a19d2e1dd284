"""Periodic contact beside closed forms: Westergaard, Johnson, Hertz, and the wave of a coating.

* Westergaard (J. Appl. Mech. 6 (1939) 49): a sinusoid of height h and wavelength one on a half
  plane under the mean pressure s pi E* h. In partial contact, s < 1, the pressure is
  2 pi E* h cos(pi x) sqrt(s - sin^2(pi x)); for s >= 1 it is pi E* h (s + cos(2 pi x)).
* Johnson, Greenwood and Higginson (Int. J. Mech. Sci. 27 (1985) 383): the product of two waves is
  in full contact from the mean pressure sqrt(2) pi E* h on, which is the pressure's amplitude then.
* Hertz' ball in a period of many radii.
* A coating bonded to a half plane: the state s = (u, w, sigma_xz, sigma_zz) of a wave e^(ikx) obeys
  s' = A s through the depth, and the half plane takes what decays.

The errors are relative, and their orders are fitted over the meshes.

    python examples/validation_periodic.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import scipy.linalg

from contact import GridContact, HalfSpace, Parabola, PeriodicLayers, Rigid

E, NU, HEIGHT = 1.0, 0.3, 1e-3
STAR = E / (1 - NU**2)
FULL = np.pi * STAR * HEIGHT
BODIES = {
    "half plane": lambda n: HalfSpace(1.0, n, E, NU),
    "thick block": lambda n: PeriodicLayers(1.0, [(2.0, 2 * n, E, NU)], n),
    "layers on a half plane": lambda n: PeriodicLayers(
        1.0, [(0.25, n // 4, E, NU)], n, base=(E, NU)
    ),
}
COATING = (0.125, 100.0, 0.2)  # thickness in wavelengths, E and nu of the coating


def westergaard(x: np.ndarray, share: float) -> np.ndarray:
    """Pressure over pi E* h."""
    if share >= 1:
        return share + np.cos(2 * np.pi * x)
    inside = np.maximum(share - np.sin(np.pi * x) ** 2, 0.0)
    return 2 * np.abs(np.cos(np.pi * x)) * np.sqrt(inside)


def sinusoid(body: str, share: float, n: int) -> list[float]:
    """Errors: highest pressure, its longest wave, mean gap over h, rms of the pressure over max."""
    x = (np.arange(n) + 0.25) / n  # no point on the crest
    ground = Rigid(HEIGHT * (1 - np.cos(2 * np.pi * x)), force=(None, share * FULL))
    found = GridContact(BODIES[body](n), ground).solve()
    fine = np.arange(2**14) / 2**14
    waves = np.fft.rfft(westergaard(fine, share))
    u = np.fft.irfft(np.r_[0.0, HEIGHT * waves[1:] / np.arange(1, waves.size)], fine.size)
    gap = HEIGHT * (1 - np.cos(2 * np.pi * fine)) + u
    p, wanted = found.pressure / FULL, westergaard(x, share)
    return [
        abs(p.max() / wanted.max() - 1),
        abs(abs(np.fft.rfft(p)[1]) / n / (abs(waves[1]) / fine.size) - 1),
        abs(found.opening.mean() - (gap - gap.min()).mean()) / HEIGHT,
        np.sqrt(np.mean((p - wanted) ** 2)) / wanted.max(),
    ]


def two_waves(n: int) -> list[float]:
    """Error of the amplitude of the pressure in full contact, on a thick block."""
    wave = np.cos(2 * np.pi * np.arange(n) / n)
    product, top = wave[:, None] * wave, np.sqrt(2) * FULL
    block = PeriodicLayers((1.0, 1.0), [(1.5, 3 * n // 2, E, NU)], (n, n))
    ground = Rigid(HEIGHT * (1 - product), force=(None, None, 1.1 * top))
    found = GridContact(block, ground).solve()
    return [abs(np.sum(found.pressure * product) / np.sum(product**2) / top - 1)]


def ball(n: int) -> list[float]:
    """Rms of the pressure over p0 within two radii, and the corrected area: a half space."""
    force, radius, place = 2e-4, 2.0, np.array([0.501, 0.4985])
    a = (0.75 * force * radius / STAR) ** (1 / 3)
    obstacle = Rigid(Parabola((*place, 0.0), radius), force=(None, None, force))
    contact = GridContact(HalfSpace((1.0, 1.0), (n, n), E, NU), obstacle)
    found, x = contact.solve(), contact.points()
    r = np.hypot(x[0] - place[0], x[1] - place[1])
    p = found.pressure / (1.5 * force / (np.pi * a**2))
    error = p - np.sqrt(np.maximum(1 - (r / a) ** 2, 0.0))
    return [
        np.sqrt(np.mean(error[r < 2 * a] ** 2)),
        abs(found.corrected_area / (np.pi * a**2) - 1),
    ]


def state_matrix(k: float, young: float, ratio: float) -> np.ndarray:
    """A of s' = A s in plane strain."""
    mu = young / (2 * (1 + ratio))
    lame = 2 * mu * ratio / (1 - 2 * ratio)
    axial, ik = lame + 2 * mu, 1j * k
    return np.array(
        [
            [0, -ik, 1 / mu, 0],
            [-ik * lame / axial, 0, 0, 1 / axial],
            [k**2 * (axial - lame**2 / axial), 0, 0, -ik * lame / axial],
            [0, 0, -ik, 0],
        ]
    )


def symbol_of_coating(k: float, coating: tuple[float, float, float]) -> np.ndarray:
    """Displacements (u, w) of the coated half plane's surface per traction on it."""
    thickness, *material = coating
    T = scipy.linalg.expm(thickness * state_matrix(k, *material))
    _, decaying, _ = scipy.linalg.schur(state_matrix(k, E, NU), output="complex", sort="lhp")
    unknown = np.hstack([T[:, :2], -decaying[:, :2]])
    return np.linalg.solve(unknown, T[:, 2:])[:2]


def coated(n: int) -> list[float]:
    """Errors of the normal and of the tangential wave, n points a wave."""
    exact = symbol_of_coating(2 * np.pi, COATING)
    thickness, *material = COATING
    layer = (thickness, round(thickness * n), *material)
    block = PeriodicLayers(1.0, [layer], n, base=(E, NU))
    errors = []
    for c in (1, 0):
        forces = np.zeros((2, n))
        forces[c] = np.cos(2 * np.pi * np.arange(n) / n) / n
        wave = np.fft.rfft(block.apply(forces), axis=1)[:, 1] / (n / 2)
        errors.append(np.linalg.norm(wave - exact[:, c]) / np.linalg.norm(exact[:, c]))
    return errors


def series(case, sizes: tuple[int, ...]) -> SimpleNamespace:
    """Errors over the meshes, shape (meshes, quantities), and their orders."""
    errors = np.array([case(n) for n in sizes])
    kept = np.maximum(errors, 1e-15)
    return SimpleNamespace(
        sizes=sizes, errors=errors, orders=-np.polyfit(np.log(sizes), np.log(kept), 1)[0]
    )


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Run, print, draw the orders."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, nargs="*", default=[32, 64, 128])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the picture")
    options = parser.parse_args(argv)
    sizes = tuple(options.points)
    found = {
        f"{body}, s = {share}": series(lambda n, b=body, s=share: sinusoid(b, s, n), sizes)
        for body in BODIES
        for share in (0.2, 0.5, 0.8, 1.2)
    }
    found["two waves, full contact"] = series(two_waves, tuple(3 * n // 4 for n in sizes))
    found["ball"] = series(ball, tuple(2 * n for n in sizes))
    found["coating"] = series(coated, sizes)
    for name, case in found.items():
        print(f"{name:32s}", *(f"{error:.1e}" for error in case.errors[-1]), end="   orders")
        print("", *(f"{order:.1f}" for order in case.orders))
    picture(found, options.output)
    return SimpleNamespace(cases=found)


def picture(found: dict[str, SimpleNamespace], output: Path) -> None:
    """Pressure under a sinusoid, and all errors over the meshes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    x, n = np.linspace(-0.5, 0.5, 401), 64
    for share, colour in ((0.2, "#1f6f8b"), (0.5, "#6a994e"), (0.8, "#d1495b")):
        left.plot(x, westergaard(x, share), color=colour, lw=1)
        at = (np.arange(n) + 0.25) / n
        ground = Rigid(HEIGHT * (1 - np.cos(2 * np.pi * at)), force=(None, share * FULL))
        p = GridContact(BODIES["thick block"](n), ground).solve().pressure / FULL
        left.plot(at - np.round(at), p, "o", ms=3, mfc="none", color=colour, label=f"s = {share}")
    left.set(xlabel="x / wavelength", ylabel=r"pressure / ($\pi E^* h$)", title="Westergaard")
    left.legend()
    for name in ("thick block, s = 0.5", "thick block, s = 1.2", "two waves, full contact",
                 "ball", "coating"):  # fmt: skip
        right.loglog(found[name].sizes, found[name].errors[:, 0], "o-", ms=3, lw=1, label=name)
    right.set_xscale("log", base=2)
    right.set(xlabel="points along a period", ylabel="relative error", ylim=(1e-5, 2.0))
    right.legend(fontsize=7, loc="upper right", ncols=2)
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_periodic.png", dpi=150)


if __name__ == "__main__":
    main()
