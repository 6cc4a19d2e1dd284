"""Ironing: a stiff block with a rounded side is pressed into a soft slab and dragged to and fro.

Both bodies are elastic, of small strain; the block slides by many facets, so that the places which
face each other are found anew in every step, on the factorisation of the first. While it slides,
the tangential force is F times the normal one. The work of the supports is what the bodies store
and what friction dissipates,

    sum over the steps of the mean force times the motion
        = stored energy + sum of friction times slip,

up to the error of the trapezoidal rule.

    python examples/ironing.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from skfem import ElementQuad2, MeshQuad

from contact import ContactProblem, ElasticBody, LoadHistory, LoadStepper

STIFF, SOFT, NU, FRICTION = 10.0, 1.0, 0.3, 0.3
PRESSED, TRAVEL, BEND = 0.03, 0.8, 1.5  # indentation, way to and fro, radius of the rounded side


def iron(cells: int) -> ElasticBody:
    """A block of length one whose lower side is rounded."""
    mesh = MeshQuad.init_tensor(np.linspace(-0.5, 0.5, cells + 1), np.linspace(0, 0.4, 6))
    x, y = mesh.p
    p = np.array([x, y + (BEND - np.sqrt(BEND**2 - x**2)) * (1 - y / 0.4)])
    names = dict(mesh.with_defaults().boundaries)
    mesh = MeshQuad(p, mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, ElementQuad2(), E=STIFF, nu=NU).fix("top", "xy")


def slab(cells: int) -> ElasticBody:
    """The slab below, held at its lower side."""
    x = np.linspace(-0.9, 0.9 + TRAVEL, int(2.6 * cells) + 1)
    mesh = MeshQuad.init_tensor(x, -0.7 * np.linspace(1, 0, cells // 2 + 1) ** 1.3)
    body = ElasticBody.from_mesh(mesh.with_defaults(), ElementQuad2(), E=SOFT, nu=NU)
    return body.fix("bottom", "xy")


def ironed(cells: int, steps: int) -> tuple[LoadHistory, ElasticBody, ElasticBody]:
    """Pressed in four steps, then dragged forth and back."""
    upper, lower = iron(cells).named("iron"), slab(2 * cells).named("slab")
    problem = ContactProblem(upper, "bottom", lower.surface("top"), friction=FRICTION)
    stepper = LoadStepper(problem, sliding="finite")
    stepper.move("top", "y", -PRESSED, lambda t: min(t, 1.0), body=upper)
    stepper.move("top", "x", TRAVEL, lambda t: max(0.0, min(t - 1.0, 3.0 - t)), body=upper)
    times = np.r_[0.25, 0.5, 0.75, 1.0, 1.0 + 2 * np.arange(1, 2 * steps) / (2 * steps)]
    return stepper.run(times), upper, lower


def energies(history: LoadHistory, upper: ElasticBody) -> tuple[np.ndarray, ...]:
    """Work of the moving support, stored energy and dissipation up to each step."""
    work, lost, stored = [0.0], [0.0], [0.0]
    force, at = np.zeros(upper.f.size), np.zeros(upper.f.size)
    t = np.zeros(0)
    for result in history.results:
        now = result[upper].u
        reaction = upper.at_supports(result[upper].reactions)
        work.append(work[-1] + 0.5 * float((force + reaction) @ (now - at)))
        slip = result.slip_increment
        before = t if t.shape == result.t.shape else result.t
        lost.append(lost[-1] + 0.5 * float(np.sum((before + result.t) * slip)))
        body = result.system.body
        stored.append(0.5 * float(result.u @ body.internal(result.u)))
        force, at, t = reaction, now, result.t
    return tuple(np.array(part[1:]) for part in (work, stored, lost))


def main(argv: list[str] | None = None) -> SimpleNamespace:
    """Drag, print the certificate and the balance of energy, draw forces and deformed bodies."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=14, help="facets of the rounded side")
    parser.add_argument("--steps", type=int, default=16, help="of the way forth")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    history, upper, lower = ironed(options.cells, options.steps)
    forces = np.array([result[upper].resultant for result in history.results])
    work, stored, lost = energies(history, upper)
    last = history.results[-1]
    print(last.certificate())
    projections = [sum(l.phase == "projection" for l in r.history) for r in history.results]
    print(f"\nprojections in a step: {min(projections)} to {max(projections)}")
    off = abs(work[-1] - stored[-1] - lost[-1]) / work[-1]
    print(
        f"work {work[-1]:.5f}, stored {stored[-1]:.5f}, dissipated {lost[-1]:.5f}: off by {off:.1e}"
    )
    picture(history, (work, stored, lost), forces, options.output)
    return SimpleNamespace(
        history=history, forces=forces, work=work, stored=stored, lost=lost, bodies=(upper, lower)
    )


def picture(
    history: LoadHistory, energy: tuple[np.ndarray, ...], forces: np.ndarray, output: Path
) -> None:
    """Stress in the deformed bodies on the way, forces and energies over time."""
    from matplotlib.figure import Figure

    from contact.plot import plot_cells

    figure = Figure(figsize=(11, 6.5), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.2, 1))
    bodies, of_force, of_energy = (
        figure.add_subplot(grid[k]) for k in ((0, slice(None)), (1, 0), (1, 1))
    )
    half = int(np.argmax(history.times >= 1.5))
    plot_cells(history.results[half], bodies, label="von Mises stress / E of the slab")
    bodies.set(title=f"on the way forth, t = {history.times[half]:.2f}", xlabel="x", ylabel="y")
    of_force.plot(history.times, forces[:, 1], "k.-", label="normal force")
    of_force.plot(history.times, -forces[:, 0], ".-", color="#d1495b", label="tangential force")
    limit = FRICTION * forces[:, 1]
    of_force.fill_between(
        history.times, -limit, limit, color="0.92", label="F times the normal force"
    )
    of_force.set(xlabel="t", ylabel="force on the iron")
    work, stored, lost = energy
    of_energy.plot(history.times, work, "k", label="work of the supports")
    of_energy.stackplot(
        history.times, stored, lost, colors=("#9ecae1", "#f4b6a6"), labels=("stored", "dissipated")
    )
    of_energy.set(xlabel="t", ylabel="energy")
    of_force.legend(fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.66))
    of_energy.legend(fontsize=8)
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "ironing.png", dpi=120)


if __name__ == "__main__":
    main()
