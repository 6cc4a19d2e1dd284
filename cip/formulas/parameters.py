"""Named parameters of formulas: variables whose values compiled code gets as arguments."""

from __future__ import annotations

import keyword
from collections.abc import Iterable, Mapping
from copy import deepcopy
from functools import cache
from typing import Any, Self

import numpy as np

from cip.errors import InputError
from cip.formulas.expression import COORDINATES, RULES, Expression, ordered, variable
from skfem_adini.ground.arguments import real_number

# Put before a parameter's name in code, so that it is no coordinate and no unknown of a path.
_PREFIX = "p_"


def parameter(name: str) -> Expression:
    """The node of the parameter of this name."""
    return variable(f"{_PREFIX}{name}")


def parameters_in(nodes: Iterable[Expression]) -> list[str]:
    """The variables of all parameters in some formulas, as code names them, in order."""
    found = {node.value for node in ordered(list(nodes)) if node.op == "variable"}
    return sorted(name for name in found if name.startswith(_PREFIX))


def bound(values: Mapping[str, float]) -> dict[str, np.float64]:
    """The values by their names in code, as NumPy numbers, which overflow to infinity."""
    return {f"{_PREFIX}{name}": np.float64(value) for name, value in values.items()}


@cache
def _reserved() -> set[str]:
    """Names with a fixed meaning in the languages that formulas become. C11 and C++20, chapters on
    keywords; C11 7.12; CUDA C++ Programming Guide, language extensions. Generated code puts
    `_PREFIX` before every name, so these names would be harmless but misleading."""
    c = """
    alignas alignof and and_eq asm atomic_cancel atomic_commit atomic_noexcept auto bitand bitor
    bool break case catch char char8_t char16_t char32_t class co_await co_return co_yield compl
    complex concept const const_cast consteval constexpr constinit continue decltype default delete
    do double dynamic_cast else enum explicit export extern false float for friend goto if imaginary
    import inline int long module mutable namespace new noexcept noreturn not not_eq nullptr
    operator or or_eq private protected public reflexpr register reinterpret_cast requires restrict
    return short signed sizeof static static_assert static_cast struct switch synchronized template
    this thread_local throw true try typedef typeid type typename typeof union unsigned
    using virtual void volatile wchar_t while xor xor_eq defined errno main std assert
    """
    macros = """
    NULL EOF NAN INFINITY HUGE_VAL HUGE_VALF HUGE_VALL MATH_ERRNO MATH_ERREXCEPT math_errhandling
    RAND_MAX inf nan isfinite isinf isnan isnormal signbit fpclassify isgreater isgreaterequal
    isless islessequal islessgreater isunordered FP_NAN FP_INFINITE FP_ZERO FP_SUBNORMAL FP_NORMAL
    FP_FAST_FMA FP_FAST_FMAF FP_FAST_FMAL FP_ILOGB0 FP_ILOGBNAN M_E M_LOG2E M_LOG10E M_LN2 M_LN10
    M_PI M_PI_2 M_PI_4 M_1_PI M_2_PI M_2_SQRTPI M_SQRT2 M_SQRT1_2 MAXFLOAT
    """
    math = """
    acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs
    fdim floor fma fmax fmin fmod frexp hypot ilogb ldexp lgamma llrint llround log log10 log1p log2
    logb lrint lround modf nan nearbyint nextafter nexttoward pow remainder remquo rint round
    scalbln scalbn sin sinh sqrt tan tanh tgamma trunc abs min max rsqrt rcbrt sincos sincospi sinpi
    cospi exp10 erfinv erfcinv erfcx normcdf normcdfinv
    """
    cuda = "threadIdx blockIdx blockDim gridDim warpSize dim3"
    vectors = "char uchar short ushort int uint long ulong longlong ulonglong float double"
    return {
        *keyword.kwlist,
        *keyword.softkwlist,
        *f"{c} {macros} {cuda}".split(),
        *(f"{name}{kind}" for name in math.split() for kind in ("", "f", "l")),
        *(f"{name}{size}" for name in vectors.split() for size in ("", "1", "2", "3", "4")),
        *(f"{k}{bits}_t" for k in ("int", "uint") for bits in (8, 16, 32, 64, "max", "ptr")),
        *("size_t", "ptrdiff_t", "float_t", "double_t"),
    }


