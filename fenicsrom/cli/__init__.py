"""The command line: the commands of the table in `parser`.

Exit codes: 0 success, 1 numerical failure, 2 wrong input, 130 interrupted, 143 terminated.

Modules that need numpy, numba or dolfinx are imported by the command that uses them.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence

from fenicsrom.cli.parser import make_parser
from fenicsrom.cli.ranks import abort_all, is_idle, refuse, stopped
from fenicsrom.cli.termination import is_terminated, terminable
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    options = make_parser().parse_args(arguments)
    try:
        _check_arguments(options)
        if getattr(options, "stored", None) and is_idle():
            return 0
        with terminable():
            return int(options.command(options))
    except SceneError as error:
        return refuse(str(error), 2)
    except (ConvergenceError, AccuracyError) as error:
        return refuse(str(error), 1)
    except OSError as error:
        return refuse(f"{error.filename or 'output'}: {error.strerror or error}", 1)
    except ModuleNotFoundError as error:
        return refuse(
            f"this command needs the Python module {error.name}, which is not installed; "
            "a stored model runs without dolfinx: fenicsrom run --from reduced_model.npz",
            1,
        )
    except KeyboardInterrupt:
        if is_terminated():
            return stopped("terminated", 143)
        return stopped("interrupted", 130)
    except Exception:  # a defect of the program
        abort_all()
        raise


def _check_arguments(options: Namespace) -> None:
    """Check that no argument contains a NUL character, which no path can contain.

    Raises:
        SceneError: an argument contains one.
    """
    for name, value in vars(options).items():
        if isinstance(value, str) and "\0" in value:
            raise SceneError(
                f"argument {name} = {value}: must not contain a NUL character",
                kind=ErrorKind.FILE,
                key=name,
            )
