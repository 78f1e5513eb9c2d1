"""The scene, which says what to compute, as frozen dataclasses in SI units.

Every key of the file is one field below. The annotation of the field holds the rule of the key
(type, range and unit), and the docstring describes the key. The reference of all keys and the JSON
schema are made from both. A new key is a new field here and, if it depends on other keys, a check
in `fenicsrom.scene.checks`. A field without a default is required. A default that depends on other
keys is None here, and `fenicsrom.scene.reading.reading` replaces it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from fenicsrom.errors import ErrorKind
from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import (
    Rule,
    Where,
    array,
    choice,
    either,
    flag,
    integer,
    list_of,
    number,
    rows_of,
)
from fenicsrom.scene.base.tables import plain, read_table, table_of, tables_of
from fenicsrom.scene.keys import places
from fenicsrom.scene.keys.curves import Backbone, Response, Ringdown, Statics
from fenicsrom.scene.keys.loads import Load
from fenicsrom.scene.keys.times import SCHEMES, Duration, Time
from fenicsrom.scene.keys.unit_system import Units
from fenicsrom.words import brief


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """The mesh and the displacement field on it.

    Attributes:
        mesh: mesh, .geo or .step file, relative to the scene file; or a mesh of the program.
        dimension: dimension of space.
        cells: cells for a .geo or .step file: quadrilaterals and hexahedra ("structured", default
            of .geo) or triangles and tetrahedra ("simplex"). A structured .step needs bodies of six
            faces with four sides.
        degree: polynomial degree of the displacement.
        thickness: thickness; required in 2D.
        plane: plane stress (default) or plane strain in 2D.
        curved: whether cells are curved (degree 2).
        parameters: numbers for the .geo file, by name.
        size: cell size; required for a .step file.
        meshing: smaller cells on parts of a .step file.
        scale: unit of length of the mesh file; 1 is the unit of [units].
    """

    mesh: Annotated[Path, rules.path]
    dimension: Annotated[int, choice(2, 3)]
    cells: Annotated[str | None, choice("structured", "simplex")] = None
    degree: Annotated[int, choice(1, 2)] = 2
    thickness: Annotated[float | None, number(above=0.0, unit="m")] = None
    plane: Annotated[str | None, choice("stress", "strain")] = None
    curved: Annotated[bool, flag] = False
    parameters: Annotated[dict[str, float], rules.parameters] = field(default_factory=dict)
    size: Annotated[float | None, number(above=0.0, unit="m")] = None
    meshing: Annotated[places.Meshing, table_of(places.Meshing)] = field(
        default_factory=places.Meshing
    )
    scale: Annotated[float, number(above=0.0, unit="m")] = 1.0

    @property
    def is_cad(self) -> bool:
        """Whether the body comes from a CAD file, which is meshed here."""
        return self.mesh.suffix.lower() in (".step", ".stp")


_ORDER = {"type": "integer", "minimum": 1}
_WAVES = rows_of("order", "height", "phase", unit="–, m, rad", first=_ORDER)


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A round rigid surface.

    Attributes:
        kind: shape; in 2D a cylinder is a circle.
        point: a point of the axis, or the centre.
        axis: axis of a cylinder in 3D, of any length.
        inside: whether the body is inside, as a blade in its casing.
        radius: radius. Default: from the gap.
        spin: rate at which a cylinder turns, seen from the body. Default: the casing is at rest.
        waves: waves of a cylinder: each moves the surface towards the body by height · cos(order
            (angle − spin t) − phase). The angle is positive about the axis.
        angle_from: direction from the axis where the angle starts. Default: the middle of the
            contact points.
    """

    kind: Annotated[str, choice("cylinder", "sphere")]
    point: Annotated[tuple[float, ...], rules.point]
    axis: Annotated[tuple[float, ...] | None, rules.direction] = None
    inside: Annotated[bool, flag] = True
    radius: Annotated[float | None, number(above=0.0, unit="m")] = None
    spin: Annotated[float | None, number(unit="rad/s")] = None
    waves: Annotated[tuple[tuple[float, ...], ...], _WAVES] = ()
    angle_from: Annotated[tuple[float, ...] | None, rules.direction] = None


