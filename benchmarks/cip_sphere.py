"""Errors of transport on the sphere: Williamson's test 1 and the flows of Nair and Lauritzen.

The cosine bell makes one revolution at 0, 45 and 90 degrees (Williamson et al., J. Comput. Phys.
102, 1992); cosine bells and Gaussian hills return from the cases 1, 2 and 4 of Nair and Lauritzen
(J. Comput. Phys. 229, 2010), and hills from the divergent case 3. Errors are normalised l1, l2 and
linf against the start; orders are fits of l2 over the sizes. The steps, 11 for 10 cells from pole
to pole, turn no grid onto itself. Beside ours stands the scheme that
many models have, measured here on the same grid with the same paths: semi-Lagrangian steps with
cubic Lagrange interpolation in longitude and latitude, stencils continued over the poles (Ritchie,
Mon. Weather Rev. 115, 1987), order 3 and not conservative.

    python benchmarks/cip_sphere.py --cells 30 45 60 --output benchmarks/results/cip_sphere.json
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import machine
import numpy as np

from cip import Sphere, SphereSolver
from cip.sphere.paths import in_space, traced

T = 5.0
PROFILES = {
    "csl2_spline": "advection",
    "csl4_spline": "advection",
    "cubic_spline": "transport",
    "quintic_spline": "transport",
}
PEER = "cubic Lagrange"
CENTRES = {
    1: [(np.pi, np.pi / 3), (np.pi, -np.pi / 3)],
    2: [(5 * np.pi / 6, 0.0), (7 * np.pi / 6, 0.0)],
    3: [(3 * np.pi / 4, 0.0), (5 * np.pi / 4, 0.0)],
    4: [(5 * np.pi / 6, 0.0), (7 * np.pi / 6, 0.0)],
}
Field = Callable[[Any, Any], Any]


def rotation(angle: float) -> Callable[..., Any]:
    """Return a solid rotation of period T about an axis that leans by an angle."""
    speed = 2 * np.pi / T

    def wind(lon: Any, lat: Any) -> Any:
        u = np.cos(lat) * np.cos(angle) + np.sin(lat) * np.cos(lon) * np.sin(angle)
        return speed * u, -speed * np.sin(lon) * np.sin(angle)

    return wind


def deformation(case: int) -> Callable[..., Any]:
    """Return a flow of Nair and Lauritzen."""

    def wind(lon: Any, lat: Any, t: float) -> Any:
        wave = np.cos(np.pi * t / T)
        if case == 1:
            u, v = 2.4 * np.sin(lon / 2) ** 2 * np.sin(2 * lat), 1.2 * np.sin(lon) * np.cos(lat)
        elif case == 3:
            u = -(np.sin(lon / 2) ** 2) * np.sin(2 * lat) * np.cos(lat) ** 2
            v = 0.5 * np.sin(lon) * np.cos(lat) ** 3
        else:
            lon = lon - (2 * np.pi * t / T if case == 4 else 0.0)
            u, v = 2 * np.sin(lon) ** 2 * np.sin(2 * lat), 2 * np.sin(2 * lon) * np.cos(lat)
        return wave * u + (2 * np.pi / T * np.cos(lat) if case == 4 else 0.0), wave * v

    return wind


def _cosine(lon: Any, lat: Any, centre: tuple[float, float]) -> Any:
    """Return the cosine of the distance from a point."""
    a, b = centre
    return np.sin(b) * np.sin(lat) + np.cos(b) * np.cos(lat) * np.cos(lon - a)


def hills(case: int) -> Field:
    """Return Gaussian hills."""
    return lambda lon, lat: sum(
        0.95 * np.exp(10 * (_cosine(lon, lat, one) - 1)) for one in CENTRES[case]
    )


def bells(case: int) -> Field:
    """Return cosine bells of radius 1/2 on a background of .1."""

    def f(lon: Any, lat: Any) -> Any:
        r = [np.arccos(np.clip(_cosine(lon, lat, one), -1, 1)) for one in CENTRES[case]]
        return 0.1 + 0.45 * sum(np.where(d < 0.5, 1 + np.cos(2 * np.pi * d), 0) for d in r)

    return f


def bell(lon: Any, lat: Any) -> Any:
    """Return the bell of Williamson's test 1."""
    r = np.arccos(np.clip(_cosine(lon, lat, (1.5 * np.pi, 0.0)), -1, 1))
    return np.where(r < 1 / 3, 500 * (1 + np.cos(3 * np.pi * r)), 0.0)


