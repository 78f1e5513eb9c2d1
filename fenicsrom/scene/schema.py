"""Scenes: what to compute, as frozen dataclasses read from TOML and checked. All quantities are in
SI units.

Every key of the file is one field below, annotated with its rule (type and range): a new key is a
new line. A field without a default is required; a default of None is filled in by `_complete` from
the rest of the scene.
"""

from __future__ import annotations

import copy
import difflib
import functools
import json
import math
import os
import re
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from fenicsrom.errors import SceneError
from fenicsrom.scene.paths import shared_meshes

MOST_ROWS = 1_000_000  # of a table of a load
FEW_CONTACTS = 4  # of which every displacement is a coordinate of the basis
INTERFACE_MODES = 10  # in place of those where there are more


@dataclass(frozen=True)
class _Where:
    """A place in a scene: the file and the dotted key, for messages."""

    source: str
    key: str = ""

    def at(self, name: object) -> _Where:
        """The place of an entry (an integer: of a list; a name: of a table) below this one."""
        if isinstance(name, int):
            return replace(self, key=f"{self.key}[{name}]")
        return replace(self, key=f"{self.key}.{name}" if self.key else str(name))

    def refuse(self, value: object, allowed: str) -> SceneError:
        """The error that `value` (or `MISSING`) does not stand here, in one line."""
        what = "is missing" if value is MISSING else f"= {_show(value)}"
        return _error(f"{self.source}: {self.key} {what}: {allowed}")


def _error(sentence: str) -> SceneError:
    """A SceneError of one printable line, whatever the names and values in it contain."""
    return SceneError("".join(c if c.isprintable() else ascii(c)[1:-1] for c in sentence))


def _show(value: object, width: int = 60) -> str:
    """A value as the scene file spells it, shortened to `width` characters."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except (
        ValueError,
        TypeError,
        RecursionError,
    ):  # integers of thousands of digits, tables within themselves
        text = f"({type(value).__name__})"
    return text if len(text) <= width else text[: width - 1] + "…"


# Rules: a rule takes what stands in the file and its place, and returns what the field holds or
# raises SceneError.

Rule = Callable[[Any, _Where], Any]


def _is_number(value: object) -> bool:
    """Whether a value is a finite number that a float can hold; true and false are not numbers."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def _number(
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
) -> Rule:
    """A finite number in a range."""
    bounds = {"above": above, "of at least": least, "below": below, "of at most": most}
    limits = " and ".join(
        f"{word} {bound:g}" for word, bound in bounds.items() if math.isfinite(bound)
    )
    allowed = f"must be a finite number {limits}".rstrip()

    def rule(value: Any, where: _Where) -> float:
        if not (_is_number(value) and above < value < below and least <= value <= most):
            raise where.refuse(value, allowed)
        return float(value)

    return rule


def _integer(least: int, most: int) -> Rule:
    """An integer in a range, ends included."""

    def rule(value: Any, where: _Where) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
            raise where.refuse(value, f"must be an integer from {least} to {most}")
        return int(value)

    return rule


def _choice(*options: str | int) -> Rule:
    """One of the options."""

    def rule(value: Any, where: _Where) -> Any:
        for option in options:
            if type(value) is type(option) and value == option:
                return option
        raise where.refuse(value, f"must be {' or '.join(_show(option) for option in options)}")

    return rule


def _flag(value: Any, where: _Where) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise where.refuse(value, "must be true or false")
    return value


def _text(value: Any, where: _Where) -> str:
    """Any text."""
    if not isinstance(value, str):
        raise where.refuse(value, "must be a text in quotes")
    return value


