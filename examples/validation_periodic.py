"""Periodic contact beside closed forms: Westergaard, Johnson, Hertz, and the wave of a coating.

* Westergaard (J. Appl. Mech. 6 (1939) 49): a sinusoid of height h and wavelength one on a half
  plane under the mean pressure s pi E* h. In partial contact, s < 1, the pressure is
  2 pi E* h cos(pi x) sqrt(s - sin^2(pi x)); for s >= 1 it is pi E* h (s + cos(2 pi x)).
* Johnson, Greenwood and Higginson (Int. J. Mech. Sci. 27 (1985) 383): the product of two waves is
  in full contact from the mean pressure sqrt(2) pi E* h on, which is the pressure's amplitude then.
  At light contact each crest is round but for a term cos(4 theta): the axisymmetric part, with
  J0(k r) and k = 2 sqrt(2) pi, has the pressure of an integral (Johnson, Contact Mechanics, 5.3),
  the rest is taken to first order, and other crests act as point forces.
* Hertz' ball in a period of seven radii, with the curvature that its images add.
* A coating bonded to a half plane: the state s = (u, w, sigma_xz, sigma_zz) of a wave e^(ikx) obeys
  s' = A s through the depth, and the half plane takes what decays.

Pressures are those of `GridResult.edge`, also next to the edge of contact, and their errors rms
over the largest one; where the grid lies beside the crest does matter, so that errors are the rms
of eight places. Orders are fitted over the meshes.

    python examples/validation_periodic.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import scipy.linalg

from contact import GridContact, HalfSpace, Parabola, PeriodicLayers, Rigid
from skfem_adini import ElementHexAdini, ElementQuadAdini

E, NU, HEIGHT = 1.0, 0.3, 1e-3
STAR = E / (1 - NU**2)
FULL = np.pi * STAR * HEIGHT
BODIES = {
    "half plane": lambda n: HalfSpace(1.0, n, E, NU),
    "thick block": lambda n: PeriodicLayers(
        1.0, [(2.0, 2 * n, E, NU)], n, element=ElementQuadAdini()
    ),
    "layers on a half plane": lambda n: PeriodicLayers(
        1.0, [(0.25, n // 4, E, NU)], n, base=(E, NU)
    ),
}
COATING = (0.125, 100.0, 0.2)  # thickness in wavelengths, E and nu of the coating
PLACES = (np.arange(8) + 0.5) / 16  # of the first point beside the crest, in units of the spacing
THIRD, FIFTH = 9.0336, 5.0903  # sums of r^-3 and r^-5 over a square lattice of spacing one


def westergaard(x: np.ndarray, share: float) -> np.ndarray:
    """Pressure over pi E* h."""
    if share >= 1:
        return share + np.cos(2 * np.pi * x)
    inside = np.maximum(share - np.sin(np.pi * x) ** 2, 0.0)
    return 2 * np.abs(np.cos(np.pi * x)) * np.sqrt(inside)


def sinusoid(body: str, share: float, n: int) -> np.ndarray:
    """Errors: pressure, that by forces alone, half-width, longest wave, mean gap over h."""
    block, fine = BODIES[body](n), np.arange(2**14) / 2**14
    waves = np.fft.rfft(westergaard(fine, share))
    u = np.fft.irfft(np.r_[0.0, HEIGHT * waves[1:] / np.arange(1, waves.size)], fine.size)
    gap = HEIGHT * (1 - np.cos(2 * np.pi * fine)) + u
    half = np.arcsin(np.sqrt(min(share, 1.0))) / np.pi
    found = []
    for place in PLACES:
        x = (np.arange(n) + place) / n
        ground = Rigid(HEIGHT * (1 - np.cos(2 * np.pi * x)), force=(None, share * FULL))
        result = GridContact(block, ground).solve()
        edge, wanted = result.edge(), westergaard(x, share)
        ends = edge.places[0] + place / n
        found.append(
            [
                rms(edge.pressure / FULL - wanted) / wanted.max(),
                rms(result.pressure / FULL - wanted) / wanted.max(),
                (0.5 * (1 - np.ptp(ends)) if ends.size else 0.5) / half - 1,
                abs(np.fft.rfft(result.pressure)[1]) / n / FULL / (abs(waves[1]) / fine.size) - 1,
                (result.opening.mean() - (gap - gap.min()).mean()) / HEIGHT,
            ]
        )
    return rms(np.array(found), axis=0)


def rms(values: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Root mean square."""
    return np.sqrt(np.mean(np.square(values), axis=axis))


