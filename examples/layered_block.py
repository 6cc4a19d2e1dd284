r"""A soft pad between a press and a stiff plate, and a body too large for a mesh.

A `LayeredBlock` is a rectangle of layers of equal Adini cells. No mesh, no Basis and no sparse
matrix is built: a slab of twice the height follows from two equal slabs by one dense step,

.. math::
    Q'_+ = c - 2 Y_+^T Y_+, \qquad Q'_- = c - 2 Y_-^T Y_-, \qquad L L^T = 2c, \; Y = L^{-1} b,

so that n rows of cells cost log2(n) Cholesky factorisations, and one line
(``problem.condense(device="cuda")``) moves all of it to a GPU. Here a rubber-like pad is pressed
against a gently curved foundation by a stiff plate that is moved down and sideways.

The contact force balances what the press holds, a coarse block agrees with the same body built
on a mesh, and the solution is sampled where it is wanted: around the contact.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from contact import ContactProblem, ContactResult, LayeredBlock

FRICTION = 0.4


def foundation(x: np.ndarray) -> np.ndarray:
    """A shallow hill under the middle of the block, as a gap below it."""
    return np.asarray(0.05 * (x[0] - 1.0) ** 2)


def press(columns: int) -> LayeredBlock:
    """Pad 2 x .25 (E = 1) below a plate .75 high (E = 20), moved down by .03, sideways by .01."""
    rows = columns // 8
    layers = [(0.25, rows, 1.0, 0.45), (0.75, 3 * rows, 20.0, 0.3)]
    block = LayeredBlock((2.0, 1.0), layers, columns=columns)
    return block.fix("top", "y", -0.03).fix("top", "x", 0.01)


def solve(columns: int) -> ContactResult:
    """Solve with Coulomb friction."""
    return ContactProblem(press(columns), "bottom", foundation, FRICTION).solve()


def check() -> ContactResult:
    """Assert what the docstring says."""
    mesh = ContactProblem(press(32).elastic(), "bottom", foundation, FRICTION).solve()
    coarse, result = solve(32), solve(128)
    assert np.abs(coarse.pressure - mesh.pressure).max() < 1e-10 * mesh.pressure.max()
    assert 0 < 1 - result.contact_force / coarse.contact_force < 0.02  # softer: more freedom
    balance = result.balance()
    assert np.abs(balance["residual"]).max() < 1e-10
    assert balance["contact"][0] < 0 < balance["contact"][1]  # friction opposes the motion
    assert max(result.kkt.values()) < 1e-10
    return result


def window(result: ContactResult, n: int = 240) -> Any:
    """Displacement and von Mises stress in a window around the contact, as a pyvista grid."""
    import pyvista

    x, y = np.linspace(0.5, 1.5, n + 1), np.linspace(0.0, 0.5, n // 2 + 1)
    points = np.stack(np.meshgrid(x, y), axis=0).reshape(2, -1)
    grid = pyvista.ImageData(
        dimensions=(x.size, y.size, 1), spacing=(x[1] - x[0], y[1] - y[0], 1.0), origin=(x[0], 0, 0)
    )
    grid.point_data["displacement"] = np.pad(result.sample(points).T, ((0, 0), (0, 1)))
    grid.point_data["von_mises"] = result.von_mises(points)
    return grid


def main(folder: Path = Path("out")) -> None:
    """Check, then write the window as VTK and as a picture."""
    import matplotlib.pyplot as plt

    result = check()
    folder.mkdir(exist_ok=True)
    grid = window(result)
    grid.save(folder / "layered_block.vti")
    figure, (above, below) = plt.subplots(2, figsize=(7, 7), layout="constrained")
    shape = grid.dimensions[1::-1]
    colours = above.imshow(
        grid.point_data["von_mises"].reshape(shape), origin="lower", extent=(0.5, 1.5, 0.0, 0.5)
    )
    figure.colorbar(colours, ax=above, shrink=0.8, label="von Mises stress, arbitrary units")
    above.set(title="around the contact; the layers meet at y = .25", xlabel="x", ylabel="y")
    result.plot(below)
    below.set(xlabel="x, arbitrary units", ylabel="traction, arbitrary units")
    figure.savefig(folder / "layered_block.png", dpi=120)
    plt.close(figure)
    print(result.certificate())


if __name__ == "__main__":
    main()
