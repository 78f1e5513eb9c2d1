"""A solid with known results, which is built only when more than these is needed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fenicsrom.arrays import Array
    from fenicsrom.fem.solid.solid import Solid


class LateSolid:
    """Stands for a solid; an attribute that is not known builds the solid."""

    warnings: list[str]

    def __init__(self, build: Callable[[], Solid], **known: Any):
        """Keep the function that builds the solid, and attributes with their values."""
        self._build = build
        self._solid: Solid | None = None
        self.__dict__ |= known

    def __getattr__(self, name: str) -> Any:
        """Give an attribute of the solid, which is built at the first call."""
        if self._solid is None:
            solid = self._build()
            solid.warnings = self.warnings  # they hold those of the mesh already
            self._solid = solid
        return getattr(self._solid, name)


class LateInverse:
    """K⁻¹ of a solid that may not be built yet."""

    def __init__(self, solid: LateSolid):
        """Store the solid."""
        self._solid = solid

    def solve(self, block: Array) -> Array:
        """K⁻¹ times the columns of a block (local, k)."""
        found: Array = self._solid.factor.solve(block)
        return found