def _name(value: Any, where: _Where) -> str:
    """A text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise where.refuse(value, "must be a name in quotes")
    return value


def _path(value: Any, where: _Where) -> Path:
    """The path of a file, found later."""
    return Path(_name(value, where))


def _point(value: Any, where: _Where) -> tuple[float, ...]:
    """Two or three coordinates; which of both is checked against the dimension later."""
    if (
        not isinstance(value, list | tuple)
        or len(value) not in (2, 3)
        or not all(map(_is_number, value))
    ):
        raise where.refuse(value, "must be a list of as many finite numbers as the dimension")
    return tuple(float(component) for component in value)


def _box(value: Any, where: _Where) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The lowest and the highest corner of a box, from any two opposite ones."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise where.refuse(value, "must be two opposite corners, [[x, y, z], [x, y, z]]")
    one, other = (_point(corner, where.at(index)) for index, corner in enumerate(value))
    if len(one) != len(other):
        raise where.refuse(value, "must be two corners of the same number of coordinates")
    return tuple(map(min, one, other)), tuple(map(max, one, other))


def _direction(value: Any, where: _Where) -> tuple[float, ...]:
    """A vector, scaled to unit length (and left alone, to the bit, where it has it)."""
    vector = _point(value, where)
    largest = max(map(abs, vector))
    if largest == 0.0:
        raise where.refuse(value, "must have a length above zero")
    if abs(math.hypot(*vector) - 1.0) <= 1e-14:
        return vector
    scaled = [component / largest for component in vector]
    return tuple(component / math.hypot(*scaled) for component in scaled)


def _parameters(value: Any, where: _Where) -> dict[str, float]:
    """Numbers by name; a name becomes a variable of the .geo file, so it must look like one."""
    if not isinstance(value, Mapping):
        raise where.refuse(value, "must be a table of numbers")
    for name, entry in value.items():
        if not re.fullmatch(r"[A-Za-z_][A-Za-z_0-9]*", str(name)):
            raise where.at(name).refuse(
                entry, "a parameter's name must be of letters, digits and underscores"
            )
    return {str(name): _number()(entry, where.at(name)) for name, entry in value.items()}


def _harmonics(value: Any, where: _Where) -> tuple[tuple[int, float, float], ...]:
    """Harmonics of one frequency, each with an order of its own."""
    if not isinstance(value, list | tuple) or not value:
        raise where.refuse(value, "must be a list of harmonics, each [order, amplitude, phase]")
    found: list[tuple[int, float, float]] = []
    for index, entry in enumerate(value):
        if not isinstance(entry, list | tuple) or len(entry) != 3:
            raise where.at(index).refuse(entry, "must be [order, amplitude, phase]")
        order = _integer(1, 1000)(entry[0], where.at(index).at(0))
        if order in (other for other, *_ in found):
            raise where.at(index).at(0).refuse(order, "must not stand in the list twice")
        amplitude, phase = (_number()(entry[k], where.at(index).at(k)) for k in (1, 2))
        found.append((order, amplitude, phase))
    return tuple(found)


def _series(value: Any, where: _Where) -> Path | tuple[tuple[float, float], ...]:
    """A function of time: the path of a file, read later, or its rows."""
    if isinstance(value, str):
        return _path(value, where)
    if not isinstance(value, list | tuple):
        raise where.refuse(value, "must be the name of a file, or rows [time, factor]")
    return _rows(value, where, where.at)


def _rows(
    rows: Sequence[Any], where: _Where, place: Callable[[int], _Where]
) -> tuple[tuple[float, float], ...]:
    """The rows of a function of time, checked; `place` says where a row stands."""
    if not 2 <= len(rows) <= MOST_ROWS:
        raise where.refuse(len(rows), f"the number of rows must be from 2 to {MOST_ROWS}")
    found: list[tuple[float, float]] = []
    for index, row in enumerate(rows):
        if not isinstance(row, list | tuple) or len(row) != 2 or not all(map(_is_number, row)):
            raise place(index).refuse(row, "must be two finite numbers, time in s and factor")
        found.append((float(row[0]), float(row[1])))
        if index and not found[-1][0] > found[-2][0]:
            allowed = f"times must increase from row to row, and the one before is {found[-2][0]:g}"
            raise place(index).refuse(found[-1][0], allowed)
    return tuple(found)


def _label(value: Any, where: _Where) -> str:
    """The label of a modal derivative in its one spelling: V before S, lower numbers first (1S2V
    becomes 2V1S).
    """
    match = (
        re.fullmatch(r"([0-9]{1,6})([VS])([0-9]{1,6})([VS])", value)
        if isinstance(value, str)
        else None
    )
    if match is None or not int(match[1]) or not int(match[3]):
        raise where.refuse(
            value,
            'must be two modes such as "1V1V" or "1V2S", counted from 1, V normal and S static',
        )
    pair = sorted([("VS".index(match[2]), int(match[1])), ("VS".index(match[4]), int(match[3]))])
    return "".join(f"{number}{'VS'[kind]}" for kind, number in pair)


def _masters(value: Any, where: _Where) -> str | int:
    """Which contact directions are masters."""
    if value in ("all", "normal"):
        return str(value)
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 1000:
        raise where.refuse(value, 'must be "all", "normal" or an integer from 1 to 1000')
    return int(value)


def _derivatives(value: Any, where: _Where) -> str | tuple[str, ...]:
    """A way of choosing derivatives, or their labels."""
    if value in ("none", "all", "mmi", "mmi-nls"):
        return str(value)
    if not isinstance(value, list | tuple):
        raise where.refuse(
            value, 'must be "none", "all", "mmi", "mmi-nls" or a list of labels such as "1V1S"'
        )
    labels = tuple(_label(entry, where.at(index)) for index, entry in enumerate(value))
    for index, label in enumerate(labels):
        if label in labels[:index]:
            raise where.at(index).refuse(value[index], "must not name the same derivative twice")
    return labels


def _table(kind: type) -> Rule:
    """A table whose keys are the fields of a dataclass."""

    def rule(value: Any, where: _Where) -> Any:
        if not isinstance(value, Mapping):
            raise where.refuse(value, "must be a table")
        known = _names(kind)
        for name, entry in value.items():
            if name not in known:
                near = difflib.get_close_matches(str(name)[:100], known, n=1)
                hint = f"did you mean {near[0]}?" if near else f"known here are {', '.join(known)}"
                raise where.at(name).refuse(entry, f"unknown key, {hint}")
        return _build(kind, value, where)

    return rule


def _speeds(value: Any, where: _Where) -> tuple[float, ...]:
    """Ascending speeds: a list, or the first, the last and how many, at equal distances."""
    if isinstance(value, Mapping):
        span: _Span = _table(_Span)(value, where)
        if span.last <= span.first:
            raise where.at("last").refuse(span.last, f"must be above first, {span.first:g}")
        step = (span.last - span.first) / (span.number - 1)
        return (*(span.first + k * step for k in range(span.number - 1)), span.last)
    if not isinstance(value, list | tuple) or len(value) < 2:
        raise where.refuse(
            value, "must be a list of at least two speeds, or a table of first, last and number"
        )
    speeds = tuple(_number(least=0.0)(entry, where.at(index)) for index, entry in enumerate(value))
    for index in range(1, len(speeds)):
        if speeds[index] <= speeds[index - 1]:
            raise where.at(index).refuse(
                value[index], f"must be above the speed before it, {speeds[index - 1]:g}"
            )
    return speeds


def _list(rule: Rule) -> Rule:
    """A list of different values, at least one."""

    def listed(value: Any, where: _Where) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or not value:
            raise where.refuse(value, "must be a list of at least one value")
        values = tuple(rule(entry, where.at(index)) for index, entry in enumerate(value))
        for index, entry in enumerate(values):
            if entry in values[:index]:
                raise where.at(index).refuse(value[index], "must not stand in the list twice")
        return values

    return listed


def _numbers(*names: str) -> Rule:
    """A list of rows of so many numbers each."""
    allowed = f"must be a list of [{', '.join(names)}], finite numbers"

    def rule(value: Any, where: _Where) -> tuple[tuple[float, ...], ...]:
        if not isinstance(value, list | tuple):
            raise where.refuse(value, allowed)
        for index, row in enumerate(value):
            if (
                not isinstance(row, list | tuple)
                or len(row) != len(names)
                or not all(map(_is_number, row))
            ):
                raise where.at(index).refuse(row, f"must be [{', '.join(names)}], finite numbers")
        return tuple(tuple(float(entry) for entry in row) for row in value)

    return rule


def _tables(kind: type, least: int = 0) -> Rule:
    """A list of such tables."""

    def rule(value: Any, where: _Where) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or len(value) < least:
            number = "at least one table" if least else "tables"
            raise where.refuse(value, f"must be a list of {number}, each headed [[{where.key}]]")
        return tuple(_table(kind)(entry, where.at(index)) for index, entry in enumerate(value))

    return rule


@functools.cache
def _rules(kind: type) -> dict[str, Any]:
    """The rule of each field of a dataclass that is a key; a dataclass for a rule: its keys stand
    in the same table.
    """
    hints = get_type_hints(kind, include_extras=True)
    return {
        name: hint.__metadata__[0] for name, hint in hints.items() if hasattr(hint, "__metadata__")
    }


def _names(kind: type) -> list[str]:
    """The keys of the table of a dataclass."""
    return [
        key
        for name, rule in _rules(kind).items()
        for key in (_names(rule) if isinstance(rule, type) else [name])
    ]


def _build(kind: type, table: Mapping[str, Any], where: _Where) -> Any:
    """The dataclass a table describes; keys of other dataclasses in it are passed over."""
    values = {}
    required = {
        item.name for item in fields(kind) if item.default is item.default_factory is MISSING
    }
    for name, rule in _rules(kind).items():
        if isinstance(rule, type):
            values[name] = _build(rule, table, where)
        elif name in table or name in required:
            values[name] = rule(table.get(name, MISSING), where.at(name))
    return kind(**values)


def _plain(value: Any) -> Any:
    """The inverse of the rules: plain data; what is None is left out."""
    if is_dataclass(value) and not isinstance(value, type):
        table: dict[str, Any] = {}
        for name, rule in _rules(type(value)).items():
            entry = getattr(value, name)
            if isinstance(rule, type):
                table |= _plain(entry)
            elif entry is not None:
                table[name] = _plain(entry)
        return table
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, dict):
        return dict(value)
    return str(value) if isinstance(value, Path) else value


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """The mesh and the displacement field on it.

    Attributes:
        mesh: path of the mesh or of the .geo or .step file it is made from.
        dimension: 2 or 3.
        cells: "structured" (quadrilaterals, hexahedra) or "simplex"; None unless the mesh is made
        from a .geo file.
        degree: degree of the displacement, 1 or 2.
        thickness: thickness in m; None in 3D.
        plane: "stress" or "strain"; None in 3D.
        curved: whether cells are curved (geometry of degree 2).
        parameters: numbers handed to the .geo file, by name.
        size: size of the cells a .step file is meshed with, in m; None for every other file.
        scale: length in m of the unit of the coordinates in a mesh file.
    """

    mesh: Annotated[Path, _path]
    dimension: Annotated[int, _choice(2, 3)]
    cells: Annotated[str | None, _choice("structured", "simplex")] = None
    degree: Annotated[int, _choice(1, 2)] = 2
    thickness: Annotated[float | None, _number(above=0.0)] = None
    plane: Annotated[str | None, _choice("stress", "strain")] = None
    curved: Annotated[bool, _flag] = False
    parameters: Annotated[dict[str, float], _parameters] = field(default_factory=dict)
    size: Annotated[float | None, _number(above=0.0)] = None
    scale: Annotated[float, _number(above=0.0)] = 1.0


@dataclass(frozen=True, kw_only=True)
class Material:
    """A St Venant–Kirchhoff material with mass-proportional damping C = α M.

    Attributes:
        young: Young's modulus in Pa.
        poisson: Poisson's ratio.
        density: density in kg/m³.
        mass_damping: α in 1/s.
    """

    young: Annotated[float, _number(above=0.0)]
    poisson: Annotated[float, _number(least=0.0, below=0.5)]
    density: Annotated[float, _number(above=0.0)]
    mass_damping: Annotated[float, _number(least=0.0)] = 0.0


@dataclass(frozen=True, kw_only=True)
class Plane:
    """A plane to pick facets with.

    Attributes:
        point: coordinates in m of a point of it.
        normal: unit vector.
        tolerance: distance in m that still counts as on the plane; None for 1e-6 of the extent of
            the mesh.
    """

    point: Annotated[tuple[float, ...], _point]
    normal: Annotated[tuple[float, ...], _direction]
    tolerance: Annotated[float | None, _number(above=0.0)] = None


@dataclass(frozen=True, kw_only=True)
class Region:
    """A part of the solid, by its name or picked by coordinates; all but one are None.

    Attributes:
        group: name of a group of facets or nodes.
        box: the lowest and the highest corner in m: the boundary facets with every vertex between
        them.
        plane: the boundary facets with every vertex on it.
    """

    group: Annotated[str | None, _name] = None
    box: Annotated[tuple[tuple[float, ...], tuple[float, ...]] | None, _box] = None
    plane: Annotated[Plane | None, _table(Plane)] = None


@dataclass(frozen=True, kw_only=True)
class Place(Region):
    """A point of the solid: on a region, or a node; all but one are None.

    Attributes:
        node: coordinates in m of a node, which must lie there.
        nearest: coordinates in m of a point that the nearest node is taken for, however far it is.
        at: on a region, "mean" (area-weighted mean over it), "centre" (the node nearest to its
            centroid) or, of a contact, "nodes" (every node, each with its share of the area or
            length, or one among so many of a group of nodes alone).
    """

    node: Annotated[tuple[float, ...] | None, _point] = None
    nearest: Annotated[tuple[float, ...] | None, _point] = None
    at: Annotated[str, _choice("mean", "centre", "nodes")] = "mean"


@dataclass(frozen=True, kw_only=True)
class Support(Region):
    """A region on which every displacement is clamped."""


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A change of frequency, from that of the load at t = 0; afterwards the frequency stays.

    Attributes:
        to: the last frequency in Hz.
        duration: of the change in s.
        kind: "linear" (so many Hz a second) or "logarithmic" (so many octaves a second).
    """

    to: Annotated[float, _number(above=0.0)]
    duration: Annotated[float, _number(above=0.0)]
    kind: Annotated[str, _choice("linear", "logarithmic")] = "linear"


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """An impact: half a sine, nothing before and after it.

    Attributes:
        duration: in s.
        start: in s.
    """

    duration: Annotated[float, _number(above=0.0)]
    start: Annotated[float, _number(least=0.0)] = 0.0


