"""A self-affine rough surface pressed against an elastic half space, and dragged along it.

The heights have the power spectrum C(q) ~ q^(-2 (1 + H)) between two wave numbers. At light loads
the contact area grows in proportion to the mean pressure p,

    A / A0 = k p / (E* h'),    E* = E / (1 - nu^2),

with the root mean square h' of the slope. Persson (J. Chem. Phys. 115 (2001) 3840) has
A / A0 = erf(sqrt(2) p / (E* h')), whose k is sqrt(8 / pi) = 1.6; asperities that do not feel each
other (Bush, Gibson and Thomas, Wear 35 (1975) 87) have k = sqrt(2 pi) = 2.5. Simulations lie
between the two.

Under a constant load the surface is then dragged. Slip begins at the edges of the contact spots,
and small spots slide long before large ones, until all of them slip and the force is F p.

    python examples/rough_surface.py --points 512
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import scipy.special

from contact import GridContact, GridResult, HalfSpace, Rigid, Rough, Status, self_affine

E, NU, FRICTION, HURST, RMS = 1.0, 0.3, 0.4, 0.8, 2e-3
STAR = E / (1 - NU**2)
WAVES = (2, 32)  # longest and shortest wave, in waves a period
PRESSURES = np.array([0.01, 0.02, 0.04, 0.08, 0.16, 0.3, 0.6, 1.0])  # over E* h'
DRAGGED_AT, DRAG = 0.08, 3e-3  # the load while it is dragged, and how far, in periods


def pressed(rough: Rough, space: HalfSpace) -> list[GridResult]:
    """Frictionless contact under growing loads."""
    contact = GridContact(space, rough)
    loads = PRESSURES * STAR * rough.rms_slope  # on a surface of area one
    return contact.history([Rigid(rough, force=(0.0, 0.0, p)) for p in loads])


def dragged(rough: Rough, space: HalfSpace, steps: int) -> list[GridResult]:
    """Pressed, and then moved along x until everything slips."""
    load = DRAGGED_AT * STAR * rough.rms_slope
    moves = DRAG * np.linspace(0, 1, steps + 1) ** 2
    drive = [Rigid(rough, displacement=(x, 0.0, None), force=(None, None, load)) for x in moves]
    return GridContact(space, rough, FRICTION).history(drive)


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Press, drag, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=256, help="along a side")
    parser.add_argument("--steps", type=int, default=8, help="of dragging")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the picture")
    options = parser.parse_args(argv)
    n = options.points
    heights = self_affine(n, HURST, RMS, WAVES, seed=1)
    rough = Rough(heights - heights.max(), (1.0, 1.0))
    space = HalfSpace((1.0, 1.0), (n, n), E, NU)
    print(f"{rough}, rms slope {rough.rms_slope:.3g}")

    loads = pressed(rough, space)
    area = np.array([r.area for r in loads])
    corrected = np.array([r.corrected_area for r in loads])
    persson = scipy.special.erf(np.sqrt(2) * PRESSURES)
    print("p / (E* h')   area   corrected   Persson   residual")
    for row in zip(PRESSURES, area, corrected, persson, loads, strict=True):
        print("{:10.2f} {:8.4f} {:10.4f} {:9.4f}".format(*row[:4]), end="")
        print(f"{max(row[4].kkt.values()):12.1e}")

    drags = dragged(rough, space, options.steps)
    share = np.array([-r.resultant[0] / (FRICTION * r.resultant[2]) for r in drags])
    stuck = [np.mean(r.status[r.pressure > 0] == Status.STICK) for r in drags]
    for move, q, s in zip([r.motion[0] for r in drags], share, stuck, strict=True):
        print(f"dragged by {move:.2e}: force {abs(q):.3f} of F P, {s:.1%} of the contact sticks")
    options.output.mkdir(parents=True, exist_ok=True)
    picture(rough, loads, drags, (corrected, persson), options.output)
    return SimpleNamespace(
        rough=rough,
        loads=loads,
        corrected=corrected,
        persson=persson,
        drags=drags,
        share=np.abs(share),
        stuck=np.array(stuck),
    )


def picture(
    rough: Rough,
    loads: list[GridResult],
    drags: list[GridResult],
    areas: tuple[np.ndarray, np.ndarray],
    output: Path,
) -> None:
    """Heights, pressure, area against load, where the dragged surface sticks and slips."""
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 8.4), layout="constrained")
    axes = figure.subplots(2, 2)
    extent = (0.0, 1.0, 0.0, 1.0)
    shown = {"origin": "lower", "extent": extent, "interpolation": "nearest"}
    drawn = axes[0, 0].imshow(1e3 * rough.heights.T, cmap="cividis", **shown)
    figure.colorbar(drawn, ax=axes[0, 0], label="height below the highest, 1e-3 periods")
    half = loads[int(np.searchsorted(PRESSURES, DRAGGED_AT))]
    p = np.where(half.pressure > 0, half.pressure, np.nan) / (STAR * rough.rms_slope)
    drawn = axes[0, 1].imshow(p.T, cmap="inferno_r", vmin=0.0, **shown)
    figure.colorbar(drawn, ax=axes[0, 1], label="pressure / (E* rms slope)")
    axes[0, 1].set_title(f"p = {DRAGGED_AT} E* rms slope")
    x = np.linspace(0, PRESSURES[-1], 200)
    axes[1, 0].plot(x, scipy.special.erf(np.sqrt(2) * x), "k-", lw=1, label="Persson")
    axes[1, 0].plot(x[:60], np.sqrt(2 * np.pi) * x[:60], "k--", lw=1, label="Bush, Gibson, Thomas")
    axes[1, 0].plot(PRESSURES, [r.area for r in loads], "o", mfc="none", label="counted")
    axes[1, 0].plot(PRESSURES, areas[0], "o", color="#d1495b", label="corrected")
    axes[1, 0].set(xlabel="p / (E* rms slope)", ylabel="contact area", ylim=(0, 1.02))
    axes[1, 0].legend(fontsize=8)
    mixed = int(np.argmax([min(np.sum(r.status == k) for k in (1, 2)) for r in drags]))
    colours = ListedColormap(["#f2f2f2", "#1f6f8b", "#d1495b"])
    axes[1, 1].imshow(drags[mixed].status.T, cmap=colours, vmin=0, vmax=2, **shown)
    force = abs(drags[mixed].resultant[0]) / (FRICTION * drags[mixed].resultant[2])
    axes[1, 1].set_title(f"stick (blue) and slip (red) at {force:.0%} of F P")
    for ax in (axes[0, 0], axes[0, 1], axes[1, 1]):
        ax.set(xlabel="x, periods", ylabel="y, periods")
    figure.savefig(output / "rough_surface.png", dpi=120)


if __name__ == "__main__":
    main()
