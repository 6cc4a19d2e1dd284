"""Errors of this package; each message names the argument, what was found, and what to do."""

from __future__ import annotations


class CipError(Exception):
    """Base class of every error raised on purpose by `cip`."""


class InputError(CipError, ValueError):
    """An argument is malformed."""


class NotSupported(CipError, NotImplementedError):
    """A valid request that this version cannot serve."""


class MissingDependency(CipError, ImportError):
    """An optional package is needed and not installed."""


class LeftDomain(CipError):
    """A backward characteristic leaves the domain where no boundary data is given."""


class NotFinite(CipError):
    """A velocity, a characteristic or a moment is NaN or infinite; nothing is returned."""


class NotConverged(CipError):
    """The characteristics do not reach their tolerance within the allowed sub-steps."""
