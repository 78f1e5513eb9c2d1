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
from fenicsrom.post.body.body_surface import NODE, faces_on, is_flat
from fenicsrom.post.body.body_view import View
from fenicsrom.post.body.rendering import GREY, Part, drawn_lines, painted
from fenicsrom.post.setup.setup_marks import (
    CLAMPED,
    ContactMark,
    LoadMark,
    Marks,
    RotationMark,
    SupportMark,
)

if TYPE_CHECKING:
    from pyvista import PolyData

COLOURS = {
    "support": "#56585A",
    "load": "#D55E00",
    "attachment": "#882255",
    "contact": "#0072B2",
    "probe": "#009E73",
    "rotation": "#332288",
}

LOADED, HELD = "#F3C6A5", "#9AA1A8"
"""Colours of the regions of loads, and of supports that hold some components."""

REACH = 0.14
"""Length of the arrow of a load, relative to the size of the body."""

APART = 0.045
"""Smallest distance of two cones of a support, relative to the size of the body."""

MOST_CONES = 7
"""Points of a support at which its held directions are drawn."""

SAME_WAY = 0.9
"""Cosine of the angle from which two arrows have the same direction."""

SPARE = 0.15
"""Length of the axis of rotation beyond what it passes, relative to the extent along it."""

CONTACT_FORMS = ("o", "s", "D", "^")
"""Markers of the points of the contacts in the legend: sphere, cube, octahedron and cone."""

ATTACHED_FORMS = {"mass": "s", "spring": "D", "dashpot": "^"}
"""The same of attachments."""

ARROW = r"$\rightarrow$"
"""The marker of an arrow in the legend."""


class Symbol(NamedTuple):
    """What marks one thing in the picture and in the legend.

    Attributes:
        label: its name in the legend.
        kind: a key of `COLOURS`.
        marker: its marker in the legend.
        mesh: its form in space.
    """

    label: str
    kind: str
    marker: str
    mesh: PolyData

    @property
    def part(self) -> Part:
        """The symbol as a part of the picture, which shows through the body."""
        return Part(self.mesh, {"color": COLOURS[self.kind]}, symbol=True)


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
    regions = [(LOADED, load.on, False) for load in marks.loads]
    regions += [(_colour_of(mark), mark.on, True) for mark in held]
    flat, node = is_flat(surface.points), surface.point_data[NODE]
    number = np.full(surface.n_cells, -1)
    parts = []
    for k, (colour, on, support) in enumerate(regions):
        faces = faces_on(surface, on[node])
        number[faces & (not flat)] = k
        if not (support or flat):
            continue
        pairs = edges.lines.reshape(-1, 3)[:, 1:]
        pairs = pairs[on[edges.point_data[NODE][pairs]].all(axis=1)]
        drawn = [*node[surface.regular_faces[faces]].ravel(), *edges.point_data[NODE][pairs].flat]
        alone = surface.points[np.isin(node, np.setdiff1d(np.flatnonzero(on), drawn))]
        lines = PolyData(edges.points, lines=np.insert(pairs, 0, 2, axis=1).ravel())
        look = {"color": colour, "line_width": 7.0, "point_size": 11.0}
        parts += [Part(mesh, look, symbol=support) for mesh in (lines, PolyData(alone))]
    for k, colour in enumerate([GREY, *(colour for colour, _, _ in regions)], -1):
        faces = surface.regular_faces[number == k]
        if len(faces):
            parts.append(painted(PolyData.from_regular_faces(surface.points, faces), colour))
    return parts


def held_points(surface: PolyData, marks: Marks) -> list[Part]:
    """The points of a surface that belong to supports."""
    from pyvista import PolyData

    node = surface.point_data[NODE]
    places = [(mark, surface.points[mark.on[node]]) for mark in marks.supports]
    return [painted(PolyData(found), _colour_of(mark)) for mark, found in places if len(found)]


def _colour_of(mark: SupportMark) -> str:
    """The colour of the region of a support."""
    return COLOURS["support"] if mark.label == CLAMPED else HELD


