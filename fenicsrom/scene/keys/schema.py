"""The scene, which says what to compute, as frozen dataclasses in SI units.

Every key of the file is one field of a class in this module or in one beside it. The annotation of
the field holds the rule of the key (type, range and unit), and the docstring describes the key. The
reference of all keys and the JSON schema are made from both. A new key is a new field and, if it
depends on other keys, a check in `fenicsrom.scene.checks`. A field without a default is required. A
default that depends on other keys is None here, and `fenicsrom.scene.reading.reading` replaces it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import choice, either, flag, integer, list_of, number
from fenicsrom.scene.base.tables import table_of, tables_of
from fenicsrom.scene.keys import places
from fenicsrom.scene.keys.contacts import Bolt, Contact, Tie, surface_spin
from fenicsrom.scene.keys.curves import Backbone, Response, Ringdown, Statics
from fenicsrom.scene.keys.loads import Load
from fenicsrom.scene.keys.rotation import SPEEDS, Cyclic, Rotation
from fenicsrom.scene.keys.times import SCHEMES, Duration, Time
from fenicsrom.scene.keys.unit_system import Units
from fenicsrom.words import brief

CAD = (".step", ".stp")
"""Suffixes of CAD files."""


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """The mesh and the displacement field on it.

    Attributes:
        mesh: mesh, .geo or .step file, relative to the scene file; or a mesh of the program.
        also: more mesh or .step files with bodies. Their groups have the name of the file before
            their own, such as `pin.3` of pin.step; `pin` are its cells.
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
        glue: whether bodies of a .step file that touch are joined there, or lists of the bodies
            that are. Default: all, without the faces of [[contacts]] and [[ties]] (`against`).
        apart: pairs of the groups of these faces, from [[contacts]] and [[ties]]; no key.
    """

    mesh: Annotated[Path, rules.path]
    dimension: Annotated[int, choice(2, 3)]
    also: Annotated[tuple[Path, ...], list_of(rules.path, 0)] = ()
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
    glue: Annotated[
        bool | tuple[tuple[str, ...], ...] | None, either(flag, list_of(list_of(rules.name, 2)))
    ] = None
    apart: tuple[tuple[str, str], ...] = field(default=(), compare=False)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of the mesh."""
        return self.mesh, *self.also

    @property
    def is_cad(self) -> bool:
        """Whether bodies come from a CAD file, which is meshed here."""
        return any(file.suffix.lower() in CAD for file in self.files)

    @property
    def has_mesh(self) -> bool:
        """Whether bodies come from a mesh file, which has a unit of length."""
        return any(file.suffix.lower() not in (*CAD, ".geo") for file in self.files)


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
class Reference:
    """The models to compare the reduced model with.

    Attributes:
        full: whether to run the full model.
        beam: whether to run the beam model.
        beam_section: the beam that stands for the solid; required with beam = true.
    """

    full: Annotated[bool, flag] = False
    beam: Annotated[bool, flag] = False
    beam_section: Annotated[BeamSection | None, table_of(BeamSection)] = None


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
        compare: models of `fenicsrom compare`; of disks by `modes`, `schemes` and `steps`.
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
    reference: Annotated[Reference, table_of(Reference)] = Reference()
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
    def is_seen(self) -> bool:
        """Whether a place shows how the body moves: the probe, or that of a contact or load."""
        places = [*self.contacts, *(load for load in self.loads if not load.everywhere)]
        return self.probe is not None or bool(places)

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
        frequencies = [load.frequency for load in self.loads if load.frequency]
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
        """Whether the scene has no motion: only equilibria and modes can be computed."""
        return self.period is None and not isinstance(self.time.span, Duration)
