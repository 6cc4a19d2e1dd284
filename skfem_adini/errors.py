"""Exceptions and warnings of the package, all under :class:`AdiniError`."""


class AdiniError(Exception):
    """Base class of every exception raised by `skfem_adini`."""


class InputError(AdiniError, ValueError):
    """An argument cannot be used; the message names it, what was found and what to do."""


class MissingDependency(AdiniError, ImportError):
    """An optional package is not installed; the message holds the line that installs it."""


class NotConverged(AdiniError):
    """An iteration did not reach its tolerance; the message says how far it came."""


class ReducedOrderWarning(UserWarning):
    """Not issued any more: cells on which an order is lost are named in the log (`logging`).

    The name stays so that filters which hold it go on working.
    """


class UnresolvedWarning(UserWarning):
    """A cut domain has gaps, holes or strips narrower than the cells: refine the mesh there."""
