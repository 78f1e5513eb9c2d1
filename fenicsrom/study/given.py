"""What a computation starts from: a scene or its file, or a stored model."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

from fenicsrom.scene import Scene, read_scene

F = TypeVar("F", bound=Callable[..., Any])


def starts_from(*more: str) -> Callable[[F], F]:
    """Let the first argument of a function be a scene, the path of its file, or of another type.

    Args:
        more: names of the other types; a name needs no import.
    """

    def decorate(function: F) -> F:
        @wraps(function)
        def called(given: Any, *args: Any, **named: Any) -> Any:
            if isinstance(given, str | Path):
                given = read_scene(given)
            if not isinstance(given, Scene) and type(given).__name__ not in more:
                allowed = " or ".join(["a Scene, the path of its file", *map("a {}".format, more)])
                raise TypeError(f"{function.__name__}: {type(given).__name__}: must be {allowed}")
            return function(given, *args, **named)

        return cast(F, called)

    return decorate
