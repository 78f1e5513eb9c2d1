"""The versions of the programs that make a result."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution


def provenance(
    modules: Sequence[str] = ("numpy", "numba", "fenics-dolfinx", "petsc4py", "slepc4py"),
) -> dict[str, str]:
    """Versions of this program and of the installed libraries that it uses."""
    found = {}
    for name in ("fenicsrom", *modules):
        try:
            found[name] = _version(name)
        except PackageNotFoundError:
            continue
    return found


def _version(module: str) -> str:
    """The version of an installed module. `importlib.metadata.version` starts slowly.

    Raises:
        PackageNotFoundError: the module is not installed.
    """
    found = distribution(module)
    text = found.read_text("METADATA") or found.read_text("PKG-INFO") or ""
    stated = re.search(r"^Version: *(\S+)", text, re.MULTILINE)
    return stated[1] if stated else found.version