@dataclass(frozen=True, kw_only=True)
class Abradable:
    """A layer on the surface that the body wears, such as the coating of a casing.

    Attributes:
        thickness: thickness of the layer.
        modulus: Young's modulus of the layer.
        yield_stress: stress that crushes the new layer.
        hardening: growth of this stress with plastic strain.
        viscosity: growth of this stress with the rate of plastic strain.
        area: area that presses the layer, of all nodes together. The nodes share it by their area
            or length.
        width: width of the trace along the axis. Default: the distance between the outermost
            points, in 2D the thickness.
        cells: angles of a turning surface at which the worn depth is known.
    """

    thickness: Annotated[float, number(above=0.0, unit="m")]
    modulus: Annotated[float, number(above=0.0, unit="Pa")]
    yield_stress: Annotated[float, number(above=0.0, unit="Pa")]
    hardening: Annotated[float, number(least=0.0, unit="Pa")] = 0.0
    viscosity: Annotated[float, number(least=0.0, unit="N s/m²")] = 0.0
    area: Annotated[float, number(above=0.0, unit="m²")]
    width: Annotated[float | None, number(above=0.0, unit="m")] = None
    cells: Annotated[int, integer(3, 1_000_000)] = 720


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A point, or every node of a region, against a rigid surface or another region of the body.

    With `against`, every node of the facets of a region is a contact point (at = "nodes" says
    nothing more), and the other region moves. The region with the smaller facets comes first.

    With at = "nodes" the preload and both stiffnesses are those of a unit of the region: of an area
    of facets, of a length of edges (a curve in 3D), or of one node of a node set.

    Attributes:
        place: where the contact is.
        normal: unit vector into a rigid plane; not with a surface.
        surface: a round rigid surface instead of the plane.
        against: group of the facets of the other region, which share no node with those of the
            first one; not with normal or surface.
        neighbour: whether `against` is a region of the next sector; only with [cyclic].
        reach: facets at larger distances are not opposite one another; only with `against`.
        abradable: a layer on the surface that the body wears; not with a preload.
        preload: normal force at the undeformed position. With at = "nodes": N/m² on facets, N/m on
            curves in 3D, N for each node of a node set. With `against` the bodies give way under
            it, which leaves a part.
        gap: initial distance, of the nearest node; not with a preload. Default: 0, and with
            `against` and without a preload the distance in the mesh.
        approach: how far the surface has moved towards the body, linear between the times. Default:
            at rest.
        normal_stiffness: stiffness along the normal. With at = "nodes": N/m³ on facets, N/m² on
            curves, N/m for each node; `fenicsrom plan` says which.
        tangential_stiffness: stiffness along the surface, in the same unit.
        friction: coefficient of friction.
    """

    place: Annotated[places.Place, places.Place]
    normal: Annotated[tuple[float, ...] | None, rules.direction] = None
    surface: Annotated[Surface | None, table_of(Surface)] = None
    against: Annotated[str | None, rules.name] = None
    neighbour: Annotated[bool, flag] = False
    reach: Annotated[float | None, number(above=0.0, unit="m")] = None
    abradable: Annotated[Abradable | None, table_of(Abradable)] = None
    preload: Annotated[float, number(least=0.0, unit="N")] = 0.0
    gap: Annotated[float | None, number(least=0.0, unit="m")] = None
    approach: Annotated[
        tuple[tuple[float, ...], ...], rows_of("time", "distance", unit="s, m")
    ] = ()
    normal_stiffness: Annotated[float, number(above=0.0, unit="N/m")]
    tangential_stiffness: Annotated[float, number(above=0.0, unit="N/m")]
    friction: Annotated[float, number(least=0.0)]

    @property
    def has_region(self) -> bool:
        """Whether every node of a region is a contact point."""
        return self.place.at == "nodes" or self.against is not None


@dataclass(frozen=True, kw_only=True)
class Bolt:
    """A bolt that pulls two regions together along the line between their centres.

    The force stays constant. In a geometrically nonlinear scene its direction follows the regions.

    Attributes:
        head: group of the facets under the head.
        nut: group of the facets under the nut.
        force: tension.
    """

    head: Annotated[str, rules.name]
    nut: Annotated[str, rules.name]
    force: Annotated[float, number(above=0.0, unit="N")]


@dataclass(frozen=True, kw_only=True)
class Tie:
    """Two regions without common nodes that move as one, as part of the structure.

    The region with the smaller facets comes first.

    Attributes:
        group: group of the facets of one region.
        against: group of the facets of the other one.
        reach: facets at larger distances are not tied. Default: a tenth of a facet.
    """

    group: Annotated[str, rules.name]
    against: Annotated[str, rules.name]
    reach: Annotated[float | None, number(above=0.0, unit="m")] = None


@dataclass(frozen=True, kw_only=True)
class Range:
    """Equally spaced values.

    Attributes:
        first: first value.
        last: last value.
        number: number of values.
    """

    first: Annotated[float, number(least=0.0, unit="rev/min")]
    last: Annotated[float, number(above=0.0, unit="rev/min")]
    number: Annotated[int, integer(2, 10_000)]


def _read_speeds(value: Any, where: Where) -> tuple[float, ...]:
    """Give ascending speeds from a list or from a table of first, last and number."""
    if isinstance(value, Mapping):
        span = read_table(Range, value, where)
        if span.last <= span.first:
            raise where.at("last").refuse(span.last, f"must be above first, {span.first:g}")
        step = (span.last - span.first) / (span.number - 1)
        return (*(span.first + k * step for k in range(span.number - 1)), span.last)
    if not rules.is_sequence(value) or len(value) < 2:
        allowed = "must be a list of at least two speeds, or a table of first, last and number"
        raise where.refuse(value, allowed, ErrorKind.TYPE)
    speeds = tuple(number(least=0.0)(entry, where.at(index)) for index, entry in enumerate(value))
    for index in range(1, len(speeds)):
        if speeds[index] <= speeds[index - 1]:
            allowed = f"must be above the previous speed, {speeds[index - 1]:g}"
            raise where.at(index).refuse(value[index], allowed)
    return speeds


SPEEDS = Rule(
    _read_speeds,
    {"oneOf": [array({"type": "number", "minimum": 0}, 2), {"kind": Range}]},
    "ascending list of numbers, or { first, last, number }",
    "rev/min",
)


@dataclass(frozen=True, kw_only=True)
class Rotation:
    """A rotation about a fixed axis.

    The scene, its loads and its surfaces are described in the frame that turns with the body.

    Attributes:
        speed_rpm: speed, positive about the axis; a run with `history` ignores it.
        axis: axis in 3D, of any length.
        point: a point of the axis. Default: the origin.
        coriolis: whether the Coriolis force acts.
        speeds_rpm: speeds for the basis of one model for a range of speeds, two or three as a rule.
            Default: one model for `speed_rpm`.
        history: speeds of a run over time, linear between the rows, constant after the last one,
            inside `speeds_rpm`.
    """

    speed_rpm: Annotated[float, number(unit="rev/min")]
    axis: Annotated[tuple[float, ...] | None, rules.direction] = None
    point: Annotated[tuple[float, ...] | None, rules.point] = None
    coriolis: Annotated[bool, flag] = False
    speeds_rpm: Annotated[tuple[float, ...] | None, SPEEDS] = None
    history: Annotated[
        tuple[tuple[float, ...], ...], rows_of("time", "speed", unit="s, rev/min")
    ] = ()

    @property
    def omega(self) -> float:
        """Angular velocity in rad/s."""
        return math.pi / 30.0 * self.speed_rpm


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """Random differences between the sectors of a disk.

    Attributes:
        deviation: standard deviation of the relative changes of stiffness.
        seed: seed of the random numbers.
    """

    deviation: Annotated[float, number(least=0.0, below=0.3)]
    seed: Annotated[int, integer(0, 2**31 - 1)] = 0


@dataclass(frozen=True, kw_only=True)
class Cyclic:
    """A disk of which the mesh is one sector, for `fenicsrom modes`, `campbell` and `run`.

    Loads, contacts, supports and attachments are in every sector alike, turned with it.

    Attributes:
        sectors: number of sectors of the disk.
        left: group of facets of one cut face.
        right: group of facets of the other cut face: the left one turned by 360°/sectors.
        axis: axis of the disk in 3D, of any length. Default: that of [rotation].
        point: a point of the axis. Default: that of [rotation], or the origin.
        diameters: nodal diameters. Default: 0 to 12, or to half the number of sectors.
        mistuning: relative changes of the stiffness of all sectors in a run, or their deviation and
            seed. Default: none.
    """

    sectors: Annotated[int, integer(3, 1000)]
    left: Annotated[str, rules.name]
    right: Annotated[str, rules.name]
    axis: Annotated[tuple[float, ...] | None, rules.direction] = None
    point: Annotated[tuple[float, ...] | None, rules.point] = None
    diameters: Annotated[tuple[int, ...] | None, list_of(integer(0, 500))] = None
    mistuning: Annotated[
        tuple[float, ...] | Deviation | None,
        either(list_of(number(above=-1.0), distinct=False), table_of(Deviation)),
    ] = None


def surface_turns(surface: Surface, rotation: Rotation | None) -> float:
    """The angle by which a surface turns for each radian of the body, as the body sees it."""
    if surface.spin is not None or rotation is None or surface.kind == "sphere":
        return 0.0
    about = 1.0
    if surface.axis is not None and rotation.axis is not None:
        about = sum(a * b for a, b in zip(surface.axis, rotation.axis, strict=True))
    return -about if abs(about) > 1.0 - 1e-9 else 0.0


def surface_spin(surface: Surface, rotation: Rotation | None) -> float:
    """Rate (rad/s) at which a surface turns about its axis, as the body sees it."""
    omega = 0.0 if rotation is None else rotation.omega
    return (surface.spin or 0.0) + surface_turns(surface, rotation) * omega


METHODS = ("rubin", "craig-bampton")
COMPARED = ("none", "principal", "mmi", "mmi-nls", "all")
"""Selections of derivatives that `fenicsrom compare` takes by default."""
_FORCE = choice("polynomial", "projection")


@dataclass(frozen=True, kw_only=True)
class Basis:
    """The reduction basis.

    Attributes:
        method: method of component mode synthesis.
        modes: number of normal modes. "auto": up to twice the highest excited frequency and one
            more; 3 to 12 modes (100 in a linear scene).
        derivatives: modal derivatives: along the principal directions of the motion ("principal"),
            along pairs of modes ("mmi", "mmi-nls", "all"), or labels. "all" also takes derivatives
            of modes along the static shapes of loads that change the stiffness.
        masters: contact forces with static modes: "all" directions, the "normal" ones, a number
            of interface modes, or those of the "motion" of bodies that touch. Default: "motion"
            with `contacts.against`; else "all" for up to 8 contacts at points (4 with pairs of
            modes), else 10.
        accuracy: largest accepted estimated error by the basis. With "principal" derivatives, the
            basis takes coordinates until it is reached.
        size: number of coordinates, with contact displacements, in place of `accuracy`. Needs
            "principal" derivatives and a polynomial force.
        threshold: smallest relative weight of a derivative (mmi and mmi-nls), and smallest
            amplitude of a mode.
        differentiation: derivative of the tangent.
        elastic_force: an exact polynomial without the mesh, or the projection of the full force.
    """

    method: Annotated[str, choice(*METHODS)] = "rubin"
    modes: Annotated[str | int, rules.modes] = "auto"
    masters: Annotated[str | int | None, rules.masters] = None
    derivatives: Annotated[str | tuple[str, ...], rules.derivatives] = "principal"
    accuracy: Annotated[float, number(above=0.0, most=1.0)] = 1e-3
    size: Annotated[int | None, integer(1, 1000)] = None
    threshold: Annotated[float, number(least=0.0, most=1.0)] = 1e-4
    differentiation: Annotated[str, choice("exact", "central-difference")] = "exact"
    elastic_force: Annotated[str, _FORCE] = "polynomial"

    @property
    def adapts(self) -> bool:
        """Whether the basis takes coordinates by `accuracy` or `size`."""
        return self.derivatives == "principal" and self.elastic_force == "polynomial"


@dataclass(frozen=True, kw_only=True)
class BeamSection:
    """The planar Timoshenko beam of rectangular section that stands for the solid.

    Attributes:
        length: length of the beam.
        height: height in the direction of bending.
        width: width of the section.
        elements: number of two-node elements.
        load_at: place of the load, as a fraction of the length.
    """

    length: Annotated[float, number(above=0.0, unit="m")]
    height: Annotated[float, number(above=0.0, unit="m")]
    width: Annotated[float, number(above=0.0, unit="m")]
    elements: Annotated[int, integer(1, 10_000)] = 20
    load_at: Annotated[float, number(above=0.0, most=1.0)]


@dataclass(frozen=True, kw_only=True)
class ReferenceTable:
    """The table [reference] of the file.

    Attributes:
        full: whether to run the full model.
        beam: whether to run the beam model.
        beam_section: the beam that stands for the solid; required with beam = true.
    """

    full: Annotated[bool, flag] = False
    beam: Annotated[bool, flag] = False
    beam_section: Annotated[BeamSection | None, table_of(BeamSection)] = None


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The models to compare the reduced model with.

    Attributes:
        full: whether to run the full solid model.
        beam: the beam to run, or None.
    """

    full: bool = False
    beam: BeamSection | None = None

    def as_table(self) -> dict[str, Any]:
        """Give the table of the file."""
        section = {} if self.beam is None else {"beam_section": plain(self.beam)}
        return {"full": self.full, "beam": self.beam is not None, **section}