def lagrange(u: Any, feet: Any) -> Any:
    """Interpolate values in cells at feet (3, n) by cubic Lagrange polynomials."""
    nlon, nlat = u.shape
    x = np.arctan2(feet[1], feet[0]) * nlon / (2 * np.pi) - 0.5
    y = np.arctan2(np.hypot(feet[0], feet[1]), -feet[2]) * nlat / np.pi - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    over = np.concatenate([u, np.roll(u, nlon // 2, 0)[:, ::-1]], axis=1)  # great circles

    def parts(s: Any) -> list[Any]:
        return [
            -s * (s - 1) * (s - 2) / 6, (s + 1) * (s - 1) * (s - 2) / 2,
            -(s + 1) * s * (s - 2) / 2, (s + 1) * s * (s - 1) / 6,
        ]  # fmt: skip

    found = np.zeros(x.shape)
    for p, a in enumerate(parts(x - i)):
        for q, b in enumerate(parts(y - j)):
            found += a * b * over[(i + p - 1) % nlon, (j + q - 1) % (2 * nlat)]
    return found.reshape(u.shape)


def norms(w: Any, u: Any, exact: Any) -> dict[str, float]:
    """Return the normalised errors."""
    return {
        "l1": float((w * abs(u - exact)).sum() / (w * abs(exact)).sum()),
        "l2": float(np.sqrt((w * (u - exact) ** 2).sum() / (w * exact**2).sum())),
        "linf": float(abs(u - exact).max() / abs(exact).max()),
    }


def measured(
    wind: Callable[..., Any], fields: dict[str, Field], cells: int, steps: int
) -> dict[str, Any]:
    """Return errors at the end by scheme and field, and of the mass."""
    sphere, found = Sphere(2 * cells, cells), {}
    w = sphere.weights
    for profile, form in PROFILES.items():
        solver = SphereSolver(sphere, wind, form, profile, foot_tolerance=1e-6)
        start = solver.state(fields | {"one": 1.0})
        end = solver.run(start, T, dt=T / steps).final
        found[profile] = {
            name: norms(w, end.field(name).data[0], start.field(name).data[0])
            | {"mass": abs(end.mass[name] / start.mass[name] - 1)}
            for name in start.fields
        }
    start = {name: solver.state(f)["u"] for name, f in fields.items()}
    u, points = dict(start), in_space(*sphere.mesh()).reshape(3, -1)
    feet = None
    for k in range(steps):
        if feet is None or not solver.steady:
            angle = 1e-6 * np.pi / cells
            feet = traced(solver._wind, points, (k + 1) * T / steps, T / steps, 1.0, angle)
        u = {name: lagrange(one, feet) for name, one in u.items()}
    found[PEER] = {
        name: norms(w, u[name], start[name])
        | {"mass": float(abs((w * u[name]).sum() / (w * start[name]).sum() - 1))}
        for name in start
    }
    return found


def main(arguments: list[str] | None = None) -> None:
    """Print the errors and write them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[30, 45, 60])
    parser.add_argument("--output", type=Path)
    options = parser.parse_args(arguments)
    tests = {
        f"rotation {angle}": (rotation(np.radians(angle)), {"bell": bell}) for angle in (0, 45, 90)
    }
    tests |= {
        f"case {case}": (deformation(case), {"bells": bells(case), "hills": hills(case)})
        for case in (1, 2, 4)
    }
    tests["case 3"] = (deformation(3), {"hills": hills(3)})
    result: dict[str, Any] = {"machine": machine.describe(), "cells": options.cells, "tests": {}}
    for test, (wind, fields) in tests.items():
        rows = {}
        for cells in options.cells:
            rows[str(cells)] = measured(wind, fields, cells, 11 * cells // 10)
            for scheme, by_field in rows[str(cells)].items():
                for name, row in by_field.items():
                    told = " ".join(f"{key} {value:.1e}" for key, value in row.items())
                    print(f"{test:11} {cells:4} {scheme:15} {name:6} {told}", flush=True)
        orders = {}
        if len(options.cells) > 2:
            for scheme in (*PROFILES, PEER):
                for name in fields:
                    l2 = [rows[str(n)][scheme][name]["l2"] for n in options.cells]
                    fit = np.polyfit(np.log(options.cells), np.log(l2), 1)
                    orders.setdefault(scheme, {})[name] = -float(fit[0])
            print(f"{test:11} orders {orders}", flush=True)
        result["tests"][test] = {"errors": rows, "orders": orders}
    if options.output:
        options.output.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
