"""A self-affine rough surface pressed against a coated block, and dragged along it.

The heights have the power spectrum C(q) ~ q^(-2 (1 + H)) between two wave numbers. At light loads
the contact area grows in proportion to the mean pressure p,

    A / A0 = k p / (E* h'),    E* = E / (1 - nu^2),

with the root mean square h' of the slope. Persson (J. Chem. Phys. 115 (2001) 3840) has
A / A0 = erf(sqrt(2) p / (E* h')), whose k is sqrt(8 / pi) = 1.6; asperities that do not feel each
other (Bush, Gibson and Thomas, Wear 35 (1975) 87) have k = sqrt(2 pi) = 2.5. Simulations of half
spaces lie between the two. A block with a stiff coating lies between the half spaces of the coating
and of the substrate: short waves of the roughness feel the coating, long ones bend it.

Under a constant load the surface is then dragged. Slip begins at the edges of the contact spots,
and small spots slide long before large ones, until all of them slip and the force is F p.

    python examples/rough_surface.py --points 512
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import scipy.special

from contact import (
    GridContact,
    GridResult,
    HalfSpace,
    PeriodicLayers,
    Rigid,
    Rough,
    Status,
    self_affine,
)

COATING, SUBSTRATE = (5.0, 0.25), (1.0, 0.3)  # E, nu
THICKNESS, DEPTH = 1 / 16, 1.0  # of the coating and of the block, in periods
STAR = COATING[0] / (1 - COATING[1] ** 2)
FRICTION, HURST, RMS = 0.4, 0.8, 2e-3
WAVES = (2, 32)  # longest and shortest wave, in waves a period
PRESSURES = np.array([0.01, 0.02, 0.04, 0.08, 0.16, 0.3, 0.6])  # over E* h' of the coating
DRAGGED_AT, DRAG = 0.08, 0.045  # the load while it is dragged, and how far, in periods
BLUE, RED, GREY = "#1f6f8b", "#d1495b", "#8a8a8a"


def coated_block(n: int) -> PeriodicLayers:
    """The coating below, where the contact is, with one brick a point, coarser ones above it."""
    layers = [
        (THICKNESS, max(n // 16, 2), *COATING),
        (DEPTH - THICKNESS, n // 4, *SUBSTRATE),
    ]
    return PeriodicLayers((1.0, 1.0), layers, (n, n))


def pressed(rough: Rough, body: Any) -> list[GridResult]:
    """Frictionless contact under growing loads."""
    loads = PRESSURES * STAR * rough.rms_slope  # on a surface of area one
    drive = [Rigid(rough, force=(None, None, p)) for p in loads]
    return GridContact(body, rough).history(drive)


def dragged(rough: Rough, body: Any, steps: int) -> list[GridResult]:
    """Pressed, and then moved along x until everything slips."""
    load = DRAGGED_AT * STAR * rough.rms_slope
    moves = DRAG * np.linspace(0, 1, steps + 1) ** 2
    drive = [Rigid(rough, displacement=(x, 0.0, None), force=(None, None, load)) for x in moves]
    return GridContact(body, rough, FRICTION).history(drive)


def section(block: PeriodicLayers, result: GridResult) -> tuple[np.ndarray, np.ndarray]:
    """Points (3, n, m) of the section y through the largest pressure, and von Mises' stress."""
    n = result.pressure.shape[0]
    row = np.unravel_index(np.argmax(result.pressure), (n, n))[1]
    x, z = (np.arange(n) + 0.5) / n, THICKNESS * np.linspace(0.01, 3.0, 96)
    points = np.array(np.meshgrid(x, row / n, z, indexing="ij"))[:, :, 0]
    forces = result.cell * np.concatenate([result.shear, result.pressure[None]])
    s = block.stress(forces, points.reshape(3, -1)).reshape(3, 3, *points.shape[1:])
    s = s - np.eye(3)[:, :, None, None] * np.trace(s) / 3
    return points, np.sqrt(1.5 * np.sum(s**2, axis=(0, 1)))


def save_images(folder: Path, result: GridResult, points: np.ndarray, stress: np.ndarray) -> None:
    """Surface and section as image data, for ParaView."""
    import pyvista

    result.to_pyvista().save(folder / "rough_surface.vti")
    x, z = points[0, :, 0], points[2, 0]
    image = pyvista.ImageData(
        dimensions=(x.size, 1, z.size),
        spacing=(x[1] - x[0], 1.0, z[1] - z[0]),
        origin=(x[0], points[1, 0, 0], z[0]),
    )
    image.point_data["von Mises"] = stress.ravel(order="F")
    image.save(folder / "rough_surface_section.vti")


