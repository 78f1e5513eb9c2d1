"""Compilation with numba: kernels, what they pass on, their machine code, and its store.

A compiled function has two sides. Compiled code calls the function itself, a part of a larger
program. Python calls an entry. Numba's own way has two costs, which this module avoids.

**Named tuples.** Numba passes a tuple by value: every call of a function moves each pointer, size
and stride of each array in it, some hundred numbers for the state of a time integration, and counts
a reference to each array. Here an entry makes pointers of the named tuples among its arguments, and
a field is loaded where it is used. Two facts make these loads cheap:

- Nothing writes into a tuple (only into the arrays that it holds). Its loads are therefore marked
  as invariant, so that LLVM keeps them in registers and moves them out of loops.
- The caller keeps the arrays alive. A loaded array therefore has no owner, and no references to it
  are counted.

Source: numba's low-level extension interface (numba documentation, "Extending Numba"), and
"invariant.load" of LLVM's language reference.

**Machine code.** Numba optimises each function and makes its machine code, and does both again in
each of its callers. Here a part is translated to LLVM's intermediate code. An entry is linked with
all parts below it, each once; LLVM then optimises the whole, and makes its machine code once. The
parts are internal to the entry: their names cannot meet those of the same parts in another entry,
or in stored machine code.

A part becomes internal only when all are linked. Numba optimises each function alone before that,
and may remove the only call of a part (`if derive:` where `derive` is the literal False). LLVM
would then drop a part that it may drop (`internal`, `linkonce_odr`), and a caller that is linked
later would miss it. LLVM's MCJIT does not report a missing function: it leaves the addresses of all
outer functions zero, and the entry ends with a segmentation fault at its first call.

The passes are those of numba, as described in its documentation ("Customizing the Compiler"). These
names are private to numba, and were checked with its versions from `FIRST` to `LAST`:

- `_linking_libraries` of a library holds the libraries of the functions that it calls, and
  `_final_module` its intermediate code. Numba would link only the functions that an entry itself
  calls.
- `_finalized` of a library tells that there is nothing left to do.

With another version the passes are numba's own. Compilation takes longer, and the results are the
same.

**Store.** The machine code of entries is stored for the next process. Numba finds stored code by
the place and the name of a function, and keeps it until the file of the function changes. The
machine code depends on other files too. It is therefore kept until one of the modules changes that
the module of the function imports. Where numba is of a version that was not checked, the digest of
these modules is a part of the name. Numba sends the event "numba:compile" where it compiles a
function that it does not find (numba's documentation of `numba.core.event`): it is announced.
"""

import hashlib
import os
import re
import sys
import time as clock
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from llvmlite import ir
from numba import njit, typeof, types
from numba.core import cgutils
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.errors import CompilerError, NumbaError
from numba.core.event import Listener, register
from numba.core.imputils import impl_ret_borrowed
from numba.core.typed_passes import NativeLowering
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    overload_method,
    register_jitable,
    register_model,
)

from fenicsrom.files import locked_folder
from fenicsrom.progress import add_compilation, duration

ONCE = "once for this version of the program on this kind of processor"
KERNELS = {
    "contact.law.at_rest": "the contact law",
    "contact.problem.solve_contact": "the contact problem",
    "step.step.march": "the time steps",
    "derivative.period_sensitivity.carry_derivatives": "the derivatives of a period",
}
"""The kernels whose compilation takes seconds, by their names in `fenicsrom.online`."""


class Compilations(Listener):  # type: ignore[misc]
    """Leaves the time of compilations out of `fenicsrom.progress.working_time`.

    Processes that are forked later announce nothing.

    Attributes:
        say: receives a line for each of the `KERNELS` that is compiled.
    """

    def __init__(self) -> None:
        """Announce to nobody."""
        self.say: Callable[[str], None] = lambda line: None
        self._process = os.getpid()
        self._depth, self._began = 0, 0.0
        self._count, self._seconds = 0, 0.0  # kernels compiled so far, and the time of all

    def on_start(self, event: Any) -> None:
        """Announce a kernel, unless it is compiled as a part of another one."""
        self._depth += 1
        if self._depth > 1:
            return
        self._began = clock.perf_counter()
        function = event.data["dispatcher"].py_func
        kernel = f"{function.__module__}.{function.__qualname__}".removeprefix("fenicsrom.online.")
        if kernel in KERNELS and os.getpid() == self._process:
            self._count += 1
            spent = f"{duration(self._seconds)} so far, " if self._count > 1 else ""
            self.say(
                f"compiling kernel {self._count} of at most {len(KERNELS)}, {KERNELS[kernel]}: "
                f"{spent}{ONCE} .."
            )

    def on_end(self, event: Any) -> None:
        """Add the time of a compilation."""
        self._depth -= 1
        if self._depth == 0:
            seconds = clock.perf_counter() - self._began
            self._seconds += seconds
            add_compilation(seconds)