def _read_reference(value: Any, where: Where) -> Reference:
    table = read_table(ReferenceTable, value, where)
    if table.beam and table.beam_section is None:
        raise where.at("beam_section").refuse(MISSING, "must be a table with beam = true")
    return Reference(full=table.full, beam=table.beam_section if table.beam else None)


@dataclass(frozen=True, kw_only=True)
class Output:
    """The files to write besides the summary, report, history and reduced model.

    Attributes:
        pictures: PNG pictures.
        paraview: ParaView files of modes and derivatives.
        motion: ParaView files of the last period, with the contact points.
        animation: a moving picture of the last period.
        stresses: elastic stresses and reactions, in tables, pictures and the stored model. Viscous
            forces are in the reactions, not in the stresses.
        sectors: sectors of a disk, from 0, whose stresses and motion are written.
    """

    pictures: Annotated[bool, flag] = True
    paraview: Annotated[bool, flag] = True
    motion: Annotated[bool, flag] = False
    animation: Annotated[bool, flag] = False
    stresses: Annotated[str, choice("none", "second-piola-kirchhoff", "cauchy")] = "none"
    sectors: Annotated[str | tuple[int, ...], either(choice("all"), list_of(integer(0, 999)))] = (
        "all"
    )


@dataclass(frozen=True, kw_only=True)
class Compare:
    """The models of `fenicsrom compare`: every combination of these lists.

    Attributes:
        full: whether to run the full model. Without it, residuals rank the bases.
        methods: values of `basis.method`.
        derivatives: values of `basis.derivatives`.
        modes: values of `basis.modes`.
        sizes: values of `basis.size`, besides the size by `basis.accuracy`.
        elastic_force: values of `basis.elastic_force`.
        schemes: values of `time.scheme`. Default: that of [time].
        meshes: changes of the mesh in SI units. The full model keeps the mesh of the scene.
        steps: values of `time.steps_per_period`. The full model keeps that of [time].
    """

    full: Annotated[bool, flag] = True
    methods: Annotated[tuple[str, ...], list_of(choice(*METHODS))] = METHODS
    derivatives: Annotated[tuple[str | tuple[str, ...], ...], list_of(rules.derivatives)] = COMPARED
    modes: Annotated[tuple[int, ...], list_of(integer(0, 1000))] = (1, 2, 3, 5)
    sizes: Annotated[tuple[int, ...] | None, list_of(integer(1, 1000))] = None
    elastic_force: Annotated[tuple[str, ...], list_of(_FORCE)] = ("polynomial",)
    schemes: Annotated[tuple[str, ...] | None, list_of(choice(*SCHEMES))] = None
    meshes: Annotated[tuple[str, ...] | None, list_of(rules.mesh_change)] = None
    steps: Annotated[tuple[int, ...] | None, list_of(integer(4, 1_000_000))] = None


