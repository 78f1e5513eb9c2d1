"""Machine code of a function with all functions that it calls, made once.

Numba optimises each compiled function and makes its machine code, and does both again in each of
its callers. Here a function that is called by compiled code only (a part) is translated to LLVM's
intermediate code. An entry, which Python calls, is linked with all parts below it, each once. LLVM
then optimises the whole, and makes its machine code once. The parts are internal to the entry:
their names cannot meet those of the same parts in another entry, or in stored machine code.

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
"""

import re
from typing import Any

import numba
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.errors import CompilerError
from numba.core.typed_passes import NativeLowering

FIRST, LAST = (0, 61), (0, 65)  # versions of numba that were checked


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
