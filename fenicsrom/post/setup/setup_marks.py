"""The marks in the picture of the set-up: supports, loads, attachments, contacts and probe.

All of it belongs to the undeformed body, which the picture shows: the arrow of a pressure is normal
to the face that is drawn, also if the pressure follows the deformation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import SceneError
from fenicsrom.post.body.surface_mesh import surface_grid
from fenicsrom.post.paraview.fields import contact_places
from fenicsrom.post.paraview.vtk_files import Grid, in_space
from fenicsrom.scene import Contact, Load, Place, Scene, Support
from fenicsrom.scene.loads import ACTIONS, Harmonics, Pulse, Sweep
from fenicsrom.scene.tables import keys

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid

Flags = NDArray[np.bool_]

CLAMPED = "clamped"
"""The legend of supports that hold every component."""

WEIGHTY = 0.1
"""Smaller nodal forces of a pressure, relative to the largest, do not show its direction."""

STIFFNESS_UNITS = {"area": "N/m³", "length": "N/m²", "node": "N/m per node"}
"""What stiffnesses and damping coefficients "per area" of a region refer to -> the unit of the
stiffness. The area of an edge of a plane body contains its thickness."""

PRELOAD_UNITS = {"area": "Pa", "length": "N/m", "node": "N per node"}
"""The unit of the preload of all nodes of a region, by what it refers to."""

LOAD_UNITS = {name: rule.unit for kind in ACTIONS.kinds for name, rule, *_ in keys(kind)}
"""Key of the size of a load -> its unit."""


@dataclass(frozen=True, eq=False)
class SupportMark:
    """Supports that hold the same directions.

    Attributes:
        label: which directions they hold, for the legend.
        on: (n,) whether a point of the body belongs to them.
        directions: (c, 3) unit vectors of the held directions; (0, 3) if every component is held.
    """

    label: str
    on: Flags
    directions: Array


@dataclass(frozen=True, eq=False)
class LoadMark:
    """A load.

    Attributes:
        label: kind, place, size and history of the load, for the legend.
        places: (k, 3) ends of the arrows of the load, m.
        direction: (3,) unit vector.
        on: (n,) whether a point of the body belongs to the region on which it is distributed.
    """

    label: str
    places: Array
    direction: Array
    on: Flags


@dataclass(frozen=True, eq=False)
class AttachmentMark:
    """A concentrated mass, spring or dashpot.

    Attributes:
        kind: "mass", "spring" or "dashpot".
        label: with its size, for the legend.
        place: (3,) where it is, m.
    """

    kind: str
    label: str
    place: Array


@dataclass(frozen=True, eq=False)
class ContactMark:
    """A contact.

    Attributes:
        label: name of the contact in the legend.
        places: (P, 3) its contact points, m.
        normals: (P, 3) unit normals into the wall.
        first: number of the first point of the contact, from 1 over all contacts.
        wall: the round surface of the contact; None of a plane.
    """

    label: str
    places: Array
    normals: Array
    first: int = 1
    wall: Grid | None = None


@dataclass(frozen=True, eq=False)
class RotationMark:
    """The axis of rotation.

    Attributes:
        speed_rpm: the speed, at least 0, rev/min.
        point: (3,) a point of the axis, m.
        axis: (3,) unit vector; the body turns about it by the right-hand rule.
    """

    speed_rpm: float
    point: Array
    axis: Array


@dataclass(frozen=True, eq=False)
class Marks:
    """What the picture of the set-up marks.

    Attributes:
        supports, loads, attachments, contacts: the marks of each kind.
        probe: (3,) the place where the motion is read, or None.
        rotation: the axis of rotation, or None.
    """

    supports: Sequence[SupportMark] = ()
    loads: Sequence[LoadMark] = ()
    attachments: Sequence[AttachmentMark] = ()
    contacts: Sequence[ContactMark] = ()
    probe: Array | None = None
    rotation: RotationMark | None = None


@dataclass(frozen=True, eq=False)
class Marked:
    """The data of a solid, from all ranks, that `marks_of` needs.

    Attributes:
        fields: label -> field (local,): 1 at the first component of the nodes of a region, or
            nodal forces of a pressure.
        positions: the centre of each region on which a point is marked, m.
        measures: how regions with attachments and contacts are measured, a key of
            `STIFFNESS_UNITS`.
    """

    fields: dict[str, Array]
    positions: Mapping[Place, Array]
    measures: Mapping[Place, str]


def marked(solid: Solid, scene: Scene) -> Marked:
    """Find the nodes and centres of the regions that a scene names. Collective."""
    from fenicsrom.fem.body.supports import support_directions

    d = solid.dimension
    fields: dict[str, Array] = {}
    positions: dict[Place, Array] = {}
    measures: dict[Place, str] = {}

    def mark(label: str, nodes: Any) -> None:
        fields[label] = np.zeros(solid.local)
        fields[label][nodes[nodes < solid.local // d] * d] = 1.0

    for k, support in enumerate(scene.supports):
        mark(f"support {k}", support_directions(solid.mesh, solid.space, support, scene.source)[0])
    for k, load in enumerate(scene.loads):
        if load.everywhere:
            continue
        if _is_region(load.place) and load.place.at == "mean":
            mark(f"load {k}", solid.mesh.nodes(load.place, solid.space))
        if load.kind == "pressure":
            fields[f"pressure {k}"] = solid.load_vector(load, f"loads[{k}]")
        elif _is_region(load.place):
            positions[load.place] = solid.place(load.place, f"loads[{k}]")[1]
    for k, attachment in enumerate(scene.attachments):
        if _is_region(attachment.place):
            positions[attachment.place] = solid.place(attachment.place, f"attachments[{k}]")[1]
            measures[attachment.place] = _measure(solid, attachment.place)
    for contact in scene.contacts:
        if contact.place.at == "nodes":
            measures[contact.place] = _measure(solid, contact.place)
    return Marked(fields, positions, measures)


def _measure(solid: Solid, place: Place) -> str:
    """How a region is measured: by the area of its facets, the length of its edges, or by nodes."""
    if solid.mesh.has_facets(place):
        return "area"
    edges = solid.mesh.entities(place).get(1)
    return "length" if solid.comm.allreduce(0 if edges is None else len(edges)) else "node"


def marks_of(
    solid: Solid, scene: Scene, found: Marked, points: Array, values: Mapping[str, Array]
) -> Marks:
    """The marks of a scene. On the first rank.

    Args:
        solid: the body.
        scene: its scene.
        found: its regions.
        points: (n, 3) all points of the body, m.
        values: the fields of `found` (n, 3) at the points.
    """

    def place_of(place: Place) -> Array:
        if place in found.positions:
            return np.asarray(found.positions[place])
        wanted = np.zeros(3)
        coordinates = place.node if place.node is not None else place.nearest
        wanted[: solid.dimension] = coordinates or ()
        return np.asarray(points[np.argmin(np.linalg.norm(points - wanted, axis=1))])

    supports = _support_marks(scene, values)
    loads = [_load_mark(scene, k, points, values, place_of) for k in range(len(scene.loads))]
    attachments = [
        AttachmentMark(kind, label, place_of(attachment.place))
        for attachment in scene.attachments
        for kind, label in _attached(attachment, found.measures.get(attachment.place, "node"))
    ]
    contacts = []
    places = contact_places(solid.points)
    for k in range(len(scene.contacts)):
        mine = solid.points.contact == k
        label = "contact" if len(scene.contacts) == 1 else f"contact {k + 1}"
        label += _pressed(scene.contacts[k], found.measures)
        inward, first = in_space(solid.points.frame[mine, 0]), int(np.flatnonzero(mine)[0]) + 1
        contacts.append(ContactMark(label, places[mine], inward, first, _round(solid, scene, k)))
    hidden = (scene.contacts and scene.probe is None) or np.isnan(solid.probe_position).any()
    probe = None if hidden else solid.probe_position
    return Marks(supports, loads, attachments, contacts, probe, _rotation_mark(scene))


def _round(solid: Solid, scene: Scene, k: int) -> Grid | None:
    """The round surface of contact k; None of a plane.

    Of a surface that cuts into the undeformed body, none is drawn: a run refuses it.
    """
    if scene.contacts[k].surface is None:
        return None
    try:
        return surface_grid(scene, solid.points, k, 0.0)
    except SceneError:
        return None


def _rotation_mark(scene: Scene) -> RotationMark | None:
    """The axis of rotation, with the sense of the speed."""
    rotation = scene.rotation
    if rotation is None:
        return None
    point = in_space(np.array([rotation.point or np.zeros(scene.geometry.dimension)]))[0]
    axis = np.array(rotation.axis or (0.0, 0.0, 1.0)) / np.linalg.norm(rotation.axis or 1.0)
    sense = -1.0 if rotation.speed_rpm < 0.0 else 1.0
    return RotationMark(abs(rotation.speed_rpm), point, sense * axis)


def _support_marks(scene: Scene, values: Mapping[str, Array]) -> list[SupportMark]:
    """The supports, those with the same directions together."""
    marks: dict[str, SupportMark] = {}
    for k, support in enumerate(scene.supports):
        label, directions = _held(support, scene.geometry.dimension)
        on = values[f"support {k}"][:, 0] > 0.5
        if label in marks:
            on = on | marks[label].on
        marks[label] = SupportMark(label, on, directions)
    return list(marks.values())


def _held(support: Support, d: int) -> tuple[str, Array]:
    """The legend of a support and its held directions (c, 3); empty if the support holds all."""
    if support.normal is not None:
        along = ", ".join(f"{x:.3g}" for x in support.normal)
        return f"held along ({along})", in_space(np.array([support.normal]))
    axes = support.components or tuple("xyz"[:d])
    if len(set(axes)) == d:
        return CLAMPED, np.zeros((0, 3))
    return f"held along {' and '.join(axes)}", np.eye(3)[["xyz".index(axis) for axis in axes]]


def _load_mark(
    scene: Scene, k: int, points: Array, values: Mapping[str, Array], place_of: Any
) -> LoadMark:
    """The mark of a load. A motion of the supports has an arrow at each of them."""
    load = scene.loads[k]
    on: Flags = np.zeros(len(points), dtype=bool)
    if f"load {k}" in values:
        on = values[f"load {k}"][:, 0] > 0.5
    direction = np.zeros(3)
    if load.direction is not None:
        direction[: len(load.direction)] = load.direction
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
        places = place_of(load.place)[None]
    return LoadMark(_load_label(load), places, np.copysign(1.0, load.size) * direction, on)


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


def _pressed(contact: Contact, measures: Mapping[Place, str]) -> str:
    """The preload or the gap of a contact, for the legend."""
    if contact.preload:
        nodes = contact.place.at == "nodes"
        unit = PRELOAD_UNITS[measures[contact.place]] if nodes else "N"
        return f", preload {contact.preload:g} {unit}"
    return f", gap {1e3 * contact.gap:g} mm" if contact.gap else ""


def _attached(attachment: Any, measure: str) -> list[tuple[str, str]]:
    """The kinds and the legends of the parts of an attachment at a region with this measure."""
    per = STIFFNESS_UNITS[measure]
    parts = (
        ("mass", attachment.mass, "kg"),
        ("spring", attachment.stiffness, "N/m"),
        ("spring", attachment.stiffness_per_area, per),
        ("dashpot", attachment.damping, "N s/m"),
        ("dashpot", attachment.damping_per_area, per.replace("N", "N s")),
    )
    along = " in each direction"
    if attachment.components is not None:
        along = f" along {', '.join(attachment.components)}"
    return [
        (kind, f"{kind}, {size:g} {unit}{along * (kind != 'mass')}")
        for kind, size, unit in parts
        if size
    ]


def _is_region(place: Place) -> bool:
    """Whether a place is a region, and not given by the coordinates of a point."""
    return place.node is None and place.nearest is None