@dataclass(frozen=True, kw_only=True)
class Campbell:
    """The diagram of `fenicsrom campbell`.

    Attributes:
        speeds_rpm: speeds. Default: 13 from rest to that of [rotation], or over its range.
        modes: number of modes, from the lowest one at the first speed. Default: 6.
        engine_orders: excitations per revolution.
    """

    speeds_rpm: Annotated[tuple[float, ...] | None, SPEEDS] = None
    modes: Annotated[int | None, integer(1, 1000)] = None
    engine_orders: Annotated[tuple[int, ...], list_of(integer(1, 1000))] = (1, 2, 3, 4)


@dataclass(frozen=True, kw_only=True)
class Map:
    """The interaction map of `fenicsrom map`.

    Attributes:
        speeds_rpm: speeds. Default: 40 over the range of [rotation].
        revolutions: revolutions at each speed.
        last: revolutions at the end that are shown: a resolution of 1 / last engine order.
        orders: highest engine order.
        start: start of a speed: at rest, or where the next lower ("up") or higher ("down") speed
            ended.
        steady: "march" makes all revolutions, and tries Newton's method where the motion does not
            repeat. "newton" ends in a stable periodic motion as soon as it finds one.
        clearance: where `contacts.gap` holds: on the undeformed body (one casing for all speeds),
            or at each speed.
    """

    speeds_rpm: Annotated[tuple[float, ...] | None, SPEEDS] = None
    revolutions: Annotated[int, integer(2, 1_000_000)] = 100
    last: Annotated[int, integer(2, 1000)] = 20
    orders: Annotated[int, integer(1, 1000)] = 20
    start: Annotated[str, choice("rest", "up", "down")] = "rest"
    steady: Annotated[str, choice("march", "newton")] = "march"
    clearance: Annotated[str, choice("at rest", "at speed")] = "at rest"


