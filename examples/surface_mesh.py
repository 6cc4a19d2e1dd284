"""A stamp from an STL file, pressed into a block with friction and turned until it slips.

The stamp is a gear wheel of six teeth with a crowned face and a round rim. The script writes its
triangles to an STL file, as a program for drawing parts would, and `SurfaceMesh.from_file` reads
them again: the file is in metres, the block in millimetres. The stamp is pushed down first and then
turned about its axis. Slip grows inwards from the teeth, until the torque comes near to what
friction can bear,

    M = F int r p dA.

The face has a formula as well; contact with it instead of the triangles shows what they are worth.

    python examples/surface_mesh.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from skfem import ElementHex1, MeshHex

from contact import (
    ContactProblem,
    ContactResult,
    ElasticBody,
    LoadHistory,
    LoadStepper,
    Rigid,
    Status,
    SurfaceMesh,
)

E, NU, FRICTION = 5.0, 0.4, 0.4  # MPa
SIDE, DEEP, REACH = 20.0, 8.0, 7.2  # of the block, mm; half-width of what may be touched
RADIUS, TOOTH, TEETH = 6.0, 0.17, 6  # mean radius of the rim, share of it that teeth take, number
CROWN, RIM, HIGH = 120.0, 1.0, 3.0  # radii of the face and of its rim, height of the stamp
PUSH, TURN = 0.5, 0.08  # mm, radians


def rim(angle: np.ndarray) -> np.ndarray:
    """Radius of the outline at angles about the axis."""
    return RADIUS * (1 + TOOTH * np.tanh(2 * np.cos(TEETH * angle)) / np.tanh(2))


def face(x: np.ndarray) -> np.ndarray:
    """Height of the face above its lowest point at places x, infinite beyond the rim."""
    r, angle = np.hypot(x[0], x[1]), np.arctan2(x[1], x[0])
    beyond = (r - rim(angle)) / RIM + 1  # from 0 to 1 on the rounded part
    with np.errstate(invalid="ignore"):
        edge = RIM * (1 - np.sqrt(1 - np.maximum(beyond, 0) ** 2))
    return np.where(beyond < 1, r**2 / (2 * CROWN) + edge, np.inf)


def stamp_file(path: Path, around: int) -> None:
    """Write the triangles of the stamp, in metres."""
    import pyvista

    angle = 2 * np.pi * np.arange(around) / around
    outline = rim(angle)
    inner = np.linspace(0, 1, around // 10 + 1)[1:, None] * (outline - RIM)
    # On the quarter circle of the rim by equal angles.
    outer = outline - RIM * (1 - np.sin(np.linspace(0, np.pi / 2, 9)[1:, None]))
    r = np.vstack((inner, outer))
    x = np.stack((r * np.cos(angle), r * np.sin(angle)))
    z = face(x * (1 - 1e-12))
    wall, lid = np.linspace(z[-1], HIGH, 4)[1:], np.linspace(1, 0, 12)[1:-1, None] * outline
    x = np.concatenate((x, np.repeat(x[:, -1:], 3, axis=1)), axis=1)
    x = np.concatenate((x, np.stack((lid * np.cos(angle), lid * np.sin(angle)))), axis=1)
    z = np.vstack((z, wall, np.full(lid.shape, HIGH)))
    places = np.vstack((x.reshape(2, -1), z.ravel())).T
    places = np.vstack((places, [[0, 0, 0], [0, 0, HIGH]]))
    rings, last = len(z), len(places)
    here = np.arange(around)
    there = (here + 1) % around
    facets = [np.stack((np.full(around, last - 2), there, here), axis=1)]
    for k in range(rings - 1):
        a, b, c, d = here, there, here + around, there + around
        facets += [
            np.stack((a, b, d), axis=1) + k * around,
            np.stack((a, d, c), axis=1) + k * around,
        ]
    outermost = (rings - 1) * around
    facets += [np.stack((np.full(around, last - 1), here + outermost, there + outermost), axis=1)]
    cells = np.concatenate(facets)
    cells = np.column_stack((np.full(len(cells), 3), cells))
    pyvista.PolyData(1e-3 * places, cells.ravel()).save(path)


def block(cells: int) -> ElasticBody:
    """The block, held at its bottom, with so many cells along a side below the stamp."""
    under = REACH * np.linspace(-1, 1, cells + 1)
    aside = np.linspace(REACH, 0.5 * SIDE, 4)[1:]
    across = np.concatenate((-aside[::-1], under, aside))
    down = -DEEP * np.linspace(1, 0, max(cells // 4, 2) + 1) ** 1.6
    names = {
        "bottom": lambda x: x[2] < -DEEP * (1 - 1e-9),
        "under": lambda x: (x[2] > -1e-9 * DEEP) & (np.abs(x[:2]).max(axis=0) < REACH),
    }
    mesh = MeshHex.init_tensor(across, across, down).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, ElementHex1(), E=E, nu=NU).fix("bottom", "xyz")


def turned(body: ElasticBody, obstacle: Any, steps: int) -> LoadHistory:
    """Pushed down at time 1, then turned."""

    def moved(t: float) -> Rigid:
        return Rigid(
            obstacle,
            displacement=(0.0, 0.0, -PUSH * min(t, 1.0)),
            rotation=(0.0, 0.0, TURN * max(t - 1.0, 0.0)),
        )

    stepper = LoadStepper(ContactProblem(body, "under", moved(0.0), FRICTION)).obstacle(moved)
    return stepper.run(np.r_[1.0, 1.0 + np.linspace(0, 1, steps + 1)[1:]])


def torques(result: ContactResult) -> tuple[float, float]:
    """Torque on the block about the axis of the stamp, and what friction could bear."""
    rows = result.system.rows
    force = np.einsum("mj,djm->dm", result.shear, rows.tangents) * rows.weights
    x, y = rows.x[:2]
    return float(np.sum(x * force[1] - y * force[0])), FRICTION * float(result.mu @ np.hypot(x, y))


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Write the file, read it, press, turn, compare with the formula, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=28, help="along a side below the stamp")
    parser.add_argument("--around", type=int, default=240, help="triangles around the stamp")
    parser.add_argument("--steps", type=int, default=8)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for STL, VTU, PNG")
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "stamp.stl"
    stamp_file(path, options.around)
    stamp = SurfaceMesh.from_file(path, scale=1e3)
    body = block(options.cells)
    history = turned(body, stamp, options.steps)
    smooth = turned(body, face, 1)
    last = history.results[-1]
    print(f"{stamp} from {path.name}\n{last.certificate()}")
    torque, limit = np.array([torques(result) for result in history.results]).T
    push = -history.results[0].resultant[2]
    by_formula = -smooth.results[0].resultant[2]
    print(f"push {push:.2f} N, with the formula of the face {by_formula:.2f} N")
    print(f"torque at the end {torque[-1]:.1f} Nmm of {limit[-1]:.1f} Nmm")
    last.to_pyvista().save(options.output / "surface_mesh.vtu")
    picture(stamp, history, torque, limit, options.output)
    found = {"stamp": stamp, "history": history, "smooth": smooth, "torque": torque}
    return SimpleNamespace(**found, limit=limit, push=push, by_formula=by_formula)


def picture(
    stamp: SurfaceMesh, history: LoadHistory, torque: np.ndarray, limit: np.ndarray, output: Path
) -> None:
    """The stamp from below, the pressure, where it slips halfway, the torque over the turn."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 8), layout="constrained")
    kinds_of_axes = ["3d", None, None, None]
    axes = [figure.add_subplot(2, 2, k + 1, projection=p) for k, p in enumerate(kinds_of_axes)]
    draw_stamp(axes[0], stamp)
    counts = [np.bincount(r.status, minlength=3)[1:3].min() for r in history.results]
    mixed = int(np.argmax(counts))
    result = history.results[mixed]
    x, p = result.x_nominal, result.pressure
    angle = np.linspace(0, 2 * np.pi, 721)
    outline = rim(angle) * np.array([np.cos(angle), np.sin(angle)])
    levels = 0.1 * np.arange(1, np.ceil(p.max() / 0.1) + 1)
    drawn = axes[1].tricontourf(x[0], x[1], p, levels, cmap="viridis")
    figure.colorbar(drawn, ax=axes[1], label="pressure, MPa", format="%.1f")
    shear = np.einsum("mj,djm->dm", result.shear, result.system.rows.tangents)
    kinds = ((Status.STICK, "#1f6f8b", "stick"), (Status.SLIP, "#d1495b", "slip"))
    for value, colour, name in kinds:
        at = result.status == value
        axes[2].quiver(*x[:2, at], *shear[:2, at], color=colour, label=name, scale=3.2, width=0.006)
    turn = np.maximum(history.times - 1.0, 0.0) * TURN * 180 / np.pi
    titles = (f"pressure, turned by {turn[mixed]:.1f} degrees", "shear traction on the block")
    for ax, title in zip(axes[1:3], titles, strict=True):
        ax.plot(*outline, color="0.3", lw=0.8)
        ax.set(aspect="equal", xlim=(-8, 8), ylim=(-8, 8), xlabel="x, mm", ylabel="y, mm")
        ax.set_title(title)
    axes[2].legend(loc="upper right", fontsize=8)
    axes[3].plot(turn, torque, "ko-", ms=4, label="torque")
    axes[3].plot(turn, limit, "k--", lw=1, label="all slips")
    axes[3].plot(turn[mixed], torque[mixed], "o", ms=9, mfc="none", color="#d1495b")
    axes[3].set(xlabel="turn, degrees", ylabel="torque, N mm", ylim=(0, None), title="torque")
    axes[3].legend(loc="lower right", fontsize=8)
    figure.savefig(output / "surface_mesh.png", dpi=120)


def draw_stamp(ax: Any, stamp: SurfaceMesh) -> None:
    """Its triangles from below, by the light on them."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    light = np.array([-0.45, -0.5, -0.74])
    towards = np.clip(light @ stamp.normals / np.linalg.norm(light), 0, 1)
    steel = np.array([0.62, 0.70, 0.80])
    colours = (0.22 + 0.63 * towards)[:, None] * steel + 0.25 * towards[:, None] ** 12
    colours = np.clip(colours, 0, 1)
    ax.add_collection3d(
        Poly3DCollection(
            stamp.points.T[stamp.facets.T], facecolors=colours, edgecolors=colours, lw=0.3
        )
    )
    ax.set(xlim=(-6, 6), ylim=(-6, 6), zlim=(-3, 5), title="stamp.stl, from below")
    ax.set_box_aspect((1, 1, 8 / 12), zoom=1.3)
    ax.view_init(elev=-40, azim=-65)
    ax.set_axis_off()


if __name__ == "__main__":
    main()