def two_waves(n: int) -> list[float]:
    """Error of the pressure in full contact, on a thick block."""
    wave = np.cos(2 * np.pi * np.arange(n) / n)
    product, top = wave[:, None] * wave, np.sqrt(2) * FULL
    block = PeriodicLayers(
        (1.0, 1.0), [(1.5, 3 * n // 2, E, NU)], (n, n), element=ElementHexAdini()
    )
    ground = Rigid(HEIGHT * (1 - product), force=(None, None, 1.1 * top))
    found = GridContact(block, ground).solve()
    return [rms(found.pressure - top * (1.1 + product)) / (2.1 * top)]


def crest(a: float, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Force and pressure of one crest of two waves at the radius a of contact."""
    k, near = 2 * np.sqrt(2) * np.pi, np.hypot(x, y) < 1.2 * a
    own = 2 * STAR * HEIGHT * (np.sin(k * a) / k - a * np.cos(k * a))
    images = (THIRD * 2**1.5 + 0.9 * FIFTH * 2**2.5 * a**2) / (4 * np.pi * STAR)  # 1/sqrt(2) apart
    force = own / (1 - 8 / 3 * STAR * images * a**3)
    r2 = np.where(near, x**2 + y**2, 0.0)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    s = np.sqrt(r2[..., None] + (a**2 - r2[..., None]) * (0.5 * (1 + nodes)) ** 2)
    smooth = STAR * HEIGHT * k**2 / np.pi * np.sinc(k * s / np.pi) @ (0.5 * weights)
    smooth += 4 * STAR * images * force / np.pi
    four = -HEIGHT * k**4 / 96 * STAR / (np.pi * 105 / 384) * (2 * (x**2 - y**2) ** 2 - r2**2)
    inside = np.maximum(a**2 - r2 + four / smooth, 0.0)
    return force, np.where(near, smooth * np.sqrt(inside), 0.0)


def light(n: int) -> list[float]:
    """Errors of the pressure, and of that by forces alone, of two waves: a half space."""
    found = []
    for place in PLACES:
        x, y = np.meshgrid(np.arange(n) + place, np.arange(n) + 0.5 - place, indexing="ij")
        x, y = x / n, y / n
        crests = [crest(0.1, x - i, y - j) for i, j in ((0, 0), (0, 1), (1, 0), (1, 1), (0.5, 0.5))]
        wanted = np.sum([p for _, p in crests], axis=0)
        product = np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y)
        ground = Rigid(HEIGHT * (1 - product), force=(None, None, 2 * crests[0][0]))
        result = GridContact(HalfSpace((1.0, 1.0), (n, n), E, NU), ground).solve()
        found.append(
            [rms(p - wanted) / wanted.max() for p in (result.edge().pressure, result.pressure)]
        )
    return list(rms(np.array(found), axis=0))


def ball(n: int) -> list[float]:
    """Errors of the pressure, of that by forces alone, and of the radius: a half space."""
    radius, a, found = 2.0, 0.15, []
    images = (THIRD + 0.9 * FIFTH * a**2) / (2 * np.pi)
    force = 4 / 3 * STAR * a**3 / radius / (1 - 4 / 3 * a**3 * images)
    for place in PLACES:
        centre = np.array([0.5 + place / n, 0.5 + (0.5 - place) / n])
        obstacle = Rigid(Parabola((*centre, 0.0), radius), force=(None, None, force))
        contact = GridContact(HalfSpace((1.0, 1.0), (n, n), E, NU), obstacle)
        result, x = contact.solve(), contact.points()
        edge, r = result.edge(), np.hypot(x[0] - centre[0], x[1] - centre[1])
        wanted = np.sqrt(np.maximum(1 - (r / a) ** 2, 0.0))
        off = [rms(p / (1.5 * force / (np.pi * a**2)) - wanted)
               for p in (edge.pressure, result.pressure)]  # fmt: skip
        found.append([*off, np.hypot(*(edge.places - centre[:, None])).mean() / a - 1])
    return list(rms(np.array(found), axis=0))


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


def coated(n: int, linear: bool) -> list[float]:
    """Errors of the normal and of the tangential wave, n points a wave."""
    exact = symbol_of_coating(2 * np.pi, COATING)
    thickness, *material = COATING
    layer = (thickness, round(thickness * n), *material)
    if linear:
        block = PeriodicLayers(1.0, [layer], n, base=(E, NU))
    else:  # of a depth that the wave does not feel
        ground = (2.5, round(2.5 * n), E, NU)
        block = PeriodicLayers(
            1.0, [layer, ground], n, element=ElementQuadAdini(), interfaces="kinked"
        )
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
    found["two waves, light contact"] = series(light, tuple(3 * n // 2 for n in sizes))
    found["ball"] = series(ball, tuple(2 * n for n in sizes))
    found["coating"] = series(lambda n: coated(n, linear=False), sizes)
    found["coating, linear cells"] = series(lambda n: coated(n, linear=True), sizes)
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
        p = GridContact(BODIES["thick block"](n), ground).solve().edge().pressure / FULL
        left.plot(at - np.round(at), p, "o", ms=3, mfc="none", color=colour, label=f"s = {share}")
    left.set(xlabel="x / wavelength", ylabel=r"pressure / ($\pi E^* h$)", title="Westergaard")
    left.legend()
    for name in ("thick block, s = 0.5", "two waves, light contact", "ball"):
        case = found[name]
        (line,) = right.loglog(case.sizes, case.errors[:, 0], "o-", ms=3, lw=1, label=name)
        right.loglog(case.sizes, case.errors[:, 1], ":", lw=1, color=line.get_color())
    for name in ("two waves, full contact", "coating", "coating, linear cells"):
        right.loglog(found[name].sizes, found[name].errors[:, 0], "s-", ms=3, lw=1, label=name)
    right.set_title("dotted: by forces alone", fontsize=8)
    right.set_xscale("log", base=2)
    right.set(xlabel="points along a period", ylabel="relative error", ylim=(1e-7, 5.0))
    right.legend(fontsize=7, loc="upper right", ncols=2)
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_periodic.png", dpi=150)


if __name__ == "__main__":
    main()
