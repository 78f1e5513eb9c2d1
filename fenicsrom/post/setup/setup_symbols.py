"""The symbols of supports, loads, attachments, contacts and the probe in space.

Each symbol has a form and a colour of its own, so that readers who cannot tell the colours apart
see the form.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.body.body_surface import NODE, faces_on
from fenicsrom.post.body.body_view import View
from fenicsrom.post.body.rendering import GREY, Part, drawn_lines, painted
from fenicsrom.post.setup.setup_marks import (
    CLAMPED,
    AttachmentMark,
    ContactMark,
    LoadMark,
    Marks,
    RotationMark,
    SupportMark,
)

if TYPE_CHECKING:
    from pyvista import PolyData

MARK_COLOURS = {
    "support": "#56585A",
    "load": "#D55E00",
    "attachment": "#882255",
    "contact": "#0072B2",
    "probe": "#009E73",
    "rotation": "#332288",
}

REGION_COLOURS = {"loaded": "#F3C6A5", "clamped": "#56585A", "held": "#9AA1A8"}
"""Colours of the regions of loads, and of supports that hold all or some components."""

REACH = 0.14
"""Length of the arrow of a load, relative to the size of the body."""

APART = 0.045
"""Smallest distance of two cones of a support, relative to the size of the body."""

MOST_CONES = 7
"""Points of a support at which its held directions are drawn."""

SAME_WAY = 0.9
"""Cosine of the angle from which two arrows have the same direction."""

NEAR = 0.5
"""Distance from a contact up to which its round wall is drawn, relative to the size of the body."""

CONTACT_FORMS = ("o", "s", "D", "^")
"""Markers of the points of the contacts in the legend: sphere, cube, octahedron and cone."""

AXIS_LINE: Any = (0, (8, 2, 1.5, 2))
"""The line style of the axis of rotation in the legend."""

ARROW = r"$\rightarrow$"
"""The marker of an arrow in the legend."""


class Arrow(NamedTuple):
    """The arrow of a load.

    Attributes:
        number: number of its load.
        start, end: (3,) m.
    """

    number: int
    start: Array
    end: Array


def load_arrows(loads: Sequence[LoadMark], reach: float) -> list[Arrow]:
    """Place the arrows of loads; those of one place and direction stand behind one another.

    A concentrated load stays at its place, if there is one.
    """
    every = [(number, place) for number, load in enumerate(loads) for place in load.places]
    every.sort(key=lambda item: bool(loads[item[0]].on.any()))
    arrows: list[Arrow] = []
    for number, place in every:
        step = reach * loads[number].direction
        while any(_coincide(place, step, other) for other in arrows):
            place = place - 1.1 * step
        arrows.append(Arrow(number, place - step, place))
    return sorted(arrows, key=lambda arrow: arrow.number)


def _coincide(place: Array, step: Array, other: Arrow) -> bool:
    """Whether two arrows would lie on one another."""
    same = step @ (other.end - other.start) >= SAME_WAY * (step @ step)
    return bool(same and np.linalg.norm(place - other.end) < 0.5 * np.linalg.norm(step))


def region_parts(surface: PolyData, edges: PolyData, marks: Marks) -> list[Part]:
    """The body with its regions in their colours.

    Edges and nodes that a support holds alone are thick, and so are all regions of a plane body.
    """
    from pyvista import PolyData

    held = sorted(marks.supports, key=lambda mark: mark.label == CLAMPED)
    regions = [(REGION_COLOURS["loaded"], load.on, False) for load in marks.loads]
    for mark in held:
        colour = REGION_COLOURS["clamped" if mark.label == CLAMPED else "held"]
        regions.append((colour, mark.on, True))
    flat = not np.ptp(surface.points[:, 2])
    number = np.full(surface.n_cells, -1)
    parts = []
    for k, (colour, on, support) in enumerate(regions):
        mine = on[surface.point_data[NODE]]
        on_edge = on[edges.point_data[NODE]]
        faces = faces_on(surface, mine)
        if not flat:
            number[faces] = k
        if support or flat:
            pairs = edges.lines.reshape(-1, 3)[:, 1:]
            pairs = pairs[on_edge[pairs].all(axis=1)]
            lines = np.insert(pairs, 0, 2, axis=1).ravel()
            thick = drawn_lines(PolyData(edges.points, lines=lines), colour, 7.0)
            parts.append(thick._replace(symbol=support))
            used = [*surface.regular_faces[faces].ravel()]
            alone = np.setdiff1d(np.flatnonzero(mine), used)
            alone = np.setdiff1d(surface.point_data[NODE][alone], edges.point_data[NODE][pairs])
            places = surface.points[np.isin(surface.point_data[NODE], alone)]
            look = {"color": colour, "point_size": 11.0}
            parts.append(Part(PolyData(places), look, symbol=support))
    for k, colour in enumerate([GREY, *(colour for colour, _, _ in regions)], -1):
        faces = surface.regular_faces[number == k]
        if len(faces):
            parts.append(painted(PolyData.from_regular_faces(surface.points, faces), colour))
    return parts


def symbol_parts(marks: Marks, points: Array, view: View) -> list[Part]:
    """The symbols of a set-up, which show through the body.

    Args:
        marks: what is marked.
        points: (n, 3) points of the whole body, m.
        view: the projection.
    """
    import pyvista

    reach = REACH * view.length
    found: list[tuple[str, PolyData]] = []
    for support in marks.supports:
        found += [("support", cone) for cone in _cones(support, points, view, 0.3 * reach)]
    for _, start, end in load_arrows(marks.loads, reach):
        found.append(("load", _arrow(start, end - start)))
    ways = itertools.cycle([-view.up, view.up, -view.right, view.right])
    for attachment in marks.attachments:
        way = next(ways) if attachment.kind != "mass" else view.up
        found.append(("attachment", _attachment(attachment, 0.6 * reach * way)))
    for form, contact in zip(itertools.cycle(CONTACT_FORMS), marks.contacts, strict=False):
        found += [("contact", mesh) for mesh in _contact(contact, form, reach)]
    if marks.probe is not None:
        look = {"center": marks.probe, "normal": view.towards, "c_res": 40}
        found.append(("probe", pyvista.Disc(inner=0.09 * reach, outer=0.14 * reach, **look)))
    return [Part(mesh, {"color": MARK_COLOURS[kind]}, symbol=True) for kind, mesh in found]


def _arrow(start: Array, way: Array) -> PolyData:
    """An arrow along `way` (3,)."""
    import pyvista

    look = {"scale": "auto", "tip_radius": 0.09, "shaft_radius": 0.028}
    return pyvista.Arrow(start=start, direction=way, **look)


def _cone(tip: Array, way: Array, height: float) -> PolyData:
    """A cone at `tip` (3,) that points along the unit vector `way` (3,)."""
    import pyvista

    size = {"height": height, "radius": 0.35 * height, "resolution": 24}
    return pyvista.Cone(center=tip - 0.5 * height * way, direction=way, **size)


def _cones(mark: SupportMark, points: Array, view: View, height: float) -> list[PolyData]:
    """Cones whose tips hold some points of a support in its directions, outside of the body."""
    nodes = np.flatnonzero(mark.on)
    if not len(nodes) or not len(mark.directions):
        return []
    places = points[nodes]
    chosen, away = [0], np.full(len(nodes), np.inf)
    for _ in range(MOST_CONES - 1):
        away = np.minimum(away, np.linalg.norm(places - places[chosen[-1]], axis=1))
        if away.max() < APART * view.length:
            break
        chosen.append(int(np.argmax(away)))
    found = []
    for direction in mark.directions:
        outward = np.sign((places.mean(axis=0) - points.mean(axis=0)) @ direction) or 1.0
        found += [_cone(place, -outward * direction, height) for place in places[chosen]]
    return found


def _attachment(mark: AttachmentMark, way: Array) -> PolyData:
    """A cube as a mass, and springs and dashpots from their place along `way` (3,) to the ground.

    All hold their place in every direction; `way` is only where there is room.
    """
    import pyvista

    size = float(np.linalg.norm(way))
    if mark.kind == "mass":
        cube = pyvista.Cube(center=mark.place).scale(0.25 * size, point=mark.place)
        return cube.extract_all_edges().tube(radius=0.02 * size)
    turn = np.eye(3)[int(np.argmin(np.abs(way)))]
    across = np.cross(way, turn - (turn @ way) * way / size**2)
    ends = [[0.0, 0.0], [0.15, 0.0], [0.85, 0.0], [1.0, 0.0]]
    if mark.kind == "spring":
        ends[2:2] = [[0.25 + 0.1 * k, 0.15 * (-1) ** k] for k in range(6)]
    line = mark.place + np.array(ends) @ np.array([way, across])
    parts = [pyvista.MultipleLines(points=line).tube(radius=0.025 * size)]
    if mark.kind == "dashpot":
        look = {"center": mark.place + 0.5 * way, "radius": 0.14 * size, "height": 0.4 * size}
        parts.append(pyvista.Cylinder(direction=way, **look))
    look = {"center": mark.place + way, "radius": 0.22 * size, "height": 0.04 * size}
    parts.append(pyvista.Cylinder(direction=way, **look))
    return pyvista.merge(parts).extract_surface(algorithm="dataset_surface")


def _contact(mark: ContactMark, form: str, reach: float) -> list[PolyData]:
    """The points of a contact, and their normals into the wall as thin arrows."""
    import pyvista

    forms = {
        "o": pyvista.Sphere(radius=0.5),
        "s": pyvista.Cube(x_length=0.8, y_length=0.8, z_length=0.8),
        "D": pyvista.PlatonicSolid("octahedron", radius=0.6),
        "^": pyvista.Cone(direction=(0.0, 0.0, 1.0), radius=0.5, resolution=24),
    }
    cloud = pyvista.PolyData(mark.places)
    cloud.point_data["normal"] = mark.normals
    thin = pyvista.Arrow(tip_radius=0.08, shaft_radius=0.02)
    return [
        cloud.glyph(orient=False, scale=False, geom=forms[form], factor=0.11 * reach),
        cloud.glyph(orient="normal", scale=False, geom=thin, factor=0.5 * reach),
    ]


def wall_part(mark: ContactMark, near: float | None = None) -> list[Part]:
    """The round wall of a contact, or the part of it near its points; none of a plane.

    Args:
        mark: the contact.
        near: largest distance from the points that is drawn, m; None draws all.
    """
    import pyvista

    if mark.wall is None:
        return []
    places, cells = mark.wall.points, mark.wall.cells
    if near is not None:
        away = places[cells].mean(axis=1)[:, None] - mark.places
        cells = cells[np.linalg.norm(away, axis=2).min(axis=1) < near]
    if cells.shape[1] == 2:
        lines = pyvista.PolyData(places, lines=np.insert(cells, 0, 2, axis=1).ravel())
        return [drawn_lines(lines, MARK_COLOURS["contact"], 2.0)]
    sheet = pyvista.PolyData.from_regular_faces(places, cells)
    return [painted(sheet, MARK_COLOURS["contact"], opacity=0.35)] if len(cells) else []


def rotation_parts(mark: RotationMark, ends: Array, radius: float, shown: Any) -> list[Part]:
    """The axis of rotation, and an arrow around it in the sense in which the body turns.

    Args:
        mark: the axis.
        ends: (2, 3) its ends, m.
        radius: of the arrow, m.
        shown: function that says which of points (n, 3) lie in the picture; the arrow does.
    """
    import pyvista

    places = ends[0] + np.linspace(0.0, 1.0, 41)[:, None] * (ends[1] - ends[0])
    dashes = np.concatenate([places[k : k + 3] for k in range(0, 40, 4)])
    numbers = np.arange(len(dashes)).reshape(-1, 3)
    line = pyvista.PolyData(dashes, lines=np.insert(numbers, 0, 3, axis=1).ravel())
    found = [line.tube(radius=0.05 * radius)]
    inside = places[shown(places)]
    if len(inside):
        arc = turning_arrow(mark, inside[-1], radius)
        way = (arc[-1] - arc[-2]) / np.linalg.norm(arc[-1] - arc[-2])
        found.append(pyvista.MultipleLines(points=arc).tube(radius=0.08 * radius))
        found.append(_cone(arc[-1] + 0.3 * radius * way, way, 0.6 * radius))
    return [Part(mesh, {"color": MARK_COLOURS["rotation"]}, symbol=True) for mesh in found]


def turning_arrow(rotation: RotationMark, centre: Array, radius: float) -> Array:
    """An arc (n, 3) around the axis, in the sense in which the body turns."""
    first = np.eye(3)[int(np.argmin(np.abs(rotation.axis)))]
    across = np.cross(rotation.axis, first)
    across /= np.linalg.norm(across)
    angle = np.linspace(0.0, 1.6 * np.pi, 33)[:, None]
    upward = np.cross(rotation.axis, across)
    return np.asarray(centre + radius * (np.cos(angle) * across + np.sin(angle) * upward))


_SPRING = [(0.15 + 0.1 * k, 0.0 if k in (0, 7) else 0.15 * (-1) ** k) for k in range(8)]
_FORMS: dict[str, tuple[list[tuple[float, float]], ...]] = {
    "spring": ([(0.0, 0.0), *_SPRING, (1.0, 0.0)], [(1.0, -0.2), (1.0, 0.2)]),
    "dashpot": (
        [(0.0, 0.0), (1.0, 0.0)],
        [(0.3, -0.14), (0.7, -0.14), (0.7, 0.14), (0.3, 0.14), (0.3, -0.14)],
        [(1.0, -0.2), (1.0, 0.2)],
    ),
}
"""Lines of the symbols in the legend."""


def legend_handles(marks: Marks) -> list[Any]:
    """The entries of the legend: each support, load, attachment and contact once."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.path import Path

    def entry(label: str, what: str, form: Any = "o", size: float = 7.0, **look: Any) -> Any:
        look = {"color": MARK_COLOURS[what], "marker": form, "markersize": size} | look
        return Line2D([], [], linestyle="none", label=label, **look)

    hollow = {"markerfacecolor": "none", "markeredgewidth": 2.0}
    handles: list[Any] = []
    for support in marks.supports:
        if support.label == CLAMPED:
            handles.append(Patch(color=MARK_COLOURS["support"], label=f"support, {CLAMPED}"))
        else:
            handles.append(entry(f"support, {support.label}", "support", "<", 9.0))
    several = len(marks.loads) > 1
    for k, load in enumerate(marks.loads):
        label = f"{k + 1}: {load.label}" if several else load.label
        handles.append(entry(label, "load", ARROW, 14.0))
    if any(load.on.any() for load in marks.loads):
        handles.append(Patch(color=REGION_COLOURS["loaded"], label="loaded region"))
    for label, kind in {mark.label: mark.kind for mark in marks.attachments}.items():
        if kind in _FORMS:
            lines = (Path(np.array(line) - [0.5, 0.0]) for line in _FORMS[kind])
            shape = Path.make_compound_path(*lines)
            handles.append(entry(label, "attachment", shape, 24.0, **hollow))
        else:
            handles.append(entry(label, "attachment", "s", 11.0, **hollow))
    for form, contact in zip(itertools.cycle(CONTACT_FORMS), marks.contacts, strict=False):
        handles.append(entry(contact.label, "contact", form))
    if marks.contacts:
        handles.append(entry("normal into the wall", "contact", ARROW, 14.0))
    if any(contact.wall is not None for contact in marks.contacts):
        handles.append(Patch(color=MARK_COLOURS["contact"], alpha=0.3, label="round wall"))
    if marks.rotation is not None:
        label = f"axis of rotation, {marks.rotation.speed_rpm:g} rpm"
        look = {"color": MARK_COLOURS["rotation"], "linestyle": AXIS_LINE}
        handles.append(Line2D([], [], label=label, **look))
    if marks.probe is not None:
        handles.append(entry("probe", "probe", "o", 11.0, **hollow))
    return handles
