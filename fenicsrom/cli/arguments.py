"""The arguments of the command line, and the record of a command."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fenicsrom.errors import ErrorKind, SceneError


class Argument:
    """An argument of a command, as `ArgumentParser.add_argument` takes it."""

    def __init__(self, *names: str, **settings: Any):
        """Store the names and the settings."""
        self.names = names
        self.settings = settings


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        name: name of the command.
        help: one line for the list of commands.
        run: function that runs the command and returns the exit code.
        arguments: arguments of the command.
    """

    name: str
    help: str
    run: Callable[[argparse.Namespace], int]
    arguments: tuple[Argument, ...]


def command(
    help: str, *arguments: Argument, name: str = ""
) -> Callable[[Callable[[argparse.Namespace], int]], Command]:
    """Decorate the function of a command, whose name is that of the command by default."""
    return lambda run: Command(name or run.__name__, help, run, arguments)


def repeated(name: str, dest: str, metavar: str, help: str) -> Argument:
    """Make an option that may be given several times."""
    settings: dict[str, Any] = {"action": "append", "default": [], "dest": dest, "metavar": metavar}
    return Argument(name, help=f"{help}; may be repeated", **settings)


def scene_file(content: str = "", **settings: Any) -> Argument:
    """Make the argument of the scene file; `content` says what the command reads in it."""
    return Argument("scene", help=f"scene file (TOML){content}", **settings)


def refused(option: str, value: object, reason: str, kind: ErrorKind) -> SceneError:
    """Make the error that refuses the value of an option."""
    return SceneError(f"{option} {value}: {reason}", kind=kind, key=option, source=str(value))


def _model_file(given: str) -> Path:
    """The file of a reduced model; a folder means the model that a run has written there."""
    from fenicsrom.post.base.origin import MODEL

    path = Path(given)
    return path / MODEL if path.is_dir() else path


FROM = Argument(
    "--from",
    dest="stored",
    metavar="MODEL",
    type=_model_file,
    help="use the reduced_model.npz, or the folder, of an earlier run, without a mesh and dolfinx",
)
SET = repeated(
    "--set",
    "overrides",
    "KEY=VALUE",
    help="change a value of the scene, such as loads.0.force=200; put text in quotes",
)
OUTPUT = Argument(
    "--output",
    metavar="DIR",
    help="output folder (default: out/NAME of the scene for run, out/NAME_COMMAND for others)",
)
FORCE = Argument(
    "--force", action="store_true", help="replace the results of another run in the output folder"
)
SCENE = scene_file()
MESH = Argument("mesh", help="mesh or geometry file")
SCALE = Argument("--scale", metavar="NUMBER", help="unit of the coordinates in m, such as 1e-3")
SIZE = Argument("--size", metavar="NUMBER", help="cell size in m, for a .step file")
FILE = Argument("--output", metavar="FILE", help="file to write")
