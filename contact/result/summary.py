"""A contact result in a few lines of text, or as an HTML table."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from contact.output.sides import pair_name


def counts(result: Any) -> str:
    """How many contact points are open, stick and slip, and are bonded or held, if any are."""
    return _counted(result.status)


def _counted(status: Any) -> str:
    free, stick, slip, bonded, held = np.bincount(status, minlength=5)
    more = f", {bonded} bonded" if bonded else ""
    more += f", {held} undetermined" if held else ""
    return f"{status.size} points: {free} open, {stick} stick, {slip} slip{more}"


def facts(result: Any) -> dict[str, str]:
    """The most important facts of a result, by name.

    Parameters
    ----------
    result : ContactResult
    """
    system, kkt = result.system, result.kkt
    highest = int(np.argmax(result.pressure)) if np.any(result.pressure) else None
    worst = max(kkt, key=lambda name: kkt[name])
    law = system.law
    if law is not None:
        low, high = np.min(system.friction), np.max(system.friction)
        strength = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        law = f"{law}, " + ("friction " if law == "coulomb" else "bound as a force ") + strength
    return {
        **_bodies(system.body),
        "law": law or "without friction",
        "functional": system.rows.functional,
        "solved by": f"{result.method}, iterations: {len(result.history)}",
        "contact": counts(result),
        **_forces(result),
        "pressure": "none"
        if highest is None
        else f"at most {result.pressure[highest]:.6g}, at {vector(result.x[:, highest])}",
        "displacement": f"at most {system.body.reach(result.u):.6g}",
        "certificate": f"no residual above {kkt[worst]:.1e} ({worst})",
    }


def _bodies(body: Any) -> dict[str, str]:
    """The body, or each of several by its name or number."""
    if len(body.bodies) == 1:
        return {"body": repr(body)}
    return {one.name or f"body {k}": repr(one) for k, one in enumerate(body.bodies)}


def _forces(result: Any) -> dict[str, str]:
    """The resultant; of several bodies that of each contact and tie, and how its points are."""
    body, owner = result.system.body, result.system.rows.owner
    if len(body.bodies) == 1:
        return {"resultant": vector(result.resultant)}
    found = {}
    # Points of one pair are all bonded or all free.
    for k, force in enumerate(result.resultants + result.tie_resultants):
        own = result.part == k
        whose = body.called(int(owner[own][0]))
        found[pair_name(result, k)] = f"{_counted(result.status[own])}; {vector(force)} on {whose}"
    return found


def as_text(rows: dict[str, str], title: str) -> str:
    """Lines of names and values."""
    width = max(map(len, rows))
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in rows.items())])


def as_html(rows: dict[str, str], title: str) -> str:
    """The table that notebooks show."""
    body = "".join(
        f"<tr><th style='text-align: left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    return f"<table><caption>{escape(title)}</caption>{body}</table>"


def vector(values: Any) -> str:
    """Six digits of each component; components that are rounding errors are shown as 0."""
    rounding = 1e-12 * np.abs(values).max()
    return "(" + ", ".join("0" if abs(v) <= rounding else f"{v:.6g}" for v in values) + ")"