COMPILATIONS = Compilations()
"""Listens as long as this process runs."""


@contextmanager
def announced(say: Callable[[str], None]) -> Iterator[None]:
    """Say which kernels this process compiles in the body."""
    outer, COMPILATIONS.say = COMPILATIONS.say, say
    try:
        yield
    finally:
        COMPILATIONS.say = outer


OWNERS = ("meminfo", "parent")
"""Fields of an array in compiled code that name its owner."""


class TupleReference(types.Type):  # type: ignore[misc]
    """The type of a pointer to a named tuple, whose arrays have no owner."""

    def __init__(self, value: Any):
        """A reference to a tuple of this type."""
        self.value = value
        super().__init__(f"reference({value})")

    @property
    def instance_class(self) -> Any:
        """The class of the named tuple."""
        return self.value.instance_class


def _holds_arrays(kind: Any) -> bool:
    """Whether a value of this type is an array, or a tuple with an array in it."""
    if isinstance(kind, types.BaseTuple):
        return any(map(_holds_arrays, kind))
    return isinstance(kind, types.Array)


def referenced(kind: Any) -> Any:
    """The type by which compiled code holds a value of this type."""
    refers = isinstance(kind, types.BaseNamedTuple) and _holds_arrays(kind)
    return TupleReference(kind) if refers else kind