def by_wave_number(spectrum: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean of the power spectrum over all directions, at whole numbers of waves a period."""
    q = np.rint(np.hypot(*spectrum[0]) / (2 * np.pi)).astype(int).ravel()
    count = np.bincount(q)
    mean = np.bincount(q, spectrum[1].ravel()) / np.maximum(count, 1)
    last = spectrum[1].shape[0] // 2
    return np.arange(1, last), mean[1:last]


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Press, drag, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=128, help="along a side")
    parser.add_argument("--steps", type=int, default=8, help="of dragging")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the pictures")
    options = parser.parse_args(argv)
    n = options.points
    heights = self_affine(n, HURST, RMS, WAVES, seed=1)
    rough = Rough(heights - heights.max(), (1.0, 1.0))
    block = coated_block(n)
    print(f"{rough}, rms slope {rough.rms_slope:.3g}; {block}")

    loads = {"coated block": pressed(rough, block)}
    for name, material in (("coating", COATING), ("substrate", SUBSTRATE)):
        loads[name] = pressed(rough, HalfSpace((1.0, 1.0), (n, n), *material))
    areas = {name: np.array([r.corrected_area for r in found]) for name, found in loads.items()}
    persson = scipy.special.erf(np.sqrt(2) * PRESSURES)
    print("p / (E* h')   coated   half space of: coating   substrate   Persson   residual")
    for row in zip(PRESSURES, *areas.values(), persson, loads["coated block"], strict=True):
        print("{:10.2f} {:9.4f} {:22.4f} {:11.4f} {:9.4f}".format(*row[:5]), end="")
        print(f"{max(row[5].kkt.values()):12.1e}")

    drags = dragged(rough, block, options.steps)
    share = np.array([-r.resultant[0] / (FRICTION * r.resultant[2]) for r in drags])
    stuck = [np.mean(r.status[r.pressure > 0] == Status.STICK) for r in drags]
    for move, q, s in zip([r.motion[0] for r in drags], share, stuck, strict=True):
        print(f"dragged by {move:.2e}: force {abs(q):.3f} of F P, {s:.1%} of the contact sticks")
    mixed = drags[int(np.argmax([min(np.sum(r.status == k) for k in (1, 2)) for r in drags]))]
    inside = section(block, mixed)
    options.output.mkdir(parents=True, exist_ok=True)
    save_images(options.output, mixed, *inside)
    picture(rough, loads, mixed, inside, options.output)
    return SimpleNamespace(
        rough=rough,
        loads=loads,
        areas=areas,
        persson=persson,
        drags=drags,
        share=np.abs(share),
        stuck=np.array(stuck),
        inside=inside,
    )


def picture(
    rough: Rough,
    loads: dict[str, list[GridResult]],
    mixed: GridResult,
    inside: tuple[np.ndarray, np.ndarray],
    output: Path,
) -> None:
    """Maps of the surface and of a section, area, spectra and histogram of the pressure."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(
        {"font.size": 8, "legend.fontsize": 7, "axes.linewidth": 0.6, "axes.titlesize": 8}
    ):
        figure = Figure(figsize=(7.2, 10.0), layout="constrained")
        axes = figure.subplot_mosaic("ab;cd;ef;gg", height_ratios=[1, 1, 1, 0.7])
        draw_maps([axes[k] for k in "abc"], rough, loads["coated block"], mixed)
        draw_area(axes["d"], loads)
        draw_statistics(axes["e"], axes["f"], rough, loads["coated block"])
        draw_section(axes["g"], rough, *inside)
        for letter, ax in axes.items():
            ax.set_title(f"({letter})", loc="left", fontweight="bold")
        figure.savefig(output / "rough_surface.png", dpi=200)


