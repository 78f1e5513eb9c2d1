"""The drawing process of a mesh with coloured groups: pyvista renders, matplotlib adds names."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.drawing import Camera, cropped
from fenicsrom.post.style import COLOURS, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BODY = "#D9DDE1"
"""Colour of the facets that are in no group."""

MORE_COLOURS = (*COLOURS[:-1], "#8C510A", "#542788", "#7FBC41", "#B2182B", "#35978F", "#F1B6DA")
"""Colours of the groups."""


def draw_groups() -> None:
    """Draw a mesh as one PNG; the task is on the command line."""
    import pyvista

    task = json.loads(sys.argv[1])
    arrays = np.load(task["source"])
    points = arrays["points"]
    body = surface(points, arrays["boundary"])
    camera = Camera(body)
    # seen through, so that groups behind the body and inside it show as well
    camera.plotter.add_mesh(
        body, color=BODY, opacity=0.45, show_edges=True, edge_color="#7d848a", lighting=False
    )
    marks = [name for name in arrays.files if name.startswith(("facets_", "nodes_"))]
    for name in marks:
        number = int(name.rpartition("_")[2])
        colour = MORE_COLOURS[number]
        # the groups are sorted by their size: a small one lies in front of a large one
        front = 1e-3 * (1 + len(marks) - number) * camera.length * camera.towards
        if name.startswith("facets_"):
            shown = surface(points + front, arrays[name])
            camera.plotter.add_mesh(
                shown, color=colour, show_edges=True, line_width=3, ambient=0.6, diffuse=0.5
            )
        else:
            camera.plotter.add_points(
                pyvista.PolyData(points[arrays[name]] + front),
                color=colour,
                point_size=14,
                render_points_as_spheres=True,
            )
    image = camera.photograph()
    camera.plotter.close()
    group_figure(task["labels"], cropped([image])[0]).savefig(task["picture"])


def surface(points: Array, facets: NDArray[np.int64]) -> Any:
    """Lines, triangles or quadrilaterals (k, corners) as a pyvista surface."""
    import pyvista

    rows = np.column_stack([np.full(len(facets), facets.shape[1]), facets]).ravel()
    if facets.shape[1] == 2:
        return pyvista.PolyData(points, lines=rows)
    return pyvista.PolyData(points, faces=rows)


@styled
def group_figure(labels: Sequence[str], image: NDArray[np.uint8]) -> Figure:
    """Add the names of the groups in their colours to a picture (height, width, 3)."""
    from matplotlib.patches import Patch

    height, width = image.shape[:2]
    columns = min(6, max(1, len(labels)))
    wide = 8.0
    rows = -(-len(labels) // columns)
    figure = new_figure(wide, min(wide * height / width, 8.0) + 0.3 + 0.3 * rows)
    axis = figure.subplots()
    axis.set_axis_off()
    axis.imshow(image, interpolation="antialiased")
    handles = [
        Patch(color=colour, label=label)
        for label, colour in zip(labels, MORE_COLOURS, strict=False)
    ]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=columns)
    return figure
