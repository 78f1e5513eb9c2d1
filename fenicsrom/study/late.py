"""An object with known attributes, which is made only when more than these is needed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Late:
    """Stands for an object, such as a solid; an attribute that is not known makes the object."""

    def __init__(self, make: Callable[[], Any], **known: Any):
        """Keep the function that makes the object, and attributes with their values."""
        self._make = make
        self._made: Any = None
        self.__dict__ |= known

    def __getattr__(self, name: str) -> Any:
        """Give an attribute of the object, which is made at the first call."""
        if self._made is None:
            self._made = self._make()
        return getattr(self._made, name)
