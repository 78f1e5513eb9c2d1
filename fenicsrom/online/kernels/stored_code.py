"""Loading of stored machine code without what only compilation needs.

With each stored function, numba parses the function's intermediate code, fills the tables of its
compiler, and imports all of `scipy.linalg` at the first call of BLAS or LAPACK. Here the first two
wait until numba compiles a function, and only the two modules with the addresses of the routines
are imported. Files of stored functions end with a checksum, and a damaged one counts as missing.
Beside `online.kernels.compiled`, this is the only module that uses private interfaces of numba;
another version than those that were checked loads as numba does.
"""

from __future__ import annotations

import pickle
import sys
import zlib
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import scipy
from numba.core.caching import Cache, CompileResultCacheImpl, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from fenicsrom.online.kernels.emission import IS_CHECKED

ROUTINES = ("scipy.linalg.cython_blas", "scipy.linalg.cython_lapack")
"""Modules with the addresses of the routines of BLAS and LAPACK that compiled code calls."""

MARK = b"\nchecksum "
"""What stands before the checksum of eight digits at the end of a file; unpickling ignores both."""


class StoredLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The machine code of a stored function, with its intermediate code as it was stored."""

    _bitcode: bytes
    _shared_module: Any

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, tuple[bytes, bytes]]) -> Any:
        """The library of a stored state."""
        name, _, (machine_code, bitcode) = state
        self = cls(codegen, name)
        self._bitcode = bitcode
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._finalize_final_module()
        return self

    def _get_module_for_linking(self) -> Any:
        """The intermediate code, for a function that is compiled now and calls this one."""
        if self._shared_module is None:
            self._shared_module = llvm.parse_bitcode(self._bitcode)
        return self._shared_module


def _rebuild(self: Any, target: Any, payload: tuple[Any, ...]) -> Any:
    """Make a stored function callable; for `CompileResultCacheImpl.rebuild`.

    The names are those that numba looks up: the function with its two wrappers, and the
    environments of the functions inside.
    """
    _, function, *_, environments = payload
    codegen = target.codegen()
    codegen._engine._defined_symbols |= {
        function.llvm_func_name,
        function.llvm_cpython_wrapper_name,
        function.llvm_cfunc_wrapper_name,
        function.env_name,
        *(environment.env_name for environment in environments),
    }
    codegen._library_class = StoredLibrary  # for this call, which holds the lock of the compiler
    try:
        return CompileResult._rebuild(target, *payload)
    finally:
        del codegen._library_class


def _load_overload(self: Any, signature: Any, target: Any) -> Any:
    """Load a stored function; None if there is none, or a damaged one; for `Cache.load_overload`.

    A function that is not loaded is compiled, and stored in place of a damaged one.
    """
    rtsys.initialize(target)  # the tables of the compiler are filled before it compiles
    with self._guard_against_spurious_io_errors():
        try:
            return self._load_overload(signature, target)
        except Exception:  # damaged bytes let unpickling raise almost any error
            _drop_damaged_index(self._cache_file)
            return None


def _dump(self: Any, content: Any) -> bytes:
    """The bytes of a file, with their checksum; for `IndexDataCacheFile._dump`."""
    data: bytes = dumps(content)
    return data + MARK + b"%08x" % zlib.crc32(data)


def _load_data(self: Any, name: str) -> Any:
    """The content of a file; for `IndexDataCacheFile._load_data`.

    A file without a checksum was written before `load_code_only` was called.

    Raises:
        ValueError: the file is damaged.
        OSError: there is no file.
    """
    data = Path(self._data_path(name)).read_bytes()
    content, end = data[: -len(MARK) - 8], data[-len(MARK) - 8 :]
    if end.startswith(MARK) and zlib.crc32(content) != int(end[len(MARK) :], 16):
        raise ValueError(f"{name} is damaged")
    return pickle.loads(data)


def _drop_damaged_index(stored: Any) -> None:
    """Empty the index of the stored signatures of a function if it cannot be read."""
    try:
        stored._load_index()
    except Exception:  # as above
        stored.flush()


@cache
def load_code_only() -> None:
    """Let this process load stored functions in this way from now on."""
    if not IS_CHECKED:
        return
    CompileResultCacheImpl.rebuild = _rebuild
    Cache.load_overload = _load_overload
    IndexDataCacheFile._dump = _dump
    IndexDataCacheFile._load_data = _load_data
    for name in ROUTINES:
        _import_alone(name)


def _import_alone(name: str) -> None:
    """Import a module without the package that holds it, whose other modules are slow to import."""
    places = [f"{path}/{name.split('.')[1]}" for path in scipy.__path__]
    spec = PathFinder.find_spec(name, places)
    if name in sys.modules or spec is None or spec.loader is None:
        return
    sys.modules[name] = module = module_from_spec(spec)
    spec.loader.exec_module(module)
