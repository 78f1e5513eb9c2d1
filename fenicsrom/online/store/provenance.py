"""The versions of the programs that make a result."""

from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version


def provenance(
    modules: Sequence[str] = ("numpy", "numba", "fenics-dolfinx", "petsc4py", "slepc4py"),
) -> dict[str, str]:
    """Versions of this program and of the installed libraries that it uses."""
    found = {}
    for name in ("fenicsrom", *modules):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
