"""The command line. `commands` holds the table of commands.

Exit codes: 0 success, 1 numerical failure, 2 wrong input, 130 interrupted, 143 terminated.

Modules that need numpy, numba or dolfinx are imported by the command that uses them. `main` imports
the commands, so that an interrupt during these imports ends with a sentence too.
"""

import argparse
import gc
import sys
from collections.abc import Sequence

from fenicsrom.cli.ranks import abort_all, is_idle, refuse, stopped
from fenicsrom.cli.termination import is_terminated, terminable
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError

GARBAGE = 20_000
"""Objects after which Python looks for garbage: imports make many, and none of them is garbage."""

OF_MESHES = "dolfinx basix ufl ffcx mpi4py petsc4py slepc4py gmsh meshio".split()
"""Modules that only a command with a mesh imports."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    gc.set_threshold(GARBAGE)
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = argparse.Namespace(arguments=words)
    try:
        with terminable():
            from fenicsrom.cli.commands import make_parser
            from fenicsrom.cli.starting import SHARED

            options = make_parser().parse_args(words, options)
            alone = options.name not in SHARED
            if getattr(options, "stored", None) and alone and is_idle():
                return 0
            return int(options.command(options))
    except SceneError as error:
        return refuse(str(error), 2)
    except (ConvergenceError, AccuracyError) as error:
        return refuse(str(error), 1)
    except OSError as error:
        return refuse(f"{error.filename or 'output'}: {error.strerror or error}", 1)
    except ModuleNotFoundError as error:
        return refuse(_missing(str(error.name)), 2)
    except KeyboardInterrupt:
        how = getattr(options, "continuation", "")
        word, code = ("terminated", 143) if is_terminated() else ("interrupted", 130)
        return stopped(f"{word}; {how}" if how else word, code)
    except Exception:  # a defect of the program
        abort_all()
        raise


def _missing(module: str) -> str:
    """What a command needs that cannot import a module of Python."""
    if module.partition(".")[0] not in OF_MESHES:
        return f"this command needs the Python module {module}, which is not installed"
    return (
        f"this command needs dolfinx, gmsh and meshio, but the Python module {module} is not "
        "installed; a stored model runs without them: fenicsrom run --from reduced_model.npz"
    )