@register_model(TupleReference)
class _Pointer(models.PrimitiveModel):  # type: ignore[misc]
    """The pointer in memory."""

    def __init__(self, manager: Any, kind: Any):
        super().__init__(manager, kind, manager[kind.value].get_value_type().as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    """The types of the fields of a reference."""

    key = TupleReference

    def generic_resolve(self, reference: Any, name: str) -> Any:
        """The type of a field; None if the tuple has no such field."""
        fields = reference.value.fields
        return referenced(reference.value[fields.index(name)]) if name in fields else None


@lower_getattr_generic(TupleReference)
def _field(context, builder, kind, pointer, name):  # type: ignore[no-untyped-def]
    """A field: the place of a named tuple, or a value loaded from its place."""
    number = kind.value.fields.index(name)
    field, place = kind.value[number], cgutils.gep_inbounds(builder, pointer, 0, number)
    if isinstance(referenced(field), TupleReference):
        return place
    return _load(context, builder, field, place)


def _load(context: Any, builder: Any, kind: Any, place: Any) -> Any:
    """Load a value from its place, number by number; the owner of an array is nobody."""
    if not isinstance(kind, types.Array | types.BaseTuple):
        return _load_number(builder, place)
    if isinstance(kind, types.BaseTuple):
        members = [
            _load(context, builder, member, cgutils.gep_inbounds(builder, place, 0, number))
            for number, member in enumerate(kind)
        ]
        return context.make_tuple(builder, kind, members)
    array = context.make_array(kind)(context, builder)
    for number, name in enumerate(context.data_model_manager[kind]._fields):
        part = cgutils.gep_inbounds(builder, place, 0, number)
        if name in OWNERS:
            value = cgutils.get_null_value(part.type.pointee)
        elif name in ("shape", "strides"):
            sizes = [cgutils.gep_inbounds(builder, part, 0, axis) for axis in range(kind.ndim)]
            value = cgutils.pack_array(builder, [_load_number(builder, size) for size in sizes])
        else:
            value = _load_number(builder, part)
        setattr(array, name, value)
    return array._getvalue()


def _load_number(builder: Any, place: Any) -> Any:
    """Load a number, or a pointer, from memory that nothing writes to."""
    loaded = builder.load(place)
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


def _store(builder: Any, value: Any, place: Any) -> None:
    """Store a value, number by number, as LLVM is slow on stores of whole tuples."""
    if not isinstance(value.type, ir.Aggregate):
        builder.store(value, place)
        return
    for number in range(len(value.type)):
        member = builder.extract_value(value, number)
        _store(builder, member, cgutils.gep_inbounds(builder, place, 0, number))


def _refer(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """A value as compiled code holds it: a named tuple in the memory of the calling function.

    The empty assembly hides from the optimiser that this memory was written to. The loads that are
    marked as invariant might otherwise be moved before it.
    """
    if not isinstance(referenced(kind), TupleReference):
        return value
    place = cgutils.alloca_once(builder, value.type)
    _store(builder, value, place)
    kind = ir.FunctionType(place.type, [place.type])
    hidden = ir.InlineAsm(kind, "", "=r,0,~{memory}", side_effect=True)
    return builder.call(hidden, [place])


@intrinsic
def borrow(typing_context, values):  # type: ignore[no-untyped-def]
    """The members of a tuple; of each named tuple a reference, valid until the caller returns."""
    kind = types.Tuple([referenced(member) for member in values])

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        members = [
            _refer(context, builder, member, builder.extract_value(arguments[0], number))
            for number, member in enumerate(values)
        ]
        return impl_ret_borrowed(context, builder, kind, context.make_tuple(builder, kind, members))

    return kind(values), code


FIRST, LAST = (0, 61), (0, 68)  # versions of numba that were checked


def is_checked(version: str) -> bool:
    """Whether the private names were checked with this version of numba."""
    found = re.match(r"(\d+)\.(\d+)", version)
    return found is not None and FIRST <= (int(found[1]), int(found[2])) <= LAST


def below(library: Any) -> list[Any]:
    """The libraries of all functions that a function calls, directly or through others."""
    found: dict[Any, None] = {}
    queue = list(library._linking_libraries)
    while queue:
        one = queue.pop()
        if one not in found:
            found[one] = None
            queue += one._linking_libraries
    return list(found)


class _Lowering(NativeLowering):  # type: ignore[misc]
    """Translates a function to intermediate code, without machine code."""

    def run_pass(self, state: Any) -> bool:
        """Translate, and let compiled code call the function."""
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state["cr"]
        function = self.executable(state, lowered)
        state.targetctx.insert_user_function(function, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=function)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(_Lowering):
    """Translates a part."""

    _name = "part_lowering"

    def executable(self, state: Any, lowered: Any) -> Any:
        """What stands for the machine code: any builtin function that is no other part's."""
        state.library._finalized = True
        return [lowered].copy


@register_pass(mutates_CFG=True, analysis_only=False)
class EntryLowering(_Lowering):
    """Translates an entry, and makes the machine code of all."""

    _name = "entry_lowering"

    def executable(self, state: Any, lowered: Any) -> Any:
        """The machine code."""
        library = state.library
        module = library._final_module
        own = {function.name for function in module.functions if not function.is_declaration}
        for one in below(library):
            module.link_in(one._final_module, preserve=True)
        library._linking_libraries.clear()
        for function in module.functions:
            if not function.is_declaration and function.name not in own:
                function.linkage = "internal"
            elif function.is_declaration and function.name.startswith("_ZN"):  # MCJIT is silent
                raise CompilerError(f"{function.name} was not linked")
        return state.targetctx.get_executable(library, lowered.fndesc, lowered.env)


class PartCompiler(CompilerBase):  # type: ignore[misc]
    """The passes for a part."""

    lowering: Any = PartLowering

    def define_pipelines(self) -> list[Any]:
        """Numba's passes, with a translation of our own."""
        passes = PassManager(self.lowering.name())
        for one, text in DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            passes.add_pass(self.lowering if one is NativeLowering else one, text)
        passes.finalize()
        return [passes]


class EntryCompiler(PartCompiler):
    """The passes for an entry."""

    lowering = EntryLowering


IS_CHECKED = is_checked(numba.__version__)
PART: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a function that only compiled code calls."""
ENTRY: dict[str, Any] = {"no_cfunc_wrapper": True}
"""Options of a function that only Python calls."""
if IS_CHECKED:
    PART["pipeline_class"], ENTRY["pipeline_class"] = PartCompiler, EntryCompiler


PACKAGE = "fenicsrom.online"
TYPES = ("fenicsrom.online.model.model", "fenicsrom.online.step.state")
"""Modules of the named tuples that kernels receive but do not import."""
KERNEL = {**PART, "_nrt": False}
"""Options of a part that makes no arrays, so that it need not count references to arrays."""
SHORT = {**KERNEL, "forceinline": True}
"""Options of a part of a few lines, which is always inlined."""
REORDERED = {**KERNEL, "fastmath": {"reassoc", "nsz", "contract"}}
"""Options of a part whose sums may take several numbers at a time."""

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
        self.entry.compile = _by_one_process(self.entry)
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


def _by_one_process(entry: Any) -> Callable[[Any], Any]:
    """The method `compile` of an entry for one process at a time: others load what it stored."""
    compile_it, folder = entry.compile, Path(entry.stats.cache_path)

    def compile_alone(signature: Any) -> Any:
        folder.mkdir(parents=True, exist_ok=True)
        with locked_folder(folder, wait=True):
            return compile_it(signature)

    return compile_alone


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


def reordered(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays, and whose sums may be added in another order."""
    return _with(REORDERED, function)


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