def reserved(name: str) -> bool:
    """Whether a name is a keyword of Python, C, C++ or CUDA, or reserved by one of them."""
    # Python and C reserve names that begin with an underscore, C++ those that hold two.
    prefixes = ("_", "FLT_", "DBL_", "LDBL_", "CUDA_", "CUDART_", "cuda", "atomic")
    return name in _reserved() or name.startswith(prefixes) or "__" in name


def checked(values: Any) -> dict[str, float]:
    """The argument `parameters` as names and finite numbers. Raises `InputError` for names that a
    formula cannot contain or that have another meaning in it."""
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise InputError(f"parameters: expected numbers by names, got {values!r}")
    taken = {*COORDINATES, "x", "y", "z", "pi", "e", *RULES}
    found = {}
    for name, value in values.items():
        if not (isinstance(name, str) and name.isascii() and name.isidentifier()):
            raise InputError(f"parameters: {name!r} is no name; take ASCII letters, digits and _")
        if name not in taken and reserved(name):
            raise InputError(
                f"parameters: {name!r} is no name for a parameter: it is a keyword or reserved in "
                "Python, C or CUDA; take another one"
            )
        if name in taken:
            raise InputError(f"parameters: {name!r} has a meaning in formulas; take another name")
        number = real_number(f"parameters: {name!r}", value)
        if not np.isfinite(number):
            raise InputError(f"parameters: {name!r} must be finite, got {value!r}")
        found[name] = float(number)
    return found


class Parametrised:
    """Base of objects with named parameters: their values, and copies with other values."""

    _kind = "function"
    _parameters: dict[str, float]

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the named parameters by names; a copy.

        Those of a solver are the parameters of its velocity, source, decay and boundary, in this
        order, where one name is one parameter.
        """
        return dict(self._parameters)

    def with_parameters(self, /, **values: float) -> Self:
        """The same formulas with other values of some parameters; nothing is compiled again.

        Parameters
        ----------
        **values : float
            New values by name; the other parameters keep theirs.

        Returns
        -------
        Velocity, Source or Solver
            As this one.

        Raises
        ------
        InputError
            A name that is none of the parameters, or a value that is not a finite number.

        Examples
        --------
        >>> from cip import Velocity
        >>> Velocity.from_expression("a + t", parameters={"a": 1}).with_parameters(a=2).parameters
        {'a': 2.0}
        """
        unknown = sorted(set(values) - set(self._parameters))
        if unknown:
            known = ", ".join(self._parameters) or "it has none"
            raise InputError(f"{unknown[0]}: no parameter of this {self._kind}; known: {known}")
        return self._with({**self._parameters, **checked(values)})

    def _with(self, values: dict[str, float]) -> Self:
        """A copy with these values of all parameters."""
        new = self._copy()
        new._parameters = values
        return new

    def _copy(self) -> Self:
        """Another object with the same attributes."""
        new = object.__new__(type(self))
        new.__dict__.update(self.__dict__)
        return new

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        new = object.__new__(type(self))
        new.__dict__.update({name: deepcopy(value, memo) for name, value in self.__dict__.items()})
        return new


def require_held(names: Iterable[str], formulas: Iterable[Expression]) -> None:
    """Raise `InputError` for a parameter that no formula contains."""
    held = set(ordered(list(formulas)))
    unused = [name for name in names if parameter(name) not in held]
    if unused:
        raise InputError(f"parameters: no formula holds {unused[0]!r}; leave it out")
