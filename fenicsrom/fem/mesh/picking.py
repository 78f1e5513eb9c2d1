"""Facets that a box or a plane picks."""

from collections.abc import Callable

import numpy as np

from fenicsrom.formats.mesh_file import Floats, Marks
from fenicsrom.scene import Region

ON_PLANE = 1e-6
"""Default tolerance of a picking plane, relative to the extent of the mesh."""

ROUNDING = 1e-9
"""Smaller distances, relative to the extent of the mesh, count as zero."""


def picking(region: Region, extent: float) -> tuple[Callable[[Floats], Marks], str]:
    """How a box or a plane picks facets: all their corners lie in it.

    Args:
        region: the box or the plane.
        extent: that of the mesh, m.

    Returns:
        A function that tells which places (d or more, n) lie there, and the region in words.
    """
    if region.box is not None:
        low, high = np.array(region.box)[:, :, None]
        margin = ROUNDING * extent

        def in_box(x: Floats) -> Marks:
            x = x[: len(low)]
            return np.asarray(np.all((x >= low - margin) & (x <= high + margin), axis=0))

        return in_box, f"box = {np.array(region.box).tolist()}"
    assert region.plane is not None
    point, normal = np.array(region.plane.point), np.array(region.plane.normal)
    tolerance = region.plane.tolerance or ON_PLANE * extent

    def on_plane(x: Floats) -> Marks:
        return np.asarray(np.abs(normal @ (x[: len(point)] - point[:, None])) <= tolerance)

    return on_plane, (
        f"plane = {{ point = {point.tolist()}, normal = {normal.tolist()}, "
        f"tolerance = {tolerance:.3g} }}"
    )