@dataclass(frozen=True, kw_only=True)
class Load:
    """A load of constant direction, its size times a function of time; static, a part of the
    equilibrium, without one.

    Attributes:
        place: where it acts; a region of facets for a traction or a pressure, nothing for an
        acceleration.
        direction: unit vector; None for a pressure.
        force: size of a point force in N; on a region its work is done on the mean displacement.
        traction: size of a force per area in Pa.
        pressure: size of a pressure in Pa, positive into the body. It acts along the normal and on
            the area of the undeformed body, and does not follow the deformation.
        acceleration: size of an acceleration in m/s²: a force per volume, the density times it
            (gravity; minus the acceleration of the supports, displacements then being relative to
            them). Of these four one is given.
        frequency: frequency in Hz: sin(2π frequency t + phase).
        engine_order: multiple of the speed of rotation, in place of the frequency.
        phase: phase in rad.
        harmonics: (order, amplitude, phase) each: Σ amplitude · sin(2π order frequency t + phase).
        sweep: how the frequency changes.
        pulse: an impact.
        table: (time in s, factor) each, interpolated linearly, the first and the last factor kept
            before and after; in the file also the name of a text file with two columns.
    """

    place: Annotated[Place, Place]
    direction: Annotated[tuple[float, ...] | None, _direction] = None
    force: Annotated[float | None, _number()] = None
    traction: Annotated[float | None, _number()] = None
    pressure: Annotated[float | None, _number()] = None
    acceleration: Annotated[float | None, _number()] = None
    frequency: Annotated[float | None, _number(above=0.0)] = None
    engine_order: Annotated[int | None, _integer(1, 1000)] = None
    phase: Annotated[float, _number()] = 0.0
    harmonics: Annotated[tuple[tuple[int, float, float], ...] | None, _harmonics] = None
    sweep: Annotated[Sweep | None, _table(Sweep)] = None
    pulse: Annotated[Pulse | None, _table(Pulse)] = None
    table: Annotated[tuple[tuple[float, float], ...] | None, _series] = None

    @property
    def kind(self) -> str:
        """What is given of `LOADS`."""
        return next(name for name in LOADS if getattr(self, name) is not None)

    @property
    def size(self) -> float:
        """How large it is, in N, Pa or m/s²."""
        return float(getattr(self, self.kind))

    @property
    def static(self) -> bool:
        """Whether it is constant in time."""
        return self.frequency is None and self.pulse is None and self.table is None

    @property
    def transient(self) -> bool:
        """Whether it varies in time and does not repeat."""
        return self.sweep is not None or self.pulse is not None or self.table is not None

    @property
    def quarter_period(self) -> float:
        """A quarter of its shortest period, or of its impact, in s: longer steps do not see it;
        infinite for others.
        """
        if self.pulse is not None:
            return self.pulse.duration / 4.0
        if self.frequency is None:
            return math.inf
        highest = max(self.frequency, self.sweep.to if self.sweep else 0.0)
        return 0.25 / (highest * max((order for order, *_ in self.harmonics or ()), default=1))


