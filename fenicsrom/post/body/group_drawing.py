"""The picture of a mesh with its groups coloured."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.base.plot import Bars, Plot
from fenicsrom.post.base.style import COLOURS
from fenicsrom.post.body.body_view import END_ON, frame_of, is_flat, is_seen, view_of
from fenicsrom.post.body.rendering import GREY, Part, body_panel, image_of, names_at, painted
from fenicsrom.post.body.turning_view import named_page

MORE_COLOURS = (*COLOURS[:-1], "#8C510A", "#542788", "#7FBC41", "#B2182B", "#35978F", "#F1B6DA")
"""Colours of the groups."""

MOST_LINES = 30000
"""Largest number of facets whose edges are drawn; those of more facets hide the colours."""

Ints = NDArray[np.int64]


def group_figure(points: Array, boundary: Ints, groups: Mapping[str, Ints]) -> Plot:
    """Draw a mesh, and its groups in the colours of the legend, with their names on the facets.

    A body in space is seen from in front and from behind. Groups after the last colour are grey.

    Args:
        points: (n, 3) corners, m.
        boundary: corners of the facets (in the plane: of the cells) of the body (k, corners).
        groups: name -> corners of facets (k, corners), or nodes (k,).
    """
    from pyvista import PolyData

    parts = list(_parts(points, boundary, groups).values())
    surface = PolyData.from_regular_faces(points, boundary).triangulate().clean()
    names = {}
    for name, members in groups.items():
        if members.ndim == 2 and members.shape[1] > 2:
            centres = points[members].mean(axis=1)
            away = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
            names[name] = centres[np.argmin(away)]
    view = view_of(surface, oblique=END_ON)
    views = [view, replace(view, right=-view.right, towards=-view.towards)]
    views = views[:1] if is_flat(points) else views
    coloured = [*zip(groups, MORE_COLOURS, strict=False)]
    wide, panels = 9.0 / max(1.5, len(views)), []
    for seen in views:
        frame = frame_of(seen, [surface.points])
        shown = [(n, p) for n, p in names.items() if is_seen(surface, p, seen)]
        texts = names_at(((n, seen.project(p), "black") for n, p in shown), frame, wide)
        panels.append(body_panel([image_of(parts, frame, wide), *texts]))
    samples = [Bars(color=color, label=name) for name, color in coloured]
    return Plot(panels, wide * len(views), 0.0, len(views), legend=samples)


def group_page(points: Array, boundary: Ints, groups: Mapping[str, Ints]) -> str:
    """A page that turns the body, and names the groups of the facet under the pointer.

    Arguments as for `group_figure`.
    """
    from pyvista import PolyData

    body = PolyData.from_regular_faces(points, boundary).triangulate().clean()
    parts = _parts(points, boundary, groups).items()
    faces = {name: part for name, part in parts if part.mesh.n_faces}
    return named_page(faces, view_of(body, oblique=END_ON))


def _parts(points: Array, boundary: Ints, groups: Mapping[str, Ints]) -> dict[str, Part]:
    """The facets by the names of their groups, in the colour of the smallest, and other groups.

    A group of nodes has the facets all of whose corners it contains. Arguments as for
    `group_figure`.
    """
    from pyvista import PolyData

    colours = dict(zip(groups, MORE_COLOURS, strict=False))
    names = np.full(len(boundary), "", dtype=object)
    paint = np.full(len(boundary), GREY, dtype=object)
    for name in sorted(groups, key=lambda name: -len(groups[name])):
        inside = members_of(boundary, groups[name])
        names[inside] += np.where(names[inside] != "", ", ", "") + name
        paint[inside] = colours.get(name, GREY)
    lines: dict[str, Any] = {"show_edges": len(boundary) <= MOST_LINES, "edge_color": "#5B636B"}
    parts = {}
    for name in dict.fromkeys(names):
        own = names == name
        mesh = PolyData.from_regular_faces(points, boundary[own]).clean()
        parts[name or "no group"] = painted(mesh, paint[own][0], **lines)
    for name, members in groups.items():
        if members.ndim == 1:
            mesh = PolyData(points[members])
        elif members.shape[1] == 2:
            mesh = PolyData(points, lines=np.insert(members, 0, 2, axis=1).ravel()).clean()
        else:
            continue
        colour = colours.get(name, GREY)
        parts[f"{name}, nodes"] = painted(mesh, colour, True, line_width=6.0, point_size=12.0)
    return parts


def members_of(boundary: Ints, members: Ints) -> NDArray[np.bool_]:
    """Which facets (k, corners) of the boundary are in a group of facets, or of nodes (m,)."""
    if members.ndim == 1 or members.shape[1] != boundary.shape[1]:
        return np.asarray(np.isin(boundary, members).all(axis=1) & (members.ndim == 1))
    rows = np.sort(np.concatenate([boundary, members]), axis=1)
    numbers = np.unique(rows, axis=0, return_inverse=True)[1].ravel()
    return np.isin(numbers[: len(boundary)], numbers[len(boundary) :])