def symbols(marks: Marks, points: Array, view: View) -> list[Symbol]:
    """The symbols of a set-up.

    Args:
        marks: what is marked.
        points: (n, 3) points of the whole body, m.
        view: the projection.
    """
    import pyvista

    reach = REACH * view.length
    found = []
    for support in marks.supports:
        if support.label != CLAMPED:
            cones = _cones(support, points, view, 0.3 * reach)
            found.append(Symbol(f"support, {support.label}", "support", "<", cones))
    arrows = load_arrows(marks.loads, reach)
    for k, load in enumerate(marks.loads):
        label = f"{k + 1}: {load.label}" if len(marks.loads) > 1 else load.label
        mine = [_arrow(start, end - start) for number, start, end in arrows if number == k]
        found.append(Symbol(label, "load", ARROW, pyvista.merge(mine)))
    for attached in marks.attachments:
        marker = ATTACHED_FORMS[attached.kind]
        mesh = _forms(marker, attached.place[None], 0.2 * reach)
        found.append(Symbol(attached.label, "attachment", marker, mesh))
    for marker, contact in zip(itertools.cycle(CONTACT_FORMS), marks.contacts, strict=False):
        mesh = _forms(marker, contact.places, 0.11 * reach)
        found.append(Symbol(contact.label, "contact", marker, mesh))
    if marks.contacts:
        normals = pyvista.merge([_normals(mark, 0.5 * reach) for mark in marks.contacts])
        found.append(Symbol("normal into the wall", "contact", ARROW, normals))
    if marks.probe is not None:
        ring = pyvista.Disc(
            center=marks.probe,
            inner=0.09 * reach,
            outer=0.14 * reach,
            normal=view.towards,
            c_res=40,
        )
        found.append(Symbol("probe", "probe", "$○$", ring))
    return found


def _arrow(start: Array, way: Array) -> PolyData:
    """An arrow along `way` (3,)."""
    import pyvista

    look: dict[str, Any] = {"scale": "auto", "tip_radius": 0.09, "shaft_radius": 0.028}
    return pyvista.Arrow(start=start, direction=way, **look)


def _cone(tip: Array, way: Array, height: float) -> PolyData:
    """A cone at `tip` (3,) that points along the unit vector `way` (3,)."""
    import pyvista

    size: dict[str, Any] = {"height": height, "radius": 0.35 * height, "resolution": 24}
    return pyvista.Cone(center=tip - 0.5 * height * way, direction=way, **size)


def _cones(mark: SupportMark, points: Array, view: View, height: float) -> PolyData:
    """Cones whose tips hold some points of a support in its directions, outside of the body."""
    import pyvista

    places = points[mark.on]
    chosen, away = [0], np.full(len(places), np.inf)
    for _ in range(MOST_CONES - 1):
        away = np.minimum(away, np.linalg.norm(places - places[chosen[-1]], axis=1))
        if away.max() < APART * view.length:
            break
        chosen.append(int(np.argmax(away)))
    found = []
    for direction in mark.directions:
        outward = np.sign((places.mean(axis=0) - points.mean(axis=0)) @ direction) or 1.0
        found += [_cone(place, -outward * direction, height) for place in places[chosen]]
    return pyvista.merge(found)


def _forms(marker: str, places: Array, size: float) -> PolyData:
    """The form of a marker of the legend at each place (P, 3)."""
    import pyvista

    forms = {
        "o": pyvista.Sphere(radius=0.5),
        "s": pyvista.Cube(x_length=0.8, y_length=0.8, z_length=0.8),
        "D": pyvista.PlatonicSolid("octahedron", radius=0.6),
        "^": pyvista.Cone(direction=(0.0, 0.0, 1.0), radius=0.5, resolution=24),
    }
    cloud = pyvista.PolyData(places)
    return cloud.glyph(orient=False, scale=False, geom=forms[marker], factor=size)