LOADS = ("force", "traction", "pressure", "acceleration")


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A round rigid surface.

    Attributes:
        kind: "cylinder" (in two dimensions a circle) or "sphere".
        point: a point of the axis, or the centre, m.
        axis: unit vector along the axis of a cylinder in three dimensions; else None.
        inside: whether the body is inside, as a blade in its casing, or outside.
        radius: radius in m; None to follow from the gap.
        spin: rate at which a cylinder turns about its axis, in rad/s, as the body sees it; None for
            a casing at rest: the opposite of the scene's rotation about that axis, or 0.
        waves: of a cylinder, (order, height in m, phase in rad) of each: the surface comes nearer
            to the body by height cos(order (angle - spin t) - phase), the angle from the first
            tangent of `fenicsrom.online.surfaces.frame` of the axis (in two dimensions from x).
    """

    kind: Annotated[str, _choice("cylinder", "sphere")]
    point: Annotated[tuple[float, ...], _point]
    axis: Annotated[tuple[float, ...] | None, _direction] = None
    inside: Annotated[bool, _flag] = True
    radius: Annotated[float | None, _number(above=0.0)] = None
    spin: Annotated[float | None, _number()] = None
    waves: Annotated[tuple[tuple[float, ...], ...], _numbers("order", "height", "phase")] = ()


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A point, or every node of a region, against a rigid surface: a plane, or `surface`.

    With at = "nodes" the preload and both stiffnesses are per unit of what the nodes share: area,
    length, or a node.

    Attributes:
        place: the point.
        normal: unit vector into the plane; None before a surface.
        surface: a surface that is not plane, or None.
        preload: normal force N0 in N at the undeformed position.
        gap: initial distance in m, of the nearest of the nodes.
        approach: (time in s, distance in m) of a surface that comes nearer, linear between the
        times; at rest without.
        normal_stiffness: k_n in N/m.
        tangential_stiffness: k_t in N/m.
        friction: coefficient of friction.
    """

    place: Annotated[Place, Place]
    normal: Annotated[tuple[float, ...] | None, _direction] = None
    surface: Annotated[Surface | None, _table(Surface)] = None
    preload: Annotated[float, _number(least=0.0)] = 0.0
    gap: Annotated[float, _number(least=0.0)] = 0.0
    approach: Annotated[tuple[tuple[float, ...], ...], _numbers("time", "distance")] = ()
    normal_stiffness: Annotated[float, _number(above=0.0)]
    tangential_stiffness: Annotated[float, _number(above=0.0)]
    friction: Annotated[float, _number(least=0.0)]


@dataclass(frozen=True, kw_only=True)
class Rotation:
    """A steady rotation about a fixed axis: the scene, its loads and surfaces are seen from the
    frame that turns with the body.

    Attributes:
        speed_rpm: speed in revolutions a minute, positive about the axis.
        axis: unit vector of the axis; None in 2D, where it stands on the plane.
        point: coordinates in m of a point of the axis; None for the origin.
        coriolis: whether to take the Coriolis force into account.
    """

    speed_rpm: Annotated[float, _number()]
    axis: Annotated[tuple[float, ...] | None, _direction] = None
    point: Annotated[tuple[float, ...] | None, _point] = None
    coriolis: Annotated[bool, _flag] = False

    @property
    def omega(self) -> float:
        """Angular velocity in rad/s."""
        return math.pi / 30.0 * self.speed_rpm


@dataclass(frozen=True, kw_only=True)
class Basis:
    """The reduction basis.

    Attributes:
        method: "rubin" or "craig-bampton".
        modes: number of normal modes.
        derivatives: "none", "all", "mmi", "mmi-nls" or the labels of the derivatives to keep.
        masters: directions of the contact forces that the static modes belong to: "all" of every
            point, "normal" alone, or a number of interface modes, the combinations of forces that
            the body yields most to (as many as are independent, if those are fewer). None for "all"
            of a few points, `INTERFACE_MODES` with many: with at = "nodes", or more contacts than
            `FEW_CONTACTS`.
        threshold: smallest weight a derivative is kept with, relative to the largest (mmi and
        mmi-nls).
        differentiation: "exact" or "central-difference", of the tangent.
        elastic_force: "polynomial" (exact, without the mesh) or "projection" (of the full elastic
            force).
    """

    method: Annotated[str, _choice("rubin", "craig-bampton")] = "rubin"
    modes: Annotated[int, _integer(0, 1000)] = 3
    masters: Annotated[str | int | None, _masters] = None
    derivatives: Annotated[str | tuple[str, ...], _derivatives] = "mmi-nls"
    threshold: Annotated[float, _number(least=0.0, most=1.0)] = 1e-4
    differentiation: Annotated[str, _choice("exact", "central-difference")] = "exact"
    elastic_force: Annotated[str, _choice("polynomial", "projection")] = "polynomial"


_SCHEMES = ("average-acceleration", "generalised-alpha", "discrete-gradient")


@dataclass(frozen=True, kw_only=True)
class Time:
    """The time integration; to a steady state with loads that repeat, else for a duration.

    Attributes:
        scheme: "average-acceleration", "generalised-alpha" or "discrete-gradient".
        spectral_radius: of generalised-alpha at high frequency; None for the other schemes.
        steps_per_period: fixed number of steps; None with `tolerance` or `duration`.
        tolerance: of an adaptive step, whose local error is at most a hundredth of it, relative to
            the size of the motion; None for a fixed step.
        periods: the most periods to run; None with `duration`.
        steady_tolerance: relative change over a period taken as steady, 0 for never; None with
        `duration`.
        duration: time to run in s; None with loads that repeat, or where nothing moves.
        step: time step in s; None unless the step is fixed and there is a `duration`.
    """

    scheme: Annotated[str, _choice(*_SCHEMES)] = "discrete-gradient"
    spectral_radius: Annotated[float | None, _number(least=0.0, most=1.0)] = None
    steps_per_period: Annotated[int | None, _integer(4, 1_000_000)] = None
    tolerance: Annotated[float | None, _number(above=0.0, below=1.0)] = None
    periods: Annotated[int | None, _integer(1, 1_000_000)] = None
    steady_tolerance: Annotated[float | None, _number(least=0.0, below=1.0)] = None
    duration: Annotated[float | None, _number(above=0.0)] = None
    step: Annotated[float | None, _number(above=0.0)] = None


