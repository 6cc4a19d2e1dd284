"""Schemes that have derivatives: flows with the parameters a and b, and what reacts on the way."""

import numpy as np

from cip import Grid, Solver, Source, Velocity

LINE = np.linspace(0, 1, 24)
BENT = LINE + 0.01 * np.sin(2 * np.pi * LINE)
RING, CLOSED = Grid((0, 1), 25, periodic=True), Grid((0, 1), 21)
TORUS, BOX = Grid([(0, 1)] * 2, (14, 12), periodic=True), Grid([(0, 1)] * 2, (11, 13))
STRIP = Grid([(-1, 1), (0, 1)], (12, 10), periodic=(False, True))
TUBE = Grid([(0, 1)] * 2, (8, 7), periodic=(False, True))
UNEVEN = Grid.from_coordinates(BENT, np.linspace(0, 1, 9) ** 1.1, periodic=True)
SPACE = Grid([(0, 1)] * 3, (6, 5, 7), periodic=(True, True, False))
KNOT = Grid([(0, 1)] * 3, (7, 6, 6), periodic=True)
INTO = "sin(3*t + x1)*cos(x2)"
GUSTS = ["a + b*sin(2*pi*x2 + t)*x1", "b*cos(3*x1) - a"]
RISE = ["a + b*sin(2*pi*x2)", "b*cos(2*pi*x1 + 0.3) + a*x3", "a + 0.5*b*sin(2*pi*x1)"]
TURN = ["a + b*sin(2*pi*x2)", "b*cos(2*pi*x3)", "0.2 + b*sin(2*pi*x1)"]


def opaque(x, t):
    """Data that cannot be traced."""
    return np.where(x > 9, x, np.sin(3 * t + 0.4))


# By names: the grid, the velocity, and the data on walls.
FLOWS = {
    "ring": (RING, ["a + b*sin(2*pi*x1)"], None),
    "waves": (RING, ["a + b*sin(2*pi*x1 + 3*t)"], None),
    "bent": (Grid.from_coordinates(BENT, periodic=True), ["a*exp(b*cos(2*pi*x1))"], None),
    "outflow": (Grid((-1, 1), 40), ["a*x1 + b*sin(3*x1)*cos(2*t)"], None),
    "inflow": (CLOSED, ["a + b*sin(2*pi*x1)"], {"x-": "sin(3*t) + 0.4"}),
    "gusts": (CLOSED, ["a + b*sin(2*pi*x1 + 3*t)*exp(b*x1)"], {"x-": 0.7}),
    "both ends": (CLOSED, ["a*sin(5*(x1 - 0.53)) + b*cos(t)"], opaque),
    "from the right": (CLOSED, ["-a - b*x1*(1 - x1)"], {"x+": opaque}),
    "torus": (TORUS, ["a + b*sin(2*pi*x1)*cos(2*pi*x2)", "b*cos(2*pi*x1) + 0.3"], None),
    "uneven": (UNEVEN, ["a + b*sin(2*pi*x2 - t)", "b*cos(2*pi*x1) + 0.7*a"], None),
    "strip": (STRIP, ["a*x1", "a + b*sin(2*pi*x2 + t)*x1"], None),
    "box": (BOX, ["a + b*x2", "1.6*a*b - 0.5*b*x1"], INTO),
    "gusty box": (BOX, ["a + b*sin(x2 + 3*t)", "b*cos(2*x1) - a"], INTO),
    "tube": (TUBE, GUSTS, 0.8),
    "empty tube": (TUBE, GUSTS, 0.0),
    "space": (SPACE, RISE, 0.8),
    "empty space": (SPACE, RISE, 0.0),
    "knot": (KNOT, TURN, None),
}
NODAL = [(p, f) for p in ("cubic", "quintic") for f in ("transport", "advection")]
DIRECT = [(p, f) for p in ("adini", "bicubic") for f in ("transport", "advection")]
MEANS = [("csl2", "advection"), ("csl4", "advection")]
# Flow, profile, form, and whether there are sources, decay and parameters of walls.
FAMILIES = {
    "lines": [(f, *s) for f in ("ring", "waves", "bent", "outflow") for s in NODAL],
    "inflow": [
        (f, *s) for f in ("inflow", "gusts", "both ends", "from the right") for s in NODAL[1:3]
    ],
    "csl2": [(f, *MEANS[0]) for f in ("ring", "bent", "inflow", "both ends")],
    "csl4": [(f, *MEANS[1]) for f in ("ring", "bent", "inflow", "both ends")],
    "planes": [(f, *s) for f in ("torus", "uneven", "strip", "box", "gusty box") for s in DIRECT],
    "sweeps": [
        *[(f, *s) for f in ("uneven", "empty tube", "empty space") for s in (NODAL[1], *MEANS)],
        *[(f, *s) for f in ("uneven", "tube", "space") for s in (NODAL[0], NODAL[2])],
        *[(f, *s) for f in ("box", "gusty box", "space") for s in MEANS],
    ],
    "reactions": [
        (f, p, "advection" if p[0] == "c" and p[1] == "s" else "transport", kind)
        for f in ("ring", "inflow")
        for p in ("cubic", "quintic", "csl2", "csl4")
        for kind in ("steady", "unsteady")
    ],
    "reactions in planes and space": [
        *[("box", *DIRECT[0], "unsteady"), ("box", *DIRECT[2], "unsteady")],
        *[("torus", *DIRECT[2], "unsteady"), ("uneven", *MEANS[1], "unsteady")],
        ("box", *MEANS[0], "unsteady"),
        *[("knot", *NODAL[0], "unsteady"), ("knot", *MEANS[0], "unsteady")],
    ],
}
# Of sources, decay and walls; `a` is a parameter of the velocity too.
VALUES = {"a": 0.8, "b": 0.25, "q": 1.3, "m": 0.4, "k": 0.7, "l": 0.4, "g": 0.8, "w": 3.0}


