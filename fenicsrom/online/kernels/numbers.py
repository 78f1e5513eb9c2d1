"""Numbers that carry derivatives, and vectors of three numbers, in Python and in compiled code.

A function that is written for numbers runs on three kinds of them: floats; a `Dual`, which carries
its derivatives by three variables; and complex numbers, whose imaginary part is `STEP` times a
derivative. f(x + i h) = f(x) + i h f'(x) has no cancellation, so that with h = 1e-30 the derivative
is right to rounding (Squire and Trapp 1998, SIAM Review 40, 110-112). A branch asks for `value`: a
derivative never decides it. Vectors of a problem in 2D have a third component 0.
"""

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.compilation import SHORT, part

STEP = 1e-30
"""h, the imaginary part of a complex number whose derivative is 1."""

Number = Any
"""A float, a complex number or a `Dual`."""
Vector = tuple[Any, Any, Any]
"""A vector of three numbers."""


class Dual(NamedTuple):
    """A number v with its derivatives a, b, c by three variables."""

    v: float
    a: float
    b: float
    c: float


# numbers of numpy leave the arithmetic to this class
Dual.__array_ufunc__ = None  # type: ignore[attr-defined]


def _divided(x, y):  # type: ignore[no-untyped-def]
    """The quotient of two duals."""
    q = x.v / y.v
    return Dual(q, (x.a - q * y.a) / y.v, (x.b - q * y.b) / y.v, (x.c - q * y.c) / y.v)


def _divides(x, y):  # type: ignore[no-untyped-def]
    """The quotient of a float and a dual."""
    q = x / y.v
    return Dual(q, -q * y.a / y.v, -q * y.b / y.v, -q * y.c / y.v)


_ARITHMETIC: dict[str, tuple[Callable[..., Dual], ...]] = {
    # of two duals, of a dual and a float, of a float and a dual
    "add": (
        lambda x, y: Dual(x.v + y.v, x.a + y.a, x.b + y.b, x.c + y.c),
        lambda x, y: Dual(x.v + y, x.a, x.b, x.c),
        lambda x, y: Dual(x + y.v, y.a, y.b, y.c),
    ),
    "sub": (
        lambda x, y: Dual(x.v - y.v, x.a - y.a, x.b - y.b, x.c - y.c),
        lambda x, y: Dual(x.v - y, x.a, x.b, x.c),
        lambda x, y: Dual(x - y.v, -y.a, -y.b, -y.c),
    ),
    "mul": (
        lambda x, y: Dual(
            x.v * y.v, x.v * y.a + x.a * y.v, x.v * y.b + x.b * y.v, x.v * y.c + x.c * y.v
        ),
        lambda x, y: Dual(x.v * y, x.a * y, x.b * y, x.c * y),
        lambda x, y: Dual(x * y.v, x * y.a, x * y.b, x * y.c),
    ),
    "truediv": (_divided, lambda x, y: Dual(x.v / y, x.a / y, x.b / y, x.c / y), _divides),
}


def _is_dual(kind: Any) -> bool:
    """Whether a type of numba is that of a `Dual`."""
    return getattr(kind, "instance_class", None) is Dual


def _let_calculate(
    name: str, both: Callable[..., Dual], left: Callable[..., Dual], right: Callable[..., Dual]
) -> None:
    """Give `Dual` an operator, in Python and in compiled code."""

    def choose(x, y):  # type: ignore[no-untyped-def]
        if _is_dual(x):
            return both if _is_dual(y) else left
        return right if _is_dual(y) else None

    overload(getattr(operator, name), jit_options=SHORT)(choose)
    setattr(Dual, f"__{name}__", lambda x, y: (both if isinstance(y, Dual) else left)(x, y))
    setattr(Dual, f"__r{name}__", lambda y, x: right(x, y))


for _name, _three in _ARITHMETIC.items():
    _let_calculate(_name, *_three)


def value(x: Number) -> float:
    """The value of a number, without its derivatives."""
    return float(x.v if isinstance(x, Dual) else x.real)