@dataclass(frozen=True, kw_only=True)
class BeamSection:
    """The planar Timoshenko beam of rectangular section that stands for the solid.

    Attributes:
        length: length in m.
        height: height of the section in m, in the direction of bending.
        width: width of the section in m.
        elements: number of two-node elements.
        load_at: where the load acts, as a fraction of the length.
    """

    length: Annotated[float, _number(above=0.0)]
    height: Annotated[float, _number(above=0.0)]
    width: Annotated[float, _number(above=0.0)]
    elements: Annotated[int, _integer(1, 10_000)] = 20
    load_at: Annotated[float, _number(above=0.0, most=1.0)]


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The models to compare the reduced one with.

    Attributes:
        full: whether to run the full solid model.
        beam: the beam to run, or None. In the file: `beam = true` and the table `beam_section`.
    """

    full: bool = False
    beam: BeamSection | None = None


@dataclass(frozen=True, kw_only=True)
class _ReferenceTable:
    """The table [reference] as the file has it."""

    full: Annotated[bool, _flag] = False
    beam: Annotated[bool, _flag] = False
    beam_section: Annotated[BeamSection | None, _table(BeamSection)] = None


def _reference(value: Any, where: _Where) -> Reference:
    """The reference models."""
    table: _ReferenceTable = _table(_ReferenceTable)(value, where)
    if table.beam and table.beam_section is None:
        raise where.at("beam_section").refuse(
            MISSING, "must be a table, as beam = true asks for it"
        )
    return Reference(full=table.full, beam=table.beam_section if table.beam else None)


@dataclass(frozen=True, kw_only=True)
class Output:
    """What is written besides the summary, report, history and reduced model.

    Attributes:
        pictures: PNG pictures.
        paraview: ParaView files of modes and derivatives.
        motion: ParaView files of the last period of motion, and of the contact points in it.
        animation: an animated picture of the last period.
    """

    pictures: Annotated[bool, _flag] = True
    paraview: Annotated[bool, _flag] = True
    motion: Annotated[bool, _flag] = False
    animation: Annotated[bool, _flag] = False


@dataclass(frozen=True, kw_only=True)
class Compare:
    """What `fenicsrom compare` compares: every combination of these lists.

    Attributes:
        full: whether to run the full model; without it the bases are ranked by their residual
        alone.
        methods: as `Basis.method`.
        derivatives: as `Basis.derivatives`: ways of choosing them, or lists of labels.
        modes: numbers of normal modes.
        elastic_force: as `Basis.elastic_force`.
        schemes: as `Time.scheme`; that of [time] if None.
        repeats: online runs that are timed.
    """

    full: Annotated[bool, _flag] = True
    methods: Annotated[tuple[str, ...], _list(_choice("rubin", "craig-bampton"))] = (
        "rubin",
        "craig-bampton",
    )
    derivatives: Annotated[tuple[str | tuple[str, ...], ...], _list(_derivatives)] = (
        "none",
        "mmi",
        "mmi-nls",
        "all",
    )
    modes: Annotated[tuple[int, ...], _list(_integer(0, 1000))] = (1, 2, 3, 5)
    elastic_force: Annotated[tuple[str, ...], _list(_choice("polynomial", "projection"))] = (
        "polynomial",
    )
    schemes: Annotated[tuple[str, ...] | None, _list(_choice(*_SCHEMES))] = None
    repeats: Annotated[int, _integer(5, 1000)] = 5


@dataclass(frozen=True, kw_only=True)
class _Span:
    """Equally spaced values as the file has them: first, last and how many."""

    first: Annotated[float, _number(least=0.0)]
    last: Annotated[float, _number(above=0.0)]
    number: Annotated[int, _integer(2, 10_000)]


@dataclass(frozen=True, kw_only=True)
class Campbell:
    """What `fenicsrom campbell` draws.

    Attributes:
        speeds_rpm: ascending speeds in revolutions a minute; None for 13 from rest to that of
        [rotation].
        modes: number of modes, the first ones at the first speed.
        engine_orders: excitations a revolution.
    """

    speeds_rpm: Annotated[tuple[float, ...] | None, _speeds] = None
    modes: Annotated[int, _integer(1, 1000)] = 6
    engine_orders: Annotated[tuple[int, ...], _list(_integer(1, 1000))] = (1, 2, 3, 4)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Everything a run needs to know; made, checked and completed by `read_scene` or `parse_scene`.

    Attributes:
        title: a text for the report.
        geometrically_nonlinear: False for small displacements.
        geometry: the mesh.
        material: the material.
        supports: the clamped groups, at least one.
        loads: the loads.
        contacts: the points that may rub.
        rotation: the rotation of the frame of the scene; None at rest.
        probe: where the amplitude is read in a scene without contact (the first load's place unless
        given).
        basis: the reduction basis.
        time: the time integration.
        reference: the models to compare with.
        output: what to write.
        compare: what to compare.
        campbell: what to draw against the speed.
        source: the file it came from.
    """

    title: Annotated[str, _text] = ""
    geometrically_nonlinear: Annotated[bool, _flag] = True
    geometry: Annotated[Geometry, _table(Geometry)]
    material: Annotated[Material, _table(Material)]
    supports: Annotated[tuple[Support, ...], _tables(Support, least=1)]
    loads: Annotated[tuple[Load, ...], _tables(Load)] = ()
    contacts: Annotated[tuple[Contact, ...], _tables(Contact)] = ()
    rotation: Annotated[Rotation | None, _table(Rotation)] = None
    probe: Annotated[Place | None, _table(Place)] = None
    basis: Annotated[Basis, _table(Basis)] = Basis()
    time: Annotated[Time, _table(Time)] = Time()
    reference: Annotated[Reference, _reference] = Reference()
    output: Annotated[Output, _table(Output)] = Output()
    compare: Annotated[Compare, _table(Compare)] = Compare()
    campbell: Annotated[Campbell, _table(Campbell)] = Campbell()
    source: str = ""

    @property
    def period(self) -> float | None:
        """Period of the excitation in s, that of the smallest frequency; None without a harmonic
        load or with a transient.
        """
        frequencies = [load.frequency for load in self.loads if load.frequency is not None]
        return (
            1.0 / min(frequencies)
            if frequencies and not any(load.transient for load in self.loads)
            else None
        )

    @property
    def static_only(self) -> bool:
        """Whether its equilibrium is all that is asked for: nothing moves the body, and no time is
        given to run.
        """
        return (
            not self.contacts
            and all(load.static for load in self.loads)
            and self.time.duration is None
        )