@brief("title", "source", "geometry", "material", "supports", "loads", "contacts", "basis", "time")
@dataclass(frozen=True, kw_only=True, repr=False)
class Scene:
    """Everything a run needs to know.

    Make a scene with `read_scene`, `make_scene` or `parse_scene`: they check it and fill in the
    defaults. A dataclass that is constructed directly is not checked.

    Attributes:
        units: units of the numbers.
        title: title of the report; a key in braces, such as {loads.0.force}, stands for its value.
        geometrically_nonlinear: whether displacements may be large.
        geometry: the mesh.
        material: the material of cells that are in no group of `materials`.
        materials: materials of groups of cells.
        supports: where the body is held. `supports = []`, above all tables, leaves it
            on its springs, or free: displacements then are relative to its rigid motions.
        attachments: concentrated masses, springs and dashpots.
        loads: what acts on the body: one action and one history.
        contacts: contact points.
        bolts: bolts that press parts of the body on one another.
        ties: regions that are glued although their meshes do not match.
        rotation: without this table the body does not rotate.
        cyclic: without this table the mesh is the whole body.
        damping: damping besides that of the material.
        probe: the place whose motion gives the amplitudes in a scene without contact. Default: the
            place of the first load.
        basis: the reduction basis.
        time: the time integration.
        reference: the models with which the reduced model is compared.
        output: the files to write.
        compare: models of `fenicsrom compare`.
        campbell: diagram of `fenicsrom campbell`.
        map: interaction map of `fenicsrom map`.
        response: curves of `fenicsrom response`.
        backbone: nonlinear mode of `fenicsrom backbone`.
        ringdown: free decay of `fenicsrom ringdown`.
        statics: equilibrium path of `fenicsrom statics`.
        source: the file of the scene.
    """

    units: Annotated[Units, table_of(Units)] = field(default_factory=Units)
    title: Annotated[str, rules.text] = ""
    geometrically_nonlinear: Annotated[bool, flag] = True
    geometry: Annotated[Geometry, table_of(Geometry)]
    material: Annotated[places.Material, table_of(places.Material)]
    materials: Annotated[tuple[places.GroupMaterial, ...], tables_of(places.GroupMaterial)] = ()
    supports: Annotated[tuple[places.Support, ...], tables_of(places.Support)]
    attachments: Annotated[tuple[places.Attachment, ...], tables_of(places.Attachment)] = ()
    loads: Annotated[tuple[Load, ...], tables_of(Load)] = ()
    contacts: Annotated[tuple[Contact, ...], tables_of(Contact)] = ()
    bolts: Annotated[tuple[Bolt, ...], tables_of(Bolt)] = ()
    ties: Annotated[tuple[Tie, ...], tables_of(Tie)] = ()
    rotation: Annotated[Rotation | None, table_of(Rotation)] = None
    cyclic: Annotated[Cyclic | None, table_of(Cyclic)] = None
    damping: Annotated[places.Damping, table_of(places.Damping)] = field(
        default_factory=places.Damping
    )
    probe: Annotated[places.Place | None, table_of(places.Place)] = None
    basis: Annotated[Basis, table_of(Basis)] = Basis()
    time: Annotated[Time, table_of(Time)] = field(default_factory=Time)
    reference: Annotated[Reference, Rule(_read_reference, {"kind": ReferenceTable}, "table")] = (
        Reference()
    )
    output: Annotated[Output, table_of(Output)] = Output()
    compare: Annotated[Compare, table_of(Compare)] = Compare()
    campbell: Annotated[Campbell, table_of(Campbell)] = Campbell()
    map: Annotated[Map, table_of(Map)] = Map()
    response: Annotated[Response | None, table_of(Response)] = None
    backbone: Annotated[Backbone | None, table_of(Backbone)] = None
    ringdown: Annotated[Ringdown, table_of(Ringdown)] = field(default_factory=Ringdown)
    statics: Annotated[Statics, table_of(Statics)] = field(default_factory=Statics)
    source: str = ""

    @property
    def joined(self) -> bool:
        """Whether there are contacts between bodies."""
        return any(contact.against is not None for contact in self.contacts)

    @property
    def period(self) -> float | None:
        """Period of the excitation in s.

        It is that of the lowest frequency of the loads. Where no load varies and no duration is
        given, it is the time in which the surfaces with waves turn once. The period is None if
        nothing repeats, if a load does not repeat, or if the speed of rotation varies.
        """
        if self.rotation is not None and self.rotation.history:
            return None
        if any(load.transient for load in self.loads):
            return None
        frequencies = [load.frequency for load in self.loads if load.frequency is not None]
        if frequencies:
            return 1.0 / min(frequencies)
        spins = {
            abs(surface_spin(contact.surface, self.rotation))
            for contact in self.contacts
            if contact.surface is not None and any(height for _, height, _ in contact.surface.waves)
        }
        turns = len(spins) == 1 and not isinstance(self.time.span, Duration)
        return 2.0 * math.pi / max(spins) if turns and max(spins) > 0.0 else None

    @property
    def speeds_rpm(self) -> tuple[float, ...] | None:
        """The speeds of the basis of one model for a range of speeds; None of one for one speed."""
        return None if self.rotation is None else self.rotation.speeds_rpm

    def at_speed(self, speed_rpm: float) -> Scene:
        """The scene at another speed of rotation, with the engine orders at a speed above 0."""
        assert self.rotation is not None
        loads = self.loads
        if speed_rpm != 0.0:
            loads = tuple(load.at_speed(speed_rpm) for load in loads)
        return replace(self, rotation=replace(self.rotation, speed_rpm=speed_rpm), loads=loads)

    @property
    def followers(self) -> tuple[int, ...]:
        """The numbers, from 0, of the pressures that follow the deformation."""
        return tuple(k for k, load in enumerate(self.loads) if load.follower)

    @property
    def viscous(self) -> bool:
        """Whether there is damping besides the mass-proportional one."""
        return self.damping.viscous or any(found.viscous for found in self.attachments)

    @property
    def damped(self) -> bool:
        """Whether there is any damping."""
        return self.viscous or self.material.mass_damping > 0.0

    @property
    def velocity_forces(self) -> bool:
        """Whether forces besides the mass-proportional damping depend on the velocity."""
        return self.viscous or (self.rotation is not None and self.rotation.coriolis)

    @property
    def wears(self) -> bool:
        """Whether a surface has an abradable layer."""
        return any(contact.abradable is not None for contact in self.contacts)

    @property
    def static_only(self) -> bool:
        """Whether only the equilibrium is computed.

        There is no contact, all loads are static, the speed is constant and no duration is given.
        """
        return (
            not self.contacts
            and all(load.static for load in self.loads)
            and not isinstance(self.time.span, Duration)
            and not (self.rotation is not None and self.rotation.history)
        )