def _normals(mark: ContactMark, size: float) -> PolyData:
    """The normals of a contact into its wall as thin arrows."""
    import pyvista

    cloud = pyvista.PolyData(mark.places)
    cloud.point_data["normal"] = mark.normals
    thin = pyvista.Arrow(tip_radius=0.08, shaft_radius=0.02)
    return cloud.glyph(orient="normal", scale=False, geom=thin, factor=size)


def surroundings(marks: Marks, points: Array) -> list[Part]:
    """The round walls, and the axis of rotation beside the body (n, 3) and the walls.

    An arrow around the axis points in the sense in which the body turns.
    """
    import pyvista

    found = []
    for wall in (mark.wall for mark in marks.contacts if mark.wall is not None):
        cells = np.insert(wall.cells, 0, wall.cells.shape[1], axis=1).ravel()
        kind = "lines" if wall.cells.shape[1] == 2 else "faces"
        look = {"opacity": 1.0 if kind == "lines" else 0.35, "line_width": 2.0}
        mesh = pyvista.PolyData(wall.points, **{kind: cells})
        found.append(painted(mesh, COLOURS["contact"], **look))
    if marks.rotation is not None:
        ends = axis_ends(marks.rotation, np.concatenate([points, *(p.mesh.points for p in found)]))
        radius = 0.05 * float(np.linalg.norm(ends[1] - ends[0]))
        arc = turning_arrow(marks.rotation, ends[1] + 0.2 * (ends[0] - ends[1]), radius)
        way = (arc[-1] - arc[-2]) / np.linalg.norm(arc[-1] - arc[-2])
        lines = [pyvista.MultipleLines(points=line) for line in (ends, arc)]
        found += [drawn_lines(line, COLOURS["rotation"], 2.5) for line in lines]
        found.append(painted(_cone(arc[-1], way, 0.6 * radius), COLOURS["rotation"]))
    return found


def axis_ends(rotation: RotationMark, places: Array) -> Array:
    """The ends (2, 3) of the drawn part of the axis of rotation, beside places (n, 3)."""
    along = (places - rotation.point) @ rotation.axis
    spare = SPARE * float(np.ptp(places, axis=0).max())
    return np.asarray(
        rotation.point + np.outer([along.min() - spare, along.max() + spare], rotation.axis)
    )


def turning_arrow(rotation: RotationMark, centre: Array, radius: float) -> Array:
    """An arc (n, 3) around the axis, in the sense in which the body turns."""
    first = np.eye(3)[int(np.argmin(np.abs(rotation.axis)))]
    across = np.cross(rotation.axis, first)
    across /= np.linalg.norm(across)
    angle = np.linspace(0.0, 1.6 * np.pi, 33)[:, None]
    upward = np.cross(rotation.axis, across)
    return np.asarray(centre + radius * (np.cos(angle) * across + np.sin(angle) * upward))


def legend_handles(marks: Marks, drawn: Sequence[Symbol]) -> list[Any]:
    """The entries of the legend: the regions, each symbol once, and the surroundings."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    if any(mark.label == CLAMPED for mark in marks.supports):
        handles.append(Patch(color=COLOURS["support"], label=f"support, {CLAMPED}"))
    if any(load.on.any() for load in marks.loads):
        handles.append(Patch(color=LOADED, label="loaded region"))
    for symbol in {symbol.label: symbol for symbol in drawn}.values():
        look: dict[str, Any] = {
            "color": COLOURS[symbol.kind],
            "marker": symbol.marker,
            "label": symbol.label,
        }
        size = 13.0 if symbol.marker.startswith("$") else 7.0
        handles.append(Line2D([], [], linestyle="none", markersize=size, **look))
    if any(contact.wall is not None for contact in marks.contacts):
        handles.append(Patch(color=COLOURS["contact"], alpha=0.35, label="round wall"))
    if marks.rotation is not None:
        label = f"axis of rotation, {marks.rotation.speed_rpm:g} rpm"
        handles.append(Line2D([], [], label=label, color=COLOURS["rotation"]))
    return handles