def _contradictions(scene: Scene) -> Iterator[tuple[str, object, str]]:
    """Key, value and what is allowed, for each key that does not agree with the others."""
    yield from _geometry_contradictions(scene.geometry)
    places = [
        (f"loads[{index}]", load.place)
        for index, load in enumerate(scene.loads)
        if load.acceleration is None
    ]
    places += [
        (f"contacts[{index}]", contact.place) for index, contact in enumerate(scene.contacts)
    ]
    places += [("probe", scene.probe)] if scene.probe else []
    regions: list[tuple[str, Region]] = [
        (f"supports[{index}]", region) for index, region in enumerate(scene.supports)
    ]
    vectors: list[tuple[str, tuple[float, ...]]] = []
    for key, region in [*regions, *places]:
        vectors += [
            (f"{key}.{name}", value)
            for name in ("node", "nearest")
            if (value := getattr(region, name, None))
        ]
        vectors += [
            (f"{key}.box[{index}]", corner) for index, corner in enumerate(region.box or ())
        ]
        if region.plane:
            vectors += [
                (f"{key}.plane.{name}", getattr(region.plane, name)) for name in ("point", "normal")
            ]
    vectors += [
        (f"loads[{index}].direction", load.direction)
        for index, load in enumerate(scene.loads)
        if load.direction
    ]
    for index, contact in enumerate(scene.contacts):
        vectors += [(f"contacts[{index}].normal", contact.normal)] if contact.normal else []
        if contact.surface is not None:
            vectors += [(f"contacts[{index}].surface.point", contact.surface.point)]
            vectors += (
                [(f"contacts[{index}].surface.axis", contact.surface.axis)]
                if contact.surface.axis
                else []
            )
    yield from _rotation_contradictions(scene)
    if scene.rotation:
        named = {"rotation.axis": scene.rotation.axis, "rotation.point": scene.rotation.point}
        vectors += [(key, vector) for key, vector in named.items() if vector is not None]
    for key, vector in vectors:
        if len(vector) != scene.geometry.dimension:
            yield (
                key,
                vector,
                f"must have {scene.geometry.dimension} components, as geometry.dimension says",
            )
    for key, region in [*regions, *places]:
        names = ("group", "node", "nearest", "box", "plane")
        values = {
            name: value for name in names if (value := getattr(region, name, None)) is not None
        }
        if not values:
            others = "node, nearest, box or plane" if isinstance(region, Place) else "box or plane"
            yield f"{key}.group", MISSING, f"must be given, or {others}"
        if len(values) > 1:
            first, second = list(values)[:2]
            yield (
                f"{key}.{second}",
                _plain(values[second]),
                f"must not be given together with {first}",
            )
    for index, contact in enumerate(scene.contacts):
        yield from _contact_contradictions(contact, f"contacts[{index}]", scene.geometry.dimension)
    for key, place in places:
        if place.at == "nodes" and not key.startswith("contacts"):
            yield f"{key}.at", place.at, 'must be "mean" or "centre", but of a contact'
        if place.at != "mean" and (place.node or place.nearest):
            yield (
                f"{key}.at",
                place.at,
                f"must not be given together with {'node' if place.node else 'nearest'}",
            )
    for index, load in enumerate(scene.loads):
        for name, value, allowed in _load_contradictions(load):
            yield f"loads[{index}].{name}", value, allowed
    if not (
        scene.contacts or scene.probe or any(load.acceleration is None for load in scene.loads)
    ):
        yield (
            "probe",
            MISSING,
            "must be a table in a scene with neither contact nor load"
            + " at a place" * bool(scene.loads),
        )
    yield from _basis_contradictions(scene)
    yield from _time_contradictions(scene)


def _contact_contradictions(
    contact: Contact, key: str, dimension: int
) -> Iterator[tuple[str, object, str]]:
    """The same within a contact."""
    surface = contact.surface
    if surface is None and contact.normal is None:
        yield f"{key}.normal", MISSING, "must be given, or a surface"
    times = [time for time, _ in contact.approach]
    if any(later <= sooner for sooner, later in pairwise(times)):
        yield f"{key}.approach", times, "must have times that increase"
    if surface is None:
        return
    if contact.normal is not None:
        yield f"{key}.normal", contact.normal, "must not be given together with surface"
    wanted = dimension == 3 and surface.kind == "cylinder"
    if wanted and surface.axis is None:
        yield f"{key}.surface.axis", MISSING, "must be given of a cylinder in three dimensions"
    if not wanted and surface.axis is not None:
        yield (
            f"{key}.surface.axis",
            surface.axis,
            "must not be given but of a cylinder in three dimensions",
        )
    if dimension == 2 and surface.kind == "sphere":
        yield f"{key}.surface.kind", surface.kind, 'must be "cylinder" in two dimensions'
    if surface.radius is not None and contact.gap:
        yield (
            f"{key}.gap",
            contact.gap,
            "must not be given together with surface.radius, from which it follows",
        )
    if surface.kind == "sphere" and (surface.waves or surface.spin is not None):
        name = "waves" if surface.waves else "spin"
        yield f"{key}.surface.{name}", getattr(surface, name), "must not be given of a sphere"
    for index, (order, _, _) in enumerate(surface.waves):
        if order != round(order) or order < 1:
            yield (
                f"{key}.surface.waves[{index}]",
                order,
                "must be of an integer order of at least 1",
            )


def _load_contradictions(load: Load) -> Iterator[tuple[str, object, str]]:
    """The same within a load."""
    given = [name for name in LOADS if getattr(load, name) is not None]
    if not given:
        yield LOADS[0], MISSING, f"must be given, or {', '.join(LOADS[1:-1])} or {LOADS[-1]}"
        return
    if len(given) > 1:
        yield given[1], getattr(load, given[1]), f"must not be given together with {given[0]}"
    kind = given[0]
    if kind == "pressure" and load.direction is not None:
        yield (
            "direction",
            list(load.direction),
            "must not be given with a pressure, which acts along the normal",
        )
    if kind != "pressure" and load.direction is None:
        yield "direction", MISSING, "must be a vector"
    unwanted = {"force": (), "acceleration": ("group", "node", "nearest", "box", "plane")}.get(
        kind, ("node", "nearest")
    )
    where = {"acceleration": "the whole body"}.get(kind, "facets")
    why = f"with {'an' if kind == 'acceleration' else 'a'} {kind}, which acts on {where}"
    for name in unwanted:
        if (value := getattr(load.place, name)) is not None:
            yield name, _plain(value), f"must not be given {why}"
    if kind != "force" and load.place.at != "mean":
        yield "at", load.place.at, f"must not be given {why}"
    for name in ("phase", "harmonics", "sweep"):
        if load.frequency is None and getattr(load, name):
            yield name, _plain(getattr(load, name)), "must not be given without frequency"
    for name, other in (
        ("pulse", "frequency"),
        ("table", "frequency"),
        ("table", "pulse"),
        ("sweep", "harmonics"),
        ("phase", "harmonics"),
    ):
        if getattr(load, name) and getattr(load, other) is not None:
            yield name, _plain(getattr(load, name)), f"must not be given together with {other}"


