"""Periodic contact beside closed forms: Westergaard, Johnson, Hertz, and the wave of a coating.

* Westergaard (J. Appl. Mech. 6 (1939) 49): a sinusoid of height h and wavelength one on a half
  plane under the mean pressure s pi E* h. In partial contact, s < 1, the pressure is
  2 pi E* h cos(pi x) sqrt(s - sin^2(pi x)); for s >= 1 it is pi E* h (s + cos(2 pi x)).
* Johnson, Greenwood and Higginson (Int. J. Mech. Sci. 27 (1985) 383): the product of two waves is
  in full contact from the mean pressure sqrt(2) pi E* h on, which is the pressure's amplitude then.
  At light contact the pressure on a crest is the root of a polynomial in r^2 and r^4 cos(4 theta),
  which vanishes at the edge. It is fitted so that the displacement, an integral over chords, closes
  the gap in the contact within 1e-7 of it; other crests act as point forces.
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
import scipy.optimize

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


def powers(x: np.ndarray, y: np.ndarray, a: float) -> np.ndarray:
    """The functions of which a crest's squared pressure consists, shape (..., 9)."""
    r2 = (x**2 + y**2) / a**2
    four = 2 * (x**2 - y**2) ** 2 / a**4 - r2**2  # r^4 cos(4 theta)
    return np.stack([*(r2**i for i in range(5)), *(four * r2**i for i in range(3)), four**2], -1)


def reach(q: np.ndarray, x: np.ndarray, y: np.ndarray, way: tuple, a: float) -> np.ndarray:
    """Distance from places in contact to its edge in a direction, by bisection."""
    low, high = (np.full(np.broadcast_shapes(x.shape, way[0].shape), d) for d in (0.0, 2.4 * a))
    for _ in range(45):
        middle = 0.5 * (low + high)
        at = x + middle * way[0], y + middle * way[1]
        inside = (powers(*at, a) @ q > 0) & (np.hypot(*at) < 1.2 * a)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return 0.5 * (low + high)


def chords(q: np.ndarray, x: np.ndarray, y: np.ndarray, a: float) -> np.ndarray:
    """Displacement pi E* u = integral over directions of that of the pressure along chords.

    A chord ends where the pressure does as a root, for which Gauss and Chebyshev's rule is exact.
    """
    x, y, angle = x[:, None], y[:, None], np.pi * (np.arange(24) + 0.5) / 24
    way, node = (np.cos(angle), np.sin(angle)), np.pi * np.arange(1, 25) / 25
    ahead, behind = reach(q, x, y, way, a), reach(q, x, y, (-way[0], -way[1]), a)
    half = 0.5 * (ahead + behind)
    s = (0.5 * (ahead - behind))[..., None] + half[..., None] * np.cos(node)
    p = np.sqrt(np.maximum(
        powers(x[..., None] + s * way[0][:, None], y[..., None] + s * way[1][:, None], a) @ q, 0.0
    ))  # fmt: skip
    return np.sum(half * np.sum(p * np.sin(node), axis=-1), axis=1) * np.pi**2 / 25 / 24


def crest(a: float) -> tuple[float, np.ndarray]:
    """Force and squared pressure, over powers of E* h, of a crest in contact to about the radius a.

    The contact is not round: the gap has a part cos(4 theta), and the edge is where the pressure
    ends. The coefficients are those with which the displacement closes the gap in the contact.
    """
    angle, (node, weight) = np.arange(16) * np.pi / 8, np.polynomial.legendre.leggauss(16)
    way, s = (np.cos(angle), np.sin(angle)), 0.5 * (1 + node)
    R, T = np.meshgrid(a * np.sqrt(0.98 * (np.arange(8) + 0.5) / 8), np.pi / 4 * (s[::3]))
    x, y = (R * np.cos(T)).ravel(), (R * np.sin(T)).ravel()
    gap, k2 = 1 - np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y), 8 * np.pi**2
    images = (THIRD * 2**1.5 + 0.9 * FIFTH * 2**2.5 * a**2) / (4 * np.pi)  # 1/sqrt(2) apart

    def force(q: np.ndarray) -> float:
        rim = reach(q, 0 * angle, 0 * angle, way, a)[:, None]
        r = rim * (1 - s**2)
        p = np.sqrt(np.maximum(powers(r * way[0][:, None], r * way[1][:, None], a) @ q, 0.0))
        return 2 * np.pi * np.mean((p * r * rim * s) @ weight)

    def coefficients(z: np.ndarray) -> np.ndarray:
        return k2**2 * a**2 / np.pi**2 * np.r_[-z[:4].sum(), z[:8]]

    def left(z: np.ndarray) -> np.ndarray:
        q = coefficients(z)
        u = chords(q, x, y, a) / np.pi + images * force(q) * (x**2 + y**2)
        return (gap + u) / (k2 * a**2) - z[8]

    q = coefficients(scipy.optimize.least_squares(left, np.r_[-1.0, np.zeros(7), 0.5]).x)
    return force(q), q


def light(n: int) -> list[float]:
    """Errors of the pressure, and of that by forces alone, of two waves: a half space."""
    found, a = [], 0.1
    force, q = crest(a)
    for place in PLACES:
        x, y = np.meshgrid(np.arange(n) + place, np.arange(n) + 0.5 - place, indexing="ij")
        x, y, wanted = x / n, y / n, np.zeros((n, n))
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1), (0.5, 0.5)):
            near = np.hypot(x - i, y - j) < 1.2 * a
            wanted[near] = np.sqrt(np.maximum(powers(x[near] - i, y[near] - j, a) @ q, 0.0))
        wanted *= STAR * HEIGHT
        product = np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y)
        ground = Rigid(HEIGHT * (1 - product), force=(None, None, 2 * STAR * HEIGHT * force))
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
    found["two waves, light contact"] = series(
        light,
        tuple(round(np.sqrt(2) * n) for n in sizes),  # along the diagonal n a wave
    )
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
