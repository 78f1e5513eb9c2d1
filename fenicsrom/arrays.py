"""The array types that signatures name, and named tuples of arrays."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""An array of floats; docstrings give its shape."""

T = TypeVar("T")


@cache
def _fields(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def _scalar(hint: Any) -> type[Any]:
    """The type of the numbers of an array type, which numpy writes with `dtype` until 2.4."""
    last = get_args(hint)[-1]
    return last if get_origin(last) is None else _scalar(last)


def zeros(kind: Callable[..., T], given: Mapping[str, Any] | None = None, /, **sizes: int) -> T:
    """A named tuple of zeros.

    Args:
        kind: the named tuple. Its fields declare their shapes, as `Annotated[Array, "P 3"]`; a
            field without a shape is a named tuple of zeros, too.
        given: the fields that are not zero.
        sizes: the sizes that the shapes name.
    """

    def made(hint: Any) -> Any:
        if not hasattr(hint, "__metadata__"):
            return zeros(hint, **sizes)
        shape = [int(sizes.get(size, size)) for size in hint.__metadata__[0].split()]
        return np.zeros(shape, _scalar(hint.__origin__))

    fields = given or {}
    rest = {name: made(hint) for name, hint in _fields(kind).items() if name not in fields}
    return kind(**fields, **rest)
