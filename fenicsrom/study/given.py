"""What a computation starts from: a scene or its file, or a stored model."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.scene import Scene, read_scene
from fenicsrom.scene.checks.checks import require_no_sector

COMMANDS = {"interaction_map": "map", "integrate": "run"}
"""The commands whose functions have another name."""

F = TypeVar("F", bound=Callable[..., Any])


def starts_from(*more: str, sectors: bool = False) -> Callable[[F], F]:
    """Let the first argument of a function be a scene, the path of its file, or of another type.

    Args:
        more: names of the other types; a name needs no import.
        sectors: whether it takes sectors of disks.
    """

    def decorate(function: F) -> F:
        @wraps(function)
        def called(given: Any, *args: Any, **named: Any) -> Any:
            if isinstance(given, str | Path):
                given = read_scene(given)
            kind, command = type(given).__name__, COMMANDS.get(function.__name__, function.__name__)
            if kind == "StoredDisk" and kind not in more:
                text = f"not allowed in fenicsrom {command} as a stored disk; give its scene"
                raise refuse(given.file or given.scene.source, text, ErrorKind.CONFLICT, "cyclic")
            if not isinstance(given, Scene) and kind not in more:
                allowed = " or ".join(["a Scene, the path of its file", *map("a {}".format, more)])
                raise TypeError(f"{function.__name__}: {kind}: must be {allowed}")
            scene = given if isinstance(given, Scene) else given.scene
            if not sectors:
                require_no_sector(scene, command)
            return function(given, *args, **named)

        return cast(F, called)

    return decorate
