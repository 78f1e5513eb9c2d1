"""Compilation with numba.

A compiled function has two sides. Compiled code calls the function itself, a part of a larger
program. Python calls an entry, which makes references of the named tuples among its arguments
(`online.kernels.references`), and whose machine code holds all parts below it
(`online.kernels.emission`). The machine code of entries is stored for the next process.

Numba finds stored code by the place and the name of a function, and keeps it until the file of the
function changes. The machine code depends on other files too. It is therefore kept until one of the
modules changes that the module of the function imports. Where numba is of a version that was not
checked, the digest of these modules is a part of the name.
"""

import hashlib
import re
import sys
from collections.abc import Callable, Iterable
from functools import cache, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba import njit, typeof, types
from numba.core.errors import NumbaError
from numba.core.event import register
from numba.extending import overload_method, register_jitable

from fenicsrom.online.kernels.compilation import COMPILATIONS
from fenicsrom.online.kernels.emission import ENTRY, IS_CHECKED, PART
from fenicsrom.online.kernels.references import TupleReference, borrow

PACKAGE = "fenicsrom.online"
TYPES = ("fenicsrom.online.model.model", "fenicsrom.online.step.scheme")
"""Modules of the named tuples that kernels receive but do not import."""
KERNEL = {**PART, "_nrt": False}
"""Options of a part that makes no arrays, so that it need not count references to arrays."""
SHORT = {**KERNEL, "forceinline": True}
"""Options of a part of a few lines, which is always inlined."""

register("numba:compile", COMPILATIONS)

_FOLDER = Path(sys.modules[PACKAGE].__path__[0])
_IMPORT = re.compile(
    rf"^\s*(?:from|import) ({re.escape(PACKAGE)}[\w.]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE
)


@cache
def read_sources(folder: Path = _FOLDER) -> dict[str, str]:
    """The text of every module of `PACKAGE` and of its sub-packages, by its dotted name.

    Args:
        folder: the folder of `PACKAGE`.
    """
    texts = {}
    for path in folder.rglob("*.py"):
        places = path.relative_to(folder).with_suffix("").parts
        name = ".".join([PACKAGE, *(place for place in places if place != "__init__")])
        texts[name] = path.read_text(encoding="utf-8")
    return texts


@cache
def _imports(text: str) -> set[str]:
    """The names of `PACKAGE` that a module imports, some of which may be modules.

    `from a.b import name` may import the module `a.b.name` or an object of the module `a.b`.
    """
    found = set()
    for module, names in _IMPORT.findall(text):
        found |= {module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))}
    return found


def stamp(module: str, sources: dict[str, str]) -> str:
    """A digest of a module and of all modules of `PACKAGE` on which its machine code depends.

    These are the modules that it imports, directly or through others, and those of `TYPES`. For a
    module of another package, these are all modules.

    Args:
        module: the name of the module.
        sources: all modules, as from `read_sources`.
    """
    found: set[str] = set()
    queue = {module, *TYPES} if module in sources else set(sources)
    while queue:
        found |= queue
        queue = set().union(*(_imports(sources[name]) for name in queue)) & set(sources) - found
    return hashlib.sha256("".join(sources[name] for name in sorted(found)).encode()).hexdigest()


class Compiled:
    """A compiled function; it must not return an array that is, or is in, one of its arguments.

    Attributes:
        py_func: the function of Python.
        part: what compiled code calls.
        entry: what Python calls.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]):
        """Compile a function.

        Args:
            function: the function.
            options: `PART`, `KERNEL` or `SHORT`.
        """
        self.py_func = function
        self.part = njit(error_model="numpy", **options)(function)
        digest = stamp(function.__module__, read_sources())
        name = function.__qualname__ if IS_CHECKED else f"{function.__qualname__}_{digest}"
        self.entry = njit(error_model="numpy", cache=True, **ENTRY)(
            _entry(function, name, self.part)
        )
        if IS_CHECKED:
            self.entry._cache._cache_file._source_stamp = digest
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Call the machine code; where the stored one cannot be read, compile again.

        The entry lists a signature once its code is there. `recompile` empties the stored index.
        """
        try:
            return self.entry(*arguments)
        except NumbaError:
            raise
        except Exception:
            kinds = tuple(map(typeof, arguments))
            if kinds in [tuple(known) for (known,) in self.entry.signatures]:
                raise  # by the function itself
            self.entry.recompile()
            return self.entry(*arguments)

    @property
    def _numba_type_(self) -> Any:
        """The type of the part, for numba."""
        return typeof(self.part)


def _entry(function: Callable[..., Any], name: str, part: Any) -> Any:
    """The function of Python that calls a part, at the place of another function.

    It is no closure: the stored code of a closure holds what it closes over.
    """
    code = _call.__code__.replace(
        co_filename=function.__code__.co_filename,
        co_firstlineno=function.__code__.co_firstlineno,
        co_name=function.__name__,
        co_qualname=name,
    )
    return FunctionType(code, {"__name__": function.__module__, "part": part, "borrow": borrow})


def _call(*arguments):  # type: ignore[no-untyped-def]
    """Call the part; the code of every entry."""
    return part(*borrow(arguments))


def _with(options: dict[str, Any], function: Callable[..., Any]) -> Any:
    """Compile a function with these options, unless numba is told to compile nothing."""
    return function if numba.config.DISABLE_JIT else Compiled(function, options)


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function that may make arrays."""
    return _with(PART, function)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays."""
    return _with(KERNEL, function)


def part(function: Callable[..., Any]) -> Any:
    """Compile a function of a few lines that makes no arrays and is inlined into its callers."""
    return _with(SHORT, function)


def also_compiled(function: Callable[..., Any]) -> Any:
    """Let compiled code call a function that stays one of Python."""
    return register_jitable(**PART)(function)


def compile_methods(cls: Any, names: Iterable[str]) -> None:
    """Let compiled code call methods of a named tuple: `model.mass_times(v)`.

    Args:
        cls: the named tuple.
        names: its methods; each body is inlined into the caller. In compiled code, the method would
            hide a field of the same name of any named tuple.
    """
    for name in names:
        for kind in (types.NamedTuple, TupleReference):
            overload_method(kind, name, inline="always", strict=False, jit_options=PART)(
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
