"""The picture of the set-up: the undeformed mesh with all that acts on it.

All of it belongs to the undeformed body, which the picture shows: the arrow of a pressure is normal
to the face that is drawn, also if the pressure follows the deformation.

The axis of rotation and round walls are often much larger than the body: a second panel then shows
all of them. Each symbol has a form and a colour of its own, so that readers who cannot tell the
colours apart see the form.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import SceneError
from fenicsrom.post.base.plot import Bars, Item, Line, Plot
from fenicsrom.post.body.body_view import (
    NODE,
    PolyData,
    View,
    areas,
    cell_edges,
    faces_on,
    form_edges,
    frame_of,
    gathered_grid,
    is_flat,
    surface_of,
    view_of,
)
from fenicsrom.post.body.rendering import (
    GREY,
    Part,
    body_panel,
    drawn_lines,
    image_of,
    names_at,
    painted,
    width_of,
)
from fenicsrom.post.body.surface_mesh import surface_grid
from fenicsrom.post.paraview.paraview import contact_places
from fenicsrom.post.paraview.vtk import Grid, in_space
from fenicsrom.scene import Contact, Load, Place, Scene, Support
from fenicsrom.scene.base.tables import keys
from fenicsrom.scene.keys.loads import ACTIONS, Harmonics, Pulse, Sweep
from fenicsrom.scene.keys.unit_system import Units

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid


CLAMPED = "support, clamped"
"""The label of supports that hold every component."""

WEIGHTY = 0.1
"""Smaller nodal forces of a pressure, relative to the largest, do not show its direction."""

LOAD_UNITS = {name: rule.unit for kind in ACTIONS.kinds for name, rule, *_ in keys(kind)}
"""Key of the size of a load -> its unit."""

ARROW = ">"
"""The marker of an arrow in the legend."""

CONTACT_FORMS = ("o", "s", "D", "^")
"""Markers of the contacts: sphere, cube, octahedron and cone."""

ATTACHED_FORMS = {"mass": "s", "spring": "D", "dashpot": "^"}
"""The same of attachments."""


ATTACHED = (("mass", "mass", "kg"), ("stiffness", "spring", "N/m"), ("damping", "dashpot", "N s/m"))
"""Keys of an attachment, its kind and the unit; the last two have a key for each area, too."""


@dataclass(frozen=True, eq=False)
class Mark:
    """One thing in the picture of the set-up.

    Attributes:
        kind: "support", "load", "attachment", "tie", "contact", "probe" or "rotation".
        label: its name in the legend.
        marker: its marker in the legend, as in matplotlib.
        places: (k, 3) where it is: tips of arrows, contact points, a point of the axis, m.
        ways: unit vectors: (c, 3) held directions, (1, 3) direction of a load or axis of rotation,
            which turns the body by the right-hand rule, or (k, 3) normals into the wall.
        on: (n,) whether a point of the body belongs to the region, of a contact the other one;
            empty without a region.
        wall: the round surface of a contact; None of a plane.
    """

    kind: str
    label: str
    marker: str
    places: Array
    ways: Array = field(default_factory=lambda: np.zeros((0, 3)))
    on: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    wall: Grid | None = None


def gathered_marks(
    solid: Solid, scene: Scene, fields: Mapping[str, Any]
) -> tuple[Grid, dict[str, Array], list[Mark]] | None:
    """Find the marks of a scene. Collective.

    Args:
        solid: the body.
        scene: its scene.
        fields: more fields on the body, by their names.

    Returns:
        The grid of the body, the values (n, 3) of the fields at its points, and the marks; None on
        ranks other than the first.
    """
    regions = _regions(solid, scene)
    placed: list[tuple[str, Place]] = [
        (f"loads[{k}]", one.place)
        for k, one in enumerate(scene.loads)
        if not (one.everywhere or one.kind == "pressure")
    ]
    ends = {one: [*filter(None, (one.place, one.to))] for one in scene.attachments}
    placed += [("attachments", place) for found in ends.values() for place in found]
    placed += [
        (f"bolts[{k}].{name}", Place(group=getattr(bolt, name)))
        for k, bolt in enumerate(scene.bolts)
        for name in ("head", "nut")
    ]
    at = {place: solid.place(place, key)[1] for key, place in placed}
    every: list[Any] = [*scene.attachments, *scene.contacts]
    lengths = {
        found.place: solid.mesh.unit_lengths(found.place) if _is_region(found.place) else 0
        for found in every
    }
    gathered = gathered_grid(
        solid.space, {name: solid.field(field) for name, field in regions.items()} | {**fields}
    )
    if gathered is None:
        return None
    grid, values = gathered
    marks = _support_marks(scene, grid.points, values)
    marks += [_load_mark(scene, k, grid.points, values, at) for k in range(len(scene.loads))]
    marks += [mark for k in range(len(scene.bolts)) for mark in _bolt_marks(scene, k, at)]
    marks += [
        Mark("attachment", label, ATTACHED_FORMS[kind], np.array([at[p] for p in ends[found]]))
        for found in scene.attachments
        for kind, label in _attached(found, scene.units, lengths[found.place])
    ]
    for one, places in zip(scene.ties, solid.tied, strict=True):
        label = f'tie of "{one.group}" and "{one.against}"'
        marks.append(Mark("tie", label, "s", in_space(places)))
    forms = zip(itertools.cycle(CONTACT_FORMS), scene.contacts, strict=False)
    for k, (form, contact) in enumerate(forms):
        mine = solid.points.contact == k
        label = f"contact{f' {k + 1}' * (len(scene.contacts) > 1)}"
        label += _pressed(contact, scene.units, lengths[contact.place])
        places, normals = contact_places(solid.points)[mine], in_space(solid.points.frame[mine, 0])
        wall = _round(solid, scene, k)
        marks.append(Mark("contact", label, form, places, normals, wall=wall))
        if contact.against is not None:
            marks[-1] = replace(marks[-1], on=values[f"against {k}"][:, 0] > 0.5)
    if not (scene.contacts and scene.probe is None) and not np.isnan(solid.probe_position).any():
        marks.append(Mark("probe", "probe", "*", solid.probe_position[None]))
    if scene.rotation is not None:
        speed = scene.rotation.speed_rpm
        point = in_space(np.array([scene.rotation.point or np.zeros(solid.dimension)]))
        axis = np.copysign(1.0, speed) * np.array([scene.rotation.axis or (0.0, 0.0, 1.0)])
        label = f"axis of rotation, {abs(speed):g} rpm"
        marks.append(Mark("rotation", label, ARROW, point, axis / np.linalg.norm(axis)))
    return grid, values, marks


def _regions(solid: Solid, scene: Scene) -> dict[str, Array]:
    """Fields (local,): 1 at the first component of the nodes of a region, or nodal forces."""
    from fenicsrom.fem.body.supports import support_directions

    d = solid.dimension
    fields: dict[str, Array] = {}

    def mark(label: str, nodes: Any) -> None:
        fields[label] = np.zeros(solid.local)
        fields[label][nodes[nodes < solid.local // d] * d] = 1.0

    for k, support in enumerate(scene.supports):
        mark(f"support {k}", support_directions(solid.mesh, solid.space, support, scene.source)[0])
    for k, load in enumerate(scene.loads):
        if load.kind == "pressure":
            fields[f"pressure {k}"] = solid.load_vector(load, f"loads[{k}]")
        if not load.everywhere and _is_region(load.place) and load.place.at == "mean":
            mark(f"load {k}", solid.mesh.nodes(load.place, solid.space))
    for k, (_, nodes) in solid.sides.items():
        mark(f"against {k}", nodes)
    return fields


def _is_region(place: Place) -> bool:
    """Whether a place is a region, and not given by the coordinates of a point."""
    return place.node is None and place.nearest is None


def _round(solid: Solid, scene: Scene, k: int) -> Grid | None:
    """The round surface of contact k; None of a plane.

    Of a surface that cuts into the undeformed body, none is drawn: a run refuses it.
    """
    try:
        return surface_grid(scene, solid.points, k, 0.0) if scene.contacts[k].surface else None
    except SceneError:
        return None


def _support_marks(scene: Scene, points: Array, values: Mapping[str, Array]) -> list[Mark]:
    """The supports, those with the same directions together."""
    marks: dict[str, Mark] = {}
    for k, support in enumerate(scene.supports):
        label, directions = _held(support, scene.geometry.dimension)
        on = values[f"support {k}"][:, 0] > 0.5
        if label in marks:
            on = on | marks[label].on
        marks[label] = Mark("support", label, "<", points[on], directions, on)
    return list(marks.values())


def _held(support: Support, d: int) -> tuple[str, Array]:
    """The label of a support and its held directions (c, 3); empty if the support holds all."""
    if support.normal is not None:
        along = ", ".join(f"{x:.3g}" for x in support.normal)
        return f"support, held along ({along})", in_space(np.array([support.normal]))
    axes = support.components or tuple("xyz"[:d])
    if len(set(axes)) == d:
        return CLAMPED, np.zeros((0, 3))
    held = np.eye(3)[["xyz".index(axis) for axis in axes]]
    return f"support, held along {' and '.join(axes)}", held


def _load_mark(
    scene: Scene, k: int, points: Array, values: Mapping[str, Array], at: Mapping[Place, Array]
) -> Mark:
    """The mark of a load. A motion of the supports has an arrow at each of them."""
    load = scene.loads[k]
    on = values.get(f"load {k}", np.zeros((0, 3)))[:, 0] > 0.5
    direction = in_space(np.array(load.direction or (), dtype=float))
    if load.moves_supports:
        held = [values[f"support {n}"][:, 0] > 0.5 for n in range(len(scene.supports))]
        places = np.array([points[found].mean(axis=0) for found in held])
    elif load.everywhere:
        places = points.mean(axis=0)[None]
    elif load.kind == "pressure":
        forces = values[f"pressure {k}"]
        sizes = np.linalg.norm(forces, axis=1)
        middle = sizes @ points / sizes.sum()
        weighty = np.flatnonzero(sizes > WEIGHTY * sizes.max())
        nearest = weighty[np.argmin(np.linalg.norm(points[weighty] - middle, axis=1))]
        places, direction = points[[nearest]], forces[nearest] / sizes[nearest]
    else:
        places = at[load.place][None]
    number = f"{k + 1}: " * (len(scene.loads) + len(scene.bolts) > 1)
    way = np.copysign(1.0, load.size) * direction[None]
    return Mark("load", f"{number}{_load_label(load)}", ARROW, places, way, on)


def _bolt_marks(scene: Scene, k: int, at: Mapping[Place, Array]) -> Iterator[Mark]:
    """The marks of the two ends of a bolt, which are numbered after the loads."""
    bolt, number = scene.bolts[k], len(scene.loads) + 2 * k + 1
    head, nut = (at[Place(group=name)] for name in (bolt.head, bolt.nut))
    way = (nut - head) / np.linalg.norm(nut - head)
    for end, name in ((0, "head"), (1, "nut")):
        label = f"{number + end}: bolt {bolt.force:.6g} N, {name}"
        yield Mark("load", label, ARROW, (head, nut)[end][None], (1 - 2 * end) * way[None])


def _load_label(load: Load) -> str:
    """Kind, place, size and history of a load."""
    where = ""
    if not load.everywhere and load.place.group is not None:
        where = f' on "{load.place.group}"'
    history = "static" if load.static else f"{load.frequency:g} Hz" if load.frequency else "table"
    if isinstance(load.history, Harmonics):
        history = f"harmonics of {history}"
    elif isinstance(load.history, Sweep):
        history = f"{history} to {load.history.sweep.to:g} Hz"
    elif isinstance(load.history, Pulse):
        history = "pulse"
    size = f"{abs(load.size):g} {LOAD_UNITS[load.kind]}"
    kind = f"{'follower ' * load.follower}{load.kind.replace('_', ' ')}"
    return f"{kind}{where}, {size}, {history}"


def _pressed(contact: Contact, units: Units, lengths: int) -> str:
    """The preload or the gap of a contact, as a part of its label."""
    if contact.preload and contact.place.at == "nodes":
        return f", preload {units.per_region(contact.preload, 'N', lengths)}"
    if contact.preload:
        return f", preload {contact.preload:g} N"
    return f", gap {1e3 * contact.gap:g} mm" if contact.gap else ""


def _attached(attachment: Any, units: Units, lengths: int) -> list[tuple[str, str]]:
    """The kinds and the labels of the parts of an attachment."""
    along = " in each direction" if attachment.to is None else " between two places"
    if attachment.components is not None:
        along = f" along {', '.join(attachment.components)}"
    found = []
    for key, kind, unit in ATTACHED:
        if size := getattr(attachment, key):
            found.append((kind, f"{kind}, {size:g} {unit}{along * (kind != 'mass')}"))
        if size := getattr(attachment, f"{key}_per_area", 0.0):
            label = f"{kind}, {units.per_region(size, unit, lengths)}{along}"
            found.append((kind, label))
    return found


OVERVIEW = 0.32
"""Width of the second panel, relative to the picture of the body."""


def setup_figure(
    grid: Grid,
    marks: Sequence[Mark],
    title: str,
    view: View | None = None,
    beside: Sequence[Array] = (),
) -> Plot:
    """Draw the undeformed body with its supports, loads, attachments, contacts and probe.

    Several loads and contact points have numbers. The projection is that of `setup_view` by
    default. The neighbours of a sector, with the points `beside`, are pale.
    """
    surface = surface_of(grid)
    view = view or setup_view(surface, marks)
    drawn = symbols(marks, grid.points, view.length)
    places = [surface.points, *(part.mesh.points for part in drawn)]
    frame = frame_of(view, [*places, *beside])
    _, low, high = frame
    pale = [surface_of(replace(grid, points=points)) for points in beside]
    body = [painted(near, PALE, opacity=0.4) for near in pale]
    body += [drawn_lines(form_edges(near), PALE_LINE) for near in pale]
    body += [*region_parts(surface, marks), drawn_lines(form_edges(surface))]
    body += [drawn_lines(cell_edges(grid), "#8C949B", 1.0), *drawn]
    around = surroundings(marks, grid.points)
    wide = width_of(frame)
    numbers = _numbers(marks, view, (high[0] - low[0]) / (72.0 * wide))
    panels = [
        body_panel([image_of([*body, *around], frame, wide), *names_at(numbers, frame, wide)])
    ]
    widths = [1.0]
    reach = [part.mesh.points for part in around]
    if any(np.any((seen < low) | (seen > high)) for seen in map(view.project, reach)):
        every = np.concatenate([surface.points, *reach])
        far = replace(view, length=float(np.ptp(every, axis=0).max()))
        whole = frame_of(far, [*places, *reach])
        overview = image_of([painted(surface), *around], whole, OVERVIEW * wide)
        panels.append(body_panel([overview]))
        widths.append(OVERVIEW)
    samples = [*_samples(marks), *([Bars(color=PALE, label="neighbours")] if pale else [])]
    look: dict[str, Any] = {"columns": len(panels), "widths": widths, "legend": samples}
    return Plot(panels, wide * sum(widths), 0.0, title=title, **look)


def setup_view(surface: PolyData, marks: Sequence[Mark], moved: Array | None = None) -> View:
    """The projection of a body in its set-up and its motions.

    The viewer sees the side on which the loads act, and looks across the displacement `moved`
    (3,) if it is given.
    """
    sizes, facing = areas(surface), np.zeros(3)
    for load in (mark for mark in marks if mark.kind == "load" and mark.on.any()):
        facing += sizes[faces_on(surface, load.on[surface.point_data[NODE]])].sum(axis=0)
    return view_of(surface, facing, moved=moved)


def _samples(marks: Sequence[Mark]) -> list[Item]:
    """The samples in the legend: the loaded regions, each label once, and round walls."""
    found: list[Item] = []
    for mark in {mark.label: mark for mark in marks}.values():
        look: dict[str, Any] = {"color": COLOURS[mark.kind], "label": mark.label}
        if mark.label == CLAMPED:
            found.append(Bars(**look))
            continue
        line = "-" if mark.marker == ARROW else ""
        found.append(Line(linestyle=line, marker=mark.marker, markersize=7.0, **look))
    if any(mark.kind == "load" and mark.on.any() for mark in marks):
        found.append(Bars(color=LOADED, label="loaded region"))
    if any(mark.kind == "contact" and mark.on.any() for mark in marks):
        found.append(Bars(color=WALL, label="other side of a contact"))
    if any(mark.wall is not None for mark in marks):
        found.append(Bars(color=WALL, label="round wall"))
    return found


def _numbers(marks: Sequence[Mark], view: View, point: float) -> Iterator[tuple[str, Array, str]]:
    """The numbers of several loads and contact points, with their places and colours.

    The argument `point` is the length of a typographic point in the picture, m.
    """
    loads = [mark for mark in marks if mark.kind == "load"]
    contacts = [mark for mark in marks if mark.kind == "contact"]
    reach = REACH * view.length
    rows = [
        ("load", number, tip - reach * way, -way)
        for number, (load, tips) in enumerate(zip(loads, load_tips(loads, reach), strict=True), 1)
        for way in load.ways
        for tip in tips
        if len(loads) > 1
    ]
    points = [pair for mark in contacts for pair in zip(mark.places, -mark.ways, strict=True)]
    found = [("contact", number, *pair) for number, pair in enumerate(points, 1) if points[1:]]
    for kind, number, place, step in rows + found[-1:] + found[:-1]:
        at, way = view.project(place), view.project(step)
        size = float(np.linalg.norm(way))
        away = way / size if size > 1e-9 else np.array([0.0, -1.0])
        yield str(number), at + 11.0 * point * away, COLOURS[kind]


COLOURS = {
    "support": "#56585A",
    "load": "#D55E00",
    "attachment": "#882255",
    "tie": "#117733",
    "contact": "#0072B2",
    "probe": "#009E73",
    "rotation": "#332288",
}

PALE, PALE_LINE = "#F1F3F4", "#C3C8CC"
"""Colours of neighbouring sectors and of their edges."""

LOADED, HELD, WALL = "#F3C6A5", "#9AA1A8", "#A6CEE4"
"""Colours of regions of loads, of supports that hold some components, and of round walls."""

REGIONS = {"load": LOADED, "contact": WALL}
"""Colours of the regions of loads, and of the other side of contacts between bodies."""

SYMBOLS = {"attachment": 0.2, "tie": 0.11, "contact": 0.11, "probe": 0.2}
"""Sizes of symbols at places, relative to the length of the arrow of a load."""

REACH = 0.14
"""Length of the arrow of a load, relative to the size of the body."""

APART = 0.045
"""Smallest distance of two cones of a support, relative to the size of the body."""

SAME_WAY = 0.9
"""Cosine of the angle from which two arrows have the same direction."""

SPARE = 0.15
"""Length of the axis of rotation beyond what it passes, relative to the extent along it."""


def load_tips(loads: Sequence[Mark], reach: float) -> list[Array]:
    """The tips (k, 3) of the arrows of loads: those that would coincide stand in a row, m."""
    taken: list[tuple[Array, Array]] = []
    for load in loads:
        (way,) = load.ways
        for tip in load.places:
            while any(
                way @ other >= SAME_WAY and np.linalg.norm(tip - place) < 0.5 * reach
                for place, other in taken
            ):
                tip = tip - 1.1 * reach * way
            taken.append((tip, way))
    tips = iter(tip for tip, _ in taken)
    return [np.array([next(tips) for _ in load.places]) for load in loads]


def region_colour(mark: Mark) -> str:
    """The colour of the region of a support, a load or a contact."""
    if mark.kind in REGIONS:
        return REGIONS[mark.kind]
    return COLOURS["support"] if mark.label == CLAMPED else HELD


def region_parts(surface: PolyData, marks: Sequence[Mark]) -> list[Part]:
    """The body with the faces of its regions in their colours, the clamped ones above the others.

    The rim of a support is seen through the body. The nodes of a support or of a plane body that
    belong to no face of the region are points.
    """
    from pyvista import Color, PolyData

    regions = [mark for mark in marks if mark.on.any()]
    regions.sort(key=lambda mark: (mark.kind == "support", mark.label == CLAMPED))
    flat, node = is_flat(surface.points), surface.point_data[NODE]
    body, parts = surface.copy(), []
    paint = np.tile(Color(GREY).int_rgb, (surface.n_cells, 1)).astype(np.uint8)
    for mark in regions:
        on, colour = mark.on[node], region_colour(mark)
        faces = faces_on(surface, on) & (not flat)
        paint[faces] = Color(colour).int_rgb
        if flat or mark.kind == "support":
            alone = np.setdiff1d(np.flatnonzero(on), surface.regular_faces[faces])
            parts.append(
                painted(PolyData(surface.points[alone]), colour, not flat, point_size=11.0)
            )
        if faces.any() and mark.kind == "support":
            rim = surface.remove_cells(~faces).extract_feature_edges(
                feature_edges=False, manifold_edges=False
            )
            parts.append(painted(rim, colour, True, line_width=3.5))
    body.cell_data["paint"] = paint
    return [Part(body, {"scalars": "paint", "rgb": True}), *parts]


def held_points(surface: PolyData, marks: Sequence[Mark]) -> list[Part]:
    """The points of a surface that belong to supports."""
    from pyvista import PolyData

    node, held = surface.point_data[NODE], [mark for mark in marks if mark.kind == "support"]
    places = [(mark, surface.points[mark.on[node]]) for mark in held]
    return [painted(PolyData(found), region_colour(mark)) for mark, found in places if len(found)]


def symbols(marks: Sequence[Mark], points: Array, length: float) -> list[Part]:
    """The symbols of marks, which show through the body.

    Args:
        marks: what is marked.
        points: (n, 3) points of the whole body, m.
        length: of the body, m.
    """
    reach, found = REACH * length, []
    tips = iter(load_tips([mark for mark in marks if mark.kind == "load"], reach))
    for mark in marks:
        if mark.kind == "load":
            mesh = _glyphs(ARROW, next(tips), reach, mark.ways)
        elif mark.kind == "support" and len(mark.ways):
            mesh = _cones(mark, points, 0.3 * reach, APART * length)
        elif mark.kind in SYMBOLS:
            mesh = _glyphs(mark.marker, mark.places, SYMBOLS[mark.kind] * reach)
            if len(mark.ways):
                mesh = mesh.append_polydata(_glyphs("-", mark.places, 0.5 * reach, mark.ways))
        else:
            continue
        found.append(Part(mesh, {"color": COLOURS[mark.kind]}, symbol=True))
    return found


def _glyphs(form: str, places: Array, size: float, ways: Array | None = None) -> PolyData:
    """The form of a marker at each place (P, 3), along unit vectors (1, 3) or (P, 3) if given."""
    import pyvista

    arrow: dict[str, Any] = {"start": (-1.0, 0.0, 0.0), "tip_radius": 0.09, "shaft_radius": 0.028}
    forms: dict[str, Any] = {
        "o": lambda: pyvista.Sphere(radius=0.5),
        "s": lambda: pyvista.Cube(x_length=0.8, y_length=0.8, z_length=0.8),
        "D": lambda: pyvista.PlatonicSolid("octahedron", radius=0.6),
        "^": lambda: pyvista.Cone(direction=(0.0, 0.0, 1.0), radius=0.5, resolution=24),
        "*": lambda: pyvista.PlatonicSolid("icosahedron", radius=0.6),
        "<": lambda: pyvista.Cone(center=(-0.5, 0.0, 0.0), radius=0.35, resolution=24),
        ARROW: lambda: pyvista.Arrow(**arrow),
        "-": lambda: pyvista.Arrow(tip_radius=0.08, shaft_radius=0.02),
    }
    cloud: Any = pyvista.PolyData(np.array(places, dtype=float))
    if ways is not None:
        cloud.point_data["way"] = np.broadcast_to(ways, places.shape)
    orient = "way" if ways is not None else False
    mesh: PolyData = cloud.glyph(orient=orient, scale=False, geom=forms[form](), factor=size)
    return mesh


def _cones(mark: Mark, points: Array, height: float, apart: float) -> PolyData:
    """Cones whose tips hold some points of a support in its directions, outside of the body."""
    import pyvista

    cloud: Any = pyvista.PolyData(mark.places)
    some: Any = cloud.clean(tolerance=3.0 * apart, absolute=True).points
    outward = mark.places.mean(axis=0) - points.mean(axis=0)
    ways = [-(np.sign(outward @ way) or 1.0) * way[None] for way in mark.ways]
    return pyvista.merge([_glyphs("<", some, height, way) for way in ways])


def surroundings(marks: Sequence[Mark], points: Array) -> list[Part]:
    """Parts that show the round walls, and the axis of rotation along walls and body (n, 3)."""
    import pyvista

    found = []
    for wall in (mark.wall for mark in marks if mark.wall is not None):
        cells = np.insert(wall.cells, 0, wall.cells.shape[1], axis=1).ravel()
        kind = "lines" if wall.cells.shape[1] == 2 else "faces"
        mesh, opacity = pyvista.PolyData(wall.points, **{kind: cells}), kind == "lines" or 0.35
        found.append(painted(mesh, COLOURS["contact"], opacity=float(opacity), line_width=2.0))
    for mark in (mark for mark in marks if mark.kind == "rotation"):
        places = np.concatenate([points, *(part.mesh.points for part in found)])
        (point,), (axis,) = mark.places, mark.ways
        along, spare = (places - point) @ axis, SPARE * float(np.ptp(places, axis=0).max())
        length = float(np.ptp(along)) + 2.0 * spare
        tip = point + (along.max() + spare) * axis
        found.append(painted(_glyphs(ARROW, tip[None], length, axis), COLOURS["rotation"]))
    return found
