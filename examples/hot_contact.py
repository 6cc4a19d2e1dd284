"""A brake from full speed to rest: where disc and pad get hot they grow, and take the pressure.

Half of a steel disc and its pad are rings about the axis of the wheel. The pad is pressed by a
stiff back plate; friction makes the heat

    q = f p omega(t) r

per area and time, and the film between the faces conducts h (T1 - T2). More heat is made outside,
and the edges stay cold: the pressure grows near the rim and leaves the edges. A pad three times as
stiff gives a narrow hot band instead, as in J. R. Barber, Proc. R. Soc. A 312 (1969), 381-394.

    python examples/hot_contact.py
"""

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from skfem import MeshQuad

from contact import ContactProblem, ElasticBody, Pair, ThermalContact

FORCE, FRICTION, OMEGA, END = 16e3, 0.35, 60.0, 4.0  # N, 1, 1/s, s


def ring(radii: tuple, heights: tuple, cells: tuple, E: float, nu: float) -> ElasticBody:
    """A ring of biquadratic cells."""
    ticks = (np.linspace(*ends, n + 1) for ends, n in zip((radii, heights), cells, strict=True))
    mesh = MeshQuad.init_tensor(*ticks).with_defaults()
    return ElasticBody.from_mesh(mesh, E=E, nu=nu, plane="axisymmetric")


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Brake, print the heat, draw temperatures and pressures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    disc = ring((0.09, 0.16), (-0.01, 0.0), (28, 5), 2.0e11, 0.3).fix("bottom", "y").named("disc")
    pad = ring((0.10, 0.15), (0.0, 0.012), (24, 6), 3.0e8, 0.25).named("pad").tie("top", "y")
    pad.load("top", (0.0, -FORCE / (np.pi * (0.15**2 - 0.10**2))))
    model = ThermalContact(
        ContactProblem([pad, disc], [Pair(pad, "bottom", disc, "top")]),
        conductivity=[1.0, 45.0],
        conductance=lambda p, gap: 0.02 * p,  # 1e4 W / (m^2 K) at half a megapascal
        capacity=[2.5e6, 3.6e6],
        expansion=[3.0e-5, 1.2e-5],
        friction_heat=lambda x: FRICTION * OMEGA * x[0],
        friction_factor=lambda t: 1.0 - t / END,
    ).convection(["left", "right"], 60.0, 0.0, body=disc)
    results = model.run(np.linspace(0.0, END, options.steps + 1))
    print(f"{results[-1].summary()}\nhottest {max(one.T.max() for one in results):.0f} K")
    from matplotlib.figure import Figure

    above, below = (figure := Figure(figsize=(8, 6), layout="constrained")).subplots(2, 1)
    results[options.steps // 2].plot(above)
    for one in results[:: options.steps // 4]:
        x, p = one.contact.x[0], one.contact.pressure / 1e6
        below.plot(1e3 * x, p, label=f"t = {one.time:g} s")
    below.set(xlabel="radius, mm", ylabel="pressure, MPa")
    below.legend()
    options.output.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output / "hot_contact.png", dpi=120)
    return SimpleNamespace(results=results, pad=pad, disc=disc)


if __name__ == "__main__":
    main()
