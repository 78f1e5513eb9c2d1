"""Complex-step derivatives of compiled functions: what numba lacks to run them on complex numbers.

A real function f evaluated at x + i h gives f(x) + i h f'(x) without cancellation, so that with
h = 1e-30 the imaginary part divided by h is the derivative to rounding (Squire and Trapp 1998,
SIAM Review 40, 110-112). A function with branches is differentiated on the branch that the real
parts choose. Numba orders no complex numbers and has no arctan2 of them: here it gets both, for
all compiled functions of this process, through its public extension interface.
"""

import operator
from typing import Any

import numpy as np
from numba import types
from numba.extending import lower_builtin, overload

from fenicsrom.online.kernels.emission import PART

STEP = 1e-30  # h


def _numbers_with_complex(a: Any, b: Any) -> bool:
    kinds = (a, b)
    return all(isinstance(kind, types.Number) for kind in kinds) and any(
        isinstance(kind, types.Complex) for kind in kinds
    )


def _order_by_real_part(compare: Any, sign: str) -> None:
    """Let numba compare complex numbers by their real parts, also inside min and max."""

    def choose(a, b):  # type: ignore[no-untyped-def]
        return (lambda a, b: compare(a.real, b.real)) if _numbers_with_complex(a, b) else None

    overload(compare, jit_options=PART)(choose)

    def lower(context, builder, signature, values):  # type: ignore[no-untyped-def]
        first, second = (
            context.make_complex(builder, kind, value).real
            for kind, value in zip(signature.args, values, strict=True)
        )
        return builder.fcmp_ordered(sign, first, second)

    lower_builtin(compare, types.Complex, types.Complex)(lower)


for _compare, _sign in (
    (operator.lt, "<"),
    (operator.gt, ">"),
    (operator.le, "<="),
    (operator.ge, ">="),
):
    _order_by_real_part(_compare, _sign)


@overload(np.arctan2, jit_options=PART)
def _arctan2(y, x):  # type: ignore[no-untyped-def]
    if not _numbers_with_complex(y, x):
        return None

    def arctan2(y, x):  # type: ignore[no-untyped-def]
        change = (x.real * y.imag - y.real * x.imag) / (x.real * x.real + y.real * y.real)
        return complex(np.arctan2(y.real, x.real), change)

    return arctan2


def as_complex(values: Any, fields: tuple[str, ...] | None = None) -> Any:
    """A named tuple with its real arrays (or those of the named fields) copied as complex ones."""
    return type(values)(
        *(
            as_complex(array)
            if isinstance(array, tuple) and hasattr(array, "_fields")
            else array.astype(np.complex128)
            if isinstance(array, np.ndarray)
            and array.dtype == np.float64
            and (fields is None or name in fields)
            else array
            for name, array in zip(values._fields, values, strict=True)
        )
    )
