"""Compilation with numba.

Three private interfaces of numba make the kernels fast; those in `fenicsrom.online.kernels.stored_code`
load them fast. Each was checked with the versions of numba from `FIRST` to `LAST`; any other
version runs without them, slower and with the same results:

- `_source_stamp` of a cache file decides whether stored machine code is still valid. Without it
  nothing is stored, because numba's own rule misses changes in other files.
- the option `_nrt=False` compiles a function without the counting of references to arrays.
- `meminfo` and `parent` of an array are cleared by `borrowed`, so that callers count nothing.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, overload, overload_method

_FOLDER = Path(__file__).parent
TYPES = ("model", "scheme")  # modules of the named tuples that kernels receive but do not import
FIRST, LAST = (0, 61), (0, 65)  # versions of numba that were checked


def _is_supported(version: str) -> bool:
    """Whether the private interfaces were checked with this version of numba."""
    found = re.match(r"(\d+)\.(\d+)", version)
    return found is not None and FIRST <= (int(found[1]), int(found[2])) <= LAST


PRIVATE = _is_supported(numba.__version__) and not numba.config.DISABLE_JIT
UNCOUNTED: dict[str, bool] = {"_nrt": False} if PRIVATE else {}
"""Options of a function that makes no arrays, so that it need not count references."""
INLINED = {**UNCOUNTED, "forceinline": True}


@cache
def _stamp(module: str) -> str:
    """A digest of a module and of all modules of this package on which its machine code depends.

    These are the modules that it imports and those of `TYPES`. For a module of another package,
    these are all modules.
    """
    package, _, own = module.rpartition(".")
    found: dict[str, str] = {}
    queue = [own, *TYPES] if package == __package__ else [p.stem for p in _FOLDER.glob("*.py")]
    while queue:
        name = queue.pop()
        path = _FOLDER / f"{name}.py"
        if name not in found and path.exists():
            found[name] = path.read_text(encoding="utf-8")
            queue += re.findall(r"from fenicsrom\.online\.(\w+) import", found[name])
    return hashlib.sha256("".join(found[name] for name in sorted(found)).encode()).hexdigest()


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function with numba, and store the machine code for the next process.

    Numba's own rule keeps stored code until the function's own file changes. The code contains
    functions and constants of other files too, so this decorator keeps it until any of these files
    changes.
    """
    dispatcher = njit(cache=PRIVATE, error_model="numpy", **options)(function)
    if PRIVATE:
        dispatcher._cache._cache_file._source_stamp = _stamp(function.__module__)
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays."""
    return compiled(function, **UNCOUNTED)


def part(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays and is always inlined into its callers.

    Passing tuples of many arrays costs more than the arithmetic of a short function.
    """
    return compiled(function, **INLINED)


def compile_methods(cls: Any, names: Iterable[str]) -> None:
    """Let compiled code call methods of a named tuple: `model.mass_times(v)`.

    Args:
        cls: the named tuple.
        names: its methods; each body is inlined into the caller. In compiled code, the method would
            hide a field of the same name of any named tuple.
    """
    for name in names:
        overload_method(types.NamedTuple, name, inline="always", strict=False)(
            _method_of(cls, getattr(cls, name))
        )


def _method_of(cls: Any, method: Callable[..., Any]) -> Callable[..., Any]:
    """The overload that numba calls for a method: it returns the method itself for this class.

    The implementation must be an object of its module: numba finds no stored code for a function
    that is made anew in each process.
    """

    def choose(model, *arguments):  # type: ignore[no-untyped-def]
        return method if model.instance_class is cls else None

    return choose


# Numba counts the references to every array of every tuple that is passed on, in atomic operations
# that took more than half of the run time. The compiled loop therefore works with arrays without an
# owner, which are not counted; the caller of the loop keeps their memory alive. Never write to such
# an array in the function that calls `borrowed`: numba does not see that both arrays share memory,
# and would remove the write as dead code. Pass the array to another function and write to it there.


def borrowed(value):  # type: ignore[no-untyped-def]
    """The value itself; in compiled code, with arrays whose references are not counted."""
    return value


def _without_owners(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Clear the owner of every array in a value of this type."""
    if isinstance(kind, types.BaseTuple):
        members = [
            _without_owners(context, builder, k, builder.extract_value(value, i))
            for i, k in enumerate(kind)
        ]
        return context.make_tuple(builder, kind, members)
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    return value


@intrinsic
def _borrow(typing_context, value):  # type: ignore[no-untyped-def]
    return value(value), lambda context, builder, _, arguments: _without_owners(
        context, builder, value, arguments[0]
    )


@overload(borrowed, jit_options={"forceinline": True})
def _borrowed(value):  # type: ignore[no-untyped-def]
    return (lambda value: _borrow(value)) if PRIVATE else (lambda value: value)
