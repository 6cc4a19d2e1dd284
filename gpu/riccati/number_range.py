"""What to do where numbers leave the range of double precision."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

from gpu.errors import GpuError, NotConverged

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def within_range(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function without warnings of what overflows, which its certificates judge.

    The wrappers of LAPACK refuse what has overflowed before any certificate is reached.
    """

    @functools.wraps(function)
    def judged(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            with np.errstate(all="ignore"):
                return function(*args, **kwargs)
        except ValueError as error:
            if isinstance(error, GpuError) or "infs or NaNs" not in str(error):
                raise
            raise NotConverged(
                "numbers beyond the range of double precision came up: measure states, inputs or "
                "costs in other units"
            ) from None

    return judged
