"""What a call of `solve_qp` may spend, and the best point that it met."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from gpu.errors import InputError
from skfem_adini.ground.arguments import integer


class Budget:
    """Steps and seconds of one call, all attempts and proofs together; `TimeoutError`, which is no
    error of the library, so that no way on is tried, ends it."""

    def __init__(self, time_limit: float | None = None, max_steps: int | None = None) -> None:
        number = isinstance(time_limit, int | float | np.number)
        if time_limit is not None and not (number and time_limit > 0.0):
            raise InputError(f"time_limit is {time_limit!r}: it must be a positive number")
        self.steps, self.begin = 0, time.perf_counter()
        self.best: Any = None  # a point of least residuals
        self.most = float("inf") if max_steps is None else integer("max_steps", max_steps, 1)
        self.seconds = float("inf") if time_limit is None else time_limit

    @property
    def limited(self) -> bool:
        """Whether there is a limit at all."""
        return min(self.most, self.seconds) < float("inf")

    def __str__(self) -> str:
        return f"{self.steps} steps and {time.perf_counter() - self.begin:.3g} s"

    def count(self, *_: Any) -> None:
        """Count a step of an auxiliary problem; raise `TimeoutError` after the last."""
        self.steps += 1
        if self.steps >= self.most or time.perf_counter() - self.begin >= self.seconds:
            raise TimeoutError

    def step(self, point: Any, tol: float) -> None:
        """The same for the problem itself; nothing is raised where the point is good enough."""
        if self.best is None or point.residuals.worst < self.best.residuals.worst:
            self.best = point
        try:
            self.count()
        except TimeoutError:
            if not point.residuals.worst <= tol:
                raise