def _geometry_contradictions(geometry: Geometry) -> Iterator[tuple[str, object, str]]:
    """The same within the geometry."""
    if geometry.dimension == 2 and geometry.thickness is None:
        yield "geometry.thickness", MISSING, "must be a number above 0 in two dimensions"
    if geometry.dimension == 3 and geometry.thickness is not None:
        yield "geometry.thickness", geometry.thickness, "must not be given in three dimensions"
    if geometry.dimension == 3 and geometry.plane is not None:
        yield "geometry.plane", geometry.plane, "must not be given in three dimensions"
    if geometry.mesh.suffix != ".geo" and geometry.cells is not None:
        yield "geometry.cells", geometry.cells, "must not be given unless mesh is a .geo file"
    if geometry.mesh.suffix != ".geo" and geometry.parameters:
        yield (
            "geometry.parameters",
            geometry.parameters,
            "must not be given unless mesh is a .geo file",
        )
    if geometry.mesh.suffix.lower() in (".step", ".stp"):
        if geometry.size is None:
            yield (
                "geometry.size",
                MISSING,
                "must be a number above 0, the size in m that a .step file is meshed with",
            )
    elif geometry.size is not None:
        yield "geometry.size", geometry.size, "must not be given unless mesh is a .step file"
    if geometry.scale != 1.0 and geometry.mesh.suffix.lower() in (".geo", ".step", ".stp"):
        yield "geometry.scale", geometry.scale, "must not be given unless mesh is a mesh file"
    if "structured" in geometry.parameters:
        yield (
            "geometry.parameters.structured",
            geometry.parameters["structured"],
            "must be set by geometry.cells",
        )


def _rotation_contradictions(scene: Scene) -> Iterator[tuple[str, object, str]]:
    """The same between the rotation and the rest."""
    if scene.rotation is None:
        return
    if scene.geometry.dimension == 2 and scene.rotation.axis is not None:
        yield (
            "rotation.axis",
            scene.rotation.axis,
            "must not be given in two dimensions, where it stands on the plane",
        )
    if scene.geometry.dimension == 3 and scene.rotation.axis is None:
        yield "rotation.axis", MISSING, "must be a vector along the axis in three dimensions"
    if scene.reference.beam is not None:
        yield "reference.beam", True, "must be false with [rotation]: the beam does not turn"


def _basis_contradictions(scene: Scene) -> Iterator[tuple[str, object, str]]:
    """The same between the basis and the contacts."""
    if scene.basis.modes < 1 and not scene.contacts:
        yield "basis.modes", scene.basis.modes, "must be at least 1 in a scene without contact"
    if not scene.contacts and scene.basis.masters is not None:
        yield "basis.masters", scene.basis.masters, "must not be given in a scene without contact"
    if isinstance(scene.basis.derivatives, tuple) and not any(
        contact.place.at == "nodes" for contact in scene.contacts
    ):
        points, masters = len(scene.contacts), _default_masters(scene)
        each = scene.geometry.dimension if masters == "all" else 1
        static = (
            points * each
            if isinstance(masters, str)
            else min(masters, points * scene.geometry.dimension)
        )
        available = {"V": scene.basis.modes, "S": static}
        for index, label in enumerate(scene.basis.derivatives):
            if any(
                int(number) > available[kind]
                for number, kind in re.findall(r"([0-9]+)([VS])", label)
            ):
                allowed = f"must be of the {available['V']} normal (V) and {available['S']} static (S) modes"
                yield f"basis.derivatives[{index}]", label, allowed


def _default_masters(scene: Scene) -> str | int:
    """The masters of the basis, those that fit the contacts if none are given."""
    if scene.basis.masters is not None:
        return scene.basis.masters
    many = len(scene.contacts) > FEW_CONTACTS or any(
        contact.place.at == "nodes" for contact in scene.contacts
    )
    return INTERFACE_MODES if many else "all"


def _time_contradictions(scene: Scene) -> Iterator[tuple[str, object, str]]:
    """The same between the times and the loads."""
    time = scene.time
    if time.spectral_radius is not None and time.scheme != "generalised-alpha":
        yield (
            "time.spectral_radius",
            time.spectral_radius,
            'must not be given unless scheme is "generalised-alpha"',
        )
    if scene.period is None:
        transient = next((index for index, load in enumerate(scene.loads) if load.transient), None)
        why = (
            "no load has a frequency"
            if transient is None
            else f"loads[{transient}] does not repeat"
        )
        for name in ("steps_per_period", "periods", "steady_tolerance"):
            if getattr(time, name) is not None:
                unless = "unless a load has a frequency" if transient is None else f"as {why}"
                yield f"time.{name}", getattr(time, name), f"must not be given {unless}"
        if time.duration is None:
            if not scene.static_only or time.step is not None or time.tolerance is not None:
                yield "time.duration", MISSING, f"must be a number above 0, as {why}"
            return
        if time.step is None and time.tolerance is None:
            yield "time.step", MISSING, f"must be a number above 0, or tolerance be given, as {why}"
        elif time.step is not None and time.tolerance is not None:
            yield "time.tolerance", time.tolerance, "must not be given together with step"
        elif time.step is not None and time.step > time.duration:
            yield "time.step", time.step, f"must be at most the duration of {time.duration:g}"
        quarter, index = min(
            ((load.quarter_period, index) for index, load in enumerate(scene.loads)),
            default=(math.inf, 0),
        )
        if time.step is not None and time.step > quarter:
            what = "impact" if scene.loads[index].pulse else "shortest period"
            yield (
                "time.step",
                time.step,
                f"must be at most {quarter:.6g}, a quarter of the {what} of loads[{index}]",
            )
        return
    for name, instead in (("duration", "periods"), ("step", "steps_per_period")):
        if getattr(time, name) is not None:
            yield (
                f"time.{name}",
                getattr(time, name),
                f"must not be given with a harmonic load: use {instead}",
            )
    if time.steps_per_period is not None and time.tolerance is not None:
        yield "time.tolerance", time.tolerance, "must not be given together with steps_per_period"
    lowest = min(load.frequency for load in scene.loads if load.frequency is not None)
    for index, load in enumerate(scene.loads):
        if (
            load.frequency is not None
            and abs(math.remainder(load.frequency, lowest)) > 1e-9 * lowest
        ):
            allowed = f"must be an integer multiple of the lowest frequency, {lowest:.12g}"
            yield f"loads[{index}].frequency", load.frequency, allowed


def _complete(scene: Scene, folder: Path | None) -> Scene:
    """The scene with its mesh found and the defaults that depend on other keys filled in."""
    geometry, time = scene.geometry, scene.time
    if folder is not None:
        geometry = replace(
            geometry, mesh=_find(geometry.mesh, folder, _Where(scene.source, "geometry.mesh"))
        )
    if geometry.mesh.suffix == ".geo" and geometry.cells is None:
        geometry = replace(geometry, cells="structured")
    if geometry.dimension == 2 and geometry.plane is None:
        geometry = replace(geometry, plane="stress")
    if time.scheme == "generalised-alpha" and time.spectral_radius is None:
        time = replace(time, spectral_radius=0.8)
    if scene.period is not None:
        if time.steps_per_period is None and time.tolerance is None:
            time = replace(time, steps_per_period=200)
        periods = 100 if time.periods is None else time.periods
        steady = (
            max(1e-5, time.tolerance or 0.0)
            if time.steady_tolerance is None
            else time.steady_tolerance
        )
        time = replace(time, periods=periods, steady_tolerance=steady)
    probe = scene.probe
    if probe is None and not scene.contacts:
        probe = next(load.place for load in scene.loads if load.acceleration is None)
    loads = tuple(
        replace(
            load,
            table=_read_table(load.table, folder, _Where(scene.source, f"loads[{index}].table")),
        )
        if isinstance(load.table, Path)
        else load
        for index, load in enumerate(scene.loads)
    )
    rotation = scene.rotation
    if rotation is not None and rotation.point is None:
        rotation = replace(rotation, point=(0.0,) * geometry.dimension)
    basis = replace(scene.basis, masters=_default_masters(scene)) if scene.contacts else scene.basis
    return replace(
        scene,
        geometry=geometry,
        time=time,
        probe=probe,
        loads=loads,
        rotation=rotation,
        basis=basis,
    )