def draw_maps(axes: list[Any], rough: Rough, loads: list[GridResult], mixed: GridResult) -> None:
    """Heights, pressure, and which points stick or slip."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    first, second, third = axes
    shown = {"origin": "lower", "extent": (0, 1, 0, 1), "interpolation": "nearest"}
    drawn = first.imshow(1e3 * rough.heights.T, cmap="cividis", **shown)
    first.figure.colorbar(drawn, ax=first, label=r"height, $10^{-3}$ periods")
    p = loads[int(np.searchsorted(PRESSURES, DRAGGED_AT))].pressure / (STAR * rough.rms_slope)
    drawn = second.imshow(np.where(p > 0, p, np.nan).T, cmap="inferno_r", vmin=0.0, **shown)
    second.figure.colorbar(drawn, ax=second, label=r"pressure / ($E^* h'$)")
    third.imshow(mixed.status.T, cmap=ListedColormap(["white", BLUE, RED]), vmin=0, vmax=2, **shown)
    force = abs(mixed.resultant[0]) / (FRICTION * mixed.resultant[2])
    patches = [Patch(color=BLUE, label="stick"), Patch(color=RED, label="slip")]
    third.legend(handles=patches, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    third.set_title(f"dragged by {force:.0%} of F P")
    second.set_title(f"p = {DRAGGED_AT:g} $E^* h'$")
    for ax in axes:
        ax.set(xlabel="x / period", ylabel="y / period")


def draw_area(ax: Any, loads: dict[str, list[GridResult]]) -> None:
    """Contact area over load, relative to the linear law, beside its two theories."""
    x = np.geomspace(PRESSURES[0] / 1.3, PRESSURES[-1] * 1.3, 200)
    ax.axhspan(np.sqrt(8 / np.pi), np.sqrt(2 * np.pi), color="0.92")
    ax.axhline(np.sqrt(2 * np.pi), color="0.4", lw=0.8, ls="--", label="Bush, Gibson, Thomas")
    ax.plot(x, scipy.special.erf(np.sqrt(2) * x) / x, "k-", lw=0.8, label="Persson")
    marks = {"coated block": ("o", RED), "coating": ("s", BLUE), "substrate": ("^", GREY)}
    for name, (mark, colour) in marks.items():
        star = SUBSTRATE[0] / (1 - SUBSTRATE[1] ** 2) if name == "substrate" else STAR
        loaded = PRESSURES * STAR / star
        label = name if name == "coated block" else f"half space of {name}"
        area = np.array([r.corrected_area for r in loads[name]])
        ax.plot(loaded, area / loaded, mark, color=colour, ms=4, label=label)
    ax.set_xscale("log")
    ax.set(xlabel=r"p / ($E^* h'$)", ylabel=r"$\kappa = (A / A_0)\, E^* h' / p$", ylim=(0, 3.2))
    ax.set_xlim(x[0], x[-1])
    ax.legend(loc="lower left", frameon=False)


def draw_statistics(left: Any, right: Any, rough: Rough, loads: list[GridResult]) -> None:
    """Spectra of heights and pressure, and the histogram of the pressure."""
    q, C = by_wave_number(rough.spectrum())
    made = np.flatnonzero(1e-12 * C.max() < C)
    left.loglog(q[made], C[made] / C.max(), "k-", lw=1, label="heights")
    unit = STAR * rough.rms_slope
    for k, colour in ((1, BLUE), (3, RED), (5, GREY)):
        label = f"p = {PRESSURES[k]:g} $E^* h'$"
        q, C = by_wave_number(loads[k].spectrum())
        left.loglog(q, C / C.max(), color=colour, lw=1, label=f"pressure, {label}")
        density, edges = loads[k].histogram(40)
        right.stairs(density * unit, edges / unit, color=colour, lw=1, label=label)
    left.set(xlabel="waves a period", ylabel="power spectral density / largest")
    left.set_ylim(1e-7, 3.0)
    left.legend(loc="lower left", frameon=False, handlelength=1.2)
    right.set(xlabel=r"pressure / ($E^* h'$)", ylabel="probability density", ylim=(0, None))
    right.legend(frameon=False)


def draw_section(ax: Any, rough: Rough, points: np.ndarray, stress: np.ndarray) -> None:
    """Von Mises' stress below the surface, the interface dashed."""
    unit = STAR * rough.rms_slope
    drawn = ax.pcolormesh(
        points[0], points[2] / THICKNESS, stress / unit, cmap="magma_r", shading="gouraud",
        vmin=0.0, vmax=float(np.quantile(stress, 0.995)) / unit,
    )  # fmt: skip
    ax.axhline(1.0, color="k", lw=0.6, ls="--")
    ax.figure.colorbar(drawn, ax=ax, label=r"von Mises / ($E^* h'$)")
    ax.set(xlabel="x / period", ylabel="depth / coating")
    ax.invert_yaxis()


if __name__ == "__main__":
    main()