@overload(value, jit_options=SHORT)
def _value(x):  # type: ignore[no-untyped-def]
    return (lambda x: x.v) if _is_dual(x) else (lambda x: x.real)


def lifted(x: Number, y: float, slope: float) -> Number:
    """The number f(x) with the value y and the derivatives of x times `slope`, f'(x)."""
    if isinstance(x, Dual):
        return Dual(y, slope * x.a, slope * x.b, slope * x.c)
    return complex(y, slope * x.imag) if np.iscomplexobj(x) else y


@overload(lifted, jit_options=SHORT)
def _lifted(x, y, slope):  # type: ignore[no-untyped-def]
    if _is_dual(x):
        return lambda x, y, slope: Dual(y, slope * x.a, slope * x.b, slope * x.c)
    if isinstance(x, types.Complex):
        return lambda x, y, slope: complex(y, slope * x.imag)
    return lambda x, y, slope: y


def constant(x: Number, y: Number) -> Number:
    """The number y, of the kind of x; it has no derivatives if it is a float."""
    if isinstance(x, Dual) and not isinstance(y, Dual):
        return Dual(y, 0.0, 0.0, 0.0)
    return y


@overload(constant, jit_options=SHORT)
def _constant(x, y):  # type: ignore[no-untyped-def]
    if _is_dual(x) and not _is_dual(y):
        return lambda x, y: Dual(y, 0.0, 0.0, 0.0)
    if isinstance(x, types.Complex) and not isinstance(y, types.Complex):
        return lambda x, y: complex(y, 0.0)
    return lambda x, y: y


def vector(x: Any) -> Vector:
    """The three components of an array (d,) or of a vector."""
    if isinstance(x, np.ndarray):
        return x[0], x[1], x[2] if x.size > 2 else 0.0
    first, second, third = x
    return first, second, third


@overload(vector, jit_options=SHORT)
def _vector(x):  # type: ignore[no-untyped-def]
    if isinstance(x, types.Array):
        return lambda x: (x[0], x[1], x[2] if x.size > 2 else 0.0 * x[0])
    return lambda x: x


@part
def write_vector(out: Array, u: Vector) -> None:
    """Write a vector into an array (d,)."""
    out[0], out[1] = u[0], u[1]
    if out.size > 2:
        out[2] = u[2]


@part
def plus(u: Vector, v: Vector) -> Vector:
    """The sum of two vectors."""
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


@part
def minus(u: Vector, v: Vector) -> Vector:
    """The difference of two vectors."""
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


@part
def times(s: Number, u: Vector) -> Vector:
    """The product of a number and a vector."""
    return s * u[0], s * u[1], s * u[2]


@part
def dot(u: Vector, v: Vector) -> Number:
    """The inner product of two vectors."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@part
def root(x: Number) -> Number:
    """The square root; where it is zero, so is its derivative."""
    found = np.sqrt(max(value(x), 0.0))  # h^2 may leave a complex zero below zero
    return lifted(x, found, 0.5 / found if found > 0.0 else 0.0)


@part
def positive(x: Number) -> Number:
    """The positive part of a number."""
    return x if value(x) > 0.0 else constant(x, 0.0)


@part
def cosine(x: Number) -> Number:
    """The cosine."""
    return lifted(x, np.cos(value(x)), -np.sin(value(x)))


@part
def sine(x: Number) -> Number:
    """The sine."""
    return lifted(x, np.sin(value(x)), np.cos(value(x)))


@part
def angle_of(x: Number, y: Number) -> Number:
    """The angle of the point (x, y) in a plane, rad."""
    a, b = value(x), value(y)
    square = a * a + b * b
    return lifted(y, np.arctan2(b, a), a / square) + lifted(x, 0.0, -b / square)


def as_complex(values: Any) -> Any:
    """A named tuple whose arrays of floats are copied as complex ones, in tuples within it too."""
    found = []
    for array in values:
        if isinstance(array, tuple):
            found.append(as_complex(array))
        elif array.dtype == np.float64:
            found.append(array.astype(np.complex128))
        else:
            found.append(array)
    return type(values)(*found)