def _read_table(path: Path, folder: Path | None, where: _Where) -> tuple[tuple[float, float], ...]:
    """The rows of a text file: time in s and factor, apart by a comma, a semicolon or space, after
    a head at most.
    """
    found = (folder or Path()) / path
    if not os.path.isfile(found):
        searched = (
            "an existing file"
            if path.is_absolute()
            else f"a file in {(folder or Path()).absolute()}"
        )
        raise where.refuse(str(path), f"must be {searched}")
    try:
        lines = found.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeError):
        raise where.refuse(str(path), "must be a text file that can be read") from None
    rows: list[Any] = []
    numbers: list[int] = []
    headed = False
    for number, line in enumerate(lines, 1):
        words = re.split(r"\s*[,;]\s*|\s+", line.strip())
        if words == [""] or words[0].startswith("#"):
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            if not rows and not headed:
                headed = True
                continue
            rows.append(line)
        numbers.append(number)
    return _rows(
        rows,
        where,
        lambda index: replace(
            where, key=f"{where.key} = {_show(str(path))}: line {numbers[index]}"
        ),
    )


def _find(mesh: Path, folder: Path, where: _Where) -> Path:
    """The mesh file: relative to the folder of the scene, else in the program's own folder of
    meshes.
    """
    folders = [folder, shared_meshes()]
    for candidate in (parent / mesh for parent in folders):
        if os.path.isfile(candidate):
            return candidate.resolve()
    searched = (
        "an existing file"
        if mesh.is_absolute()
        else f"a file in {folders[0].absolute()} or {folders[1]}"
    )
    raise where.refuse(str(mesh), f"must be {searched}")


def override_table(
    table: Mapping[str, Any], overrides: Sequence[str], source: str
) -> dict[str, Any]:
    """A copy of a scene's table with some of its values replaced.

    Args:
        table: the plain data of a scene.
        overrides: replacements such as `loads.0.force=200`: the path of a key, and its value as
            TOML writes it. Tables on the way that are missing are made; entries of lists must
            exist.
        source: name of the table in messages.

    Returns:
        The new table, not yet checked.

    Raises:
        SceneError: an override has no `=`, its value is not TOML, or its path leads nowhere.
    """
    changed = dict(table)
    for override in overrides:
        path, equals, text = override.partition("=")
        names = [name.strip() for name in path.replace("[", ".").replace("]", "").split(".")]
        if not equals or not all(names):
            raise _error(f"{source}: override {_show(override)}: must be a key, = and a value")
        try:
            value = tomllib.loads(f"value = {text}")
        except (ValueError, RecursionError):
            value = {}
        if list(value) != ["value"]:
            raise _error(
                f"{source}: override {_show(override)}: the value must be as TOML writes it, text in quotes"
            )
        branch: Any = changed
        for depth, name in enumerate(names):
            if (
                isinstance(branch, list)
                and re.fullmatch(r"[0-9]{1,6}", name)
                and int(name) < len(branch)
            ):
                step: Any = int(name)
            elif isinstance(branch, dict):
                step = name
            else:
                raise _error(
                    f"{source}: override {_show(override)}: {'.'.join(names[:depth])} {_no_entry(branch, name)}"
                )
            if depth == len(names) - 1:
                branch[step] = value["value"]
            else:  # copies only what is on the way to the key
                branch[step] = copy.copy(
                    branch.get(step, {}) if isinstance(branch, dict) else branch[step]
                )
                branch = branch[step]
    return changed


def _no_entry(branch: Any, name: str) -> str:
    """Why a table of the scene, a list or a value has no such entry."""
    if not isinstance(branch, list):
        return "is not a table"
    if not branch:
        return f"is empty: it has no entry {name}"
    numbers = (
        "the only one is 0"
        if len(branch) == 1
        else f"they are numbered from 0 to {len(branch) - 1}"
    )
    return f"has no entry {name}: {numbers}"


def parse_scene(table: Mapping[str, Any], source: str, folder: Path | None) -> Scene:
    """Check plain data against the rules and make a scene of it.

    Args:
        table: the data, as TOML or JSON gives it.
        source: name of the data in messages, usually the file's.
        folder: folder that the path of the mesh is relative to; None to take the path as it is,
            without looking for the file (for a reduced model, which needs no mesh).

    Returns:
        The scene, with every default filled in.

    Raises:
        SceneError: one sentence naming the source, the key, its value and what is allowed.
    """
    where = _Where(source)
    if not isinstance(table, Mapping):
        raise _error(f"{source}: must be a table")
    scene: Scene = _engine_orders(replace(_table(Scene)(table, where), source=source), where)
    for key, value, allowed in _contradictions(scene):
        raise where.at(key).refuse(value, allowed)
    return _complete(scene, folder)


def _engine_orders(scene: Scene, where: _Where) -> Scene:
    """The scene with the frequencies of loads given by their engine order."""
    loads = list(scene.loads)
    for index, load in enumerate(loads):
        if load.engine_order is None:
            continue
        key = where.at(f"loads[{index}].engine_order")
        if scene.rotation is None or not scene.rotation.speed_rpm:
            raise key.refuse(load.engine_order, "must not be given in a scene that does not turn")
        if load.frequency is not None:
            raise key.refuse(load.engine_order, "must not be given together with frequency")
        loads[index] = replace(
            load,
            engine_order=None,
            frequency=load.engine_order * abs(scene.rotation.speed_rpm) / 60.0,
        )
    return replace(scene, loads=tuple(loads))


def read_scene(path: str | os.PathLike[str], overrides: Sequence[str] = ()) -> Scene:
    """Read a scene from a TOML file.

    Args:
        path: the file.
        overrides: values to replace, see `override_table`.

    Returns:
        The scene, with every default filled in.

    Raises:
        SceneError: the file cannot be read, is not TOML, or does not describe a scene.
    """
    source = os.fspath(path)
    try:
        table = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise _error(f"{source}: cannot be read: {error.strerror}") from None
    except RecursionError:
        raise _error(f"{source}: is not TOML: nested too deeply") from None
    except ValueError as error:
        raise _error(f"{source}: is not TOML: {error}") from None
    return parse_scene(override_table(table, overrides, source), source, Path(path).parent)


def scene_table(scene: Scene) -> dict[str, Any]:
    """The plain data of a scene, fit for JSON; `parse_scene` makes the same scene of it."""
    table: dict[str, Any] = _plain(scene)
    beam = scene.reference.beam
    table["reference"] = {"full": scene.reference.full, "beam": beam is not None}
    if beam is not None:
        table["reference"]["beam_section"] = _plain(beam)
    return table