def solver_of(flow, profile, form, reacts="", backend="cpu", **values):
    """A solver on the grid of a flow; `reacts` is "", or says of which kind the source is."""
    grid, texts, boundary = FLOWS[flow]
    values, more = VALUES | values, {}

    def formula(text, *names):
        return Source.from_expression(text, {name: values[name] for name in names})

    if reacts:
        puff = "q*exp(-40*(x1 - m)**2)" + "*sin(3*t + 0.4)" * (reacts == "unsteady")
        more["source"] = formula(puff, "q", "m")
        more["decay"] = formula("k*(1.2 + l*sin(2*pi*x1 + t)) + 0.3*a", "k", "l", "a")
        if boundary is not None:
            boundary = formula("g*sin(w*t + 0.2) + 0.1*a", "g", "w", "a")
    named = {"a": values["a"], "b": values["b"]}
    return Solver(
        grid, Velocity.from_expression(*texts, parameters=named), form, profile,
        boundary=boundary, backend=backend, **more,
    )  # fmt: skip


def form_of(profile):
    """The equation that a profile solves in tests of several."""
    return "advection" if profile.startswith("csl") else "transport"


def made(grid, texts, profile, **more):
    """A solver of the form of its profile."""
    return Solver(grid, Velocity.from_expression(*texts), form_of(profile), profile, **more)


def sampled(velocity, times, grid):
    """Nodal values of a velocity with formulas, shape (times, dim, nodes)."""
    point = [*grid.mesh(), *([0.0] * (3 - grid.dim))]
    formulas = velocity.on(grid)
    values = [formula.derivative((0, 0, 0, 0), (1.0,) * 4) for formula in formulas]
    return np.array([[value(*point, t) for value in values] for t in times])


def field_of(grid):
    """In no direction constant, or a moment would be zero, and so the scale of its changes."""
    waves = [f"sin(2*pi*(x{q + 1} + {0.2 * q}))" for q in range(grid.dim)]
    return "*".join(waves) + " + 0.5"


def solved(*scheme, dt=0.083, **more):
    solver = solver_of(*scheme, **more)
    return solver, solver.run(solver.state(field_of(solver.grid)), 0.2, dt=dt)
