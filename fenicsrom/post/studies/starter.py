"""The starter scene of `fenicsrom init`: a commented TOML file that runs at once."""

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.studies.first_mode import DAMPING, FirstMode
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem.mesh.inspection import LARGE, Group, Inspection
from fenicsrom.formats.mesh_file import AXES, DeckMaterial
from fenicsrom.post.body.group_drawing import members_of
from fenicsrom.post.studies.deck_tables import attachment_lines, joint_lines, static_lines
from fenicsrom.scene.base.tables import toml_value as toml
from fenicsrom.scene.keys.unit_system import LENGTHS, MASSES, TIMES, Elastic, Units, likely_systems

CLAMPED = re.compile(r"root|fix|clamp|encastre|support|base|spc|mount|bolt|ground|hub", re.I)
"""Names of groups that are probably clamped."""

ON_PLANE = 1e-6
"""Facets at smaller distances from a plane, relative to the extent, lie on it."""

FRICTION = 0.3

TIMES_OF_CONTACT = (
    "[time] # of fenicsrom run; fenicsrom statics does not need it",
    "duration = 1.0",
    "step = 0.1",
    "",
)
"""The times without which `fenicsrom run` refuses a scene with contact."""

STEEL = 2.1e11
"""Young's modulus of steel, Pa."""

IMPACTS = 0.002
"""Damping ratio of mode 1 of a starter scene with contact, in proportion to the stiffness."""

STOP = 3.0
"""Stiffness of a stop, relative to the modal stiffness."""

CASING = 100.0
"""Stiffness of a casing, relative to the modal stiffness."""

GAP, LOBE = 2e-4, 2.5e-4
"""Gap of a casing and height of its lobes, relative to the extent of the body."""

TIP_SPEED = 50.0
"""Largest speed of a tip, m/s: it lengthens a blade of metal by much less than the gap."""

RUB_STEPS = 600
"""Steps in a revolution of a starter scene with a casing."""

GUESS = "a guess from the box of the body, check it"
"""What the comments of a starter scene say of its axis of rotation."""

HUB = 0.5
"""Distance of a blade's root from the axis, relative to the length of the blade."""

SLIDING = 0.1
"""Cosine of the angle between motion and normal below which a point slides along a surface."""

FLAT = 0.5
"""A face with a smaller ratio of its mean normal to a unit vector goes round, as a bore does."""


def units_of(found: Inspection, given: str | None) -> tuple[Units, str]:
    """The units of a starter scene, and why.

    Args:
        found: the mesh.
        given: length, mass and time, such as "mm,t,s"; None to guess.

    Raises:
        SceneError: there is no such unit, or the file has another one.
    """
    if given is not None:
        names = [name.strip() for name in given.split(",")]
        allowed = [list(LENGTHS), list(MASSES), list(TIMES)]
        if len(names) != 3 or any(n not in a for n, a in zip(names, allowed, strict=True)):
            listed = ", then ".join(" or ".join(entry) for entry in allowed)
            reason = f"--units {given}: must be {listed}, such as mm,t,s"
            raise SceneError(reason, kind=ErrorKind.RANGE, key="units")
        if found.path.suffix.lower() == ".geo" and names[0] != "m":
            reason = (
                f"--units {given}: the coordinates of a .geo file are in m: write {found.path} "
                "in m, or give the .msh file that gmsh makes of it"
            )
            raise SceneError(reason, kind=ErrorKind.RANGE, key="units", source=str(found.path))
        return Units(length=names[0], mass=names[1], time=names[2]), "as --units says"
    if found.path.suffix.lower() in (".step", ".stp", ".geo") or found.geometry.scale != 1.0:
        return Units(), ""
    given_elastic = [(m.young, m.density) for m in found.physics.materials if m.young is not None]
    if given_elastic:
        return _units_of_deck(found, given_elastic)
    if found.extent > LARGE:
        return IN_MM, f"guessed, because the body is {found.extent:.4g} long"
    return Units(), ""


IN_MM = Units(length="mm", mass="t")
"""The usual system of bodies in mm."""


def _units_of_deck(found: Inspection, materials: list[Elastic]) -> tuple[Units, str]:
    """The units of a deck with materials, and why."""
    gravity = [math.hypot(*x.vector) for x in found.physics.loads if x.kind == "acceleration"]
    likely = likely_systems(materials, gravity)
    young, density = materials[0]
    numbers = f"E = {young:g}" + ("" if density is None else f" and density = {density:g}")
    if not likely:
        units = IN_MM if found.extent > LARGE else Units()
        return units, f"guessed: {numbers} are those of a solid in no usual system; see --units"
    why = f"guessed from {numbers}"
    others = [f"{system.length},{system.mass},{system.time}" for system in likely[1:]]
    if others:
        why += f", which fit --units {' or '.join(others)} as well"
    if likely[0].is_si and found.extent > LARGE:
        why += f", but the body is {found.extent:.4g} m long: is it in mm? Then give --scale 0.001"
    elif likely[0].is_si and not others:
        why = ""
    return likely[0], why


def starter_scene(
    found: Inspection,
    folder: Path,
    *,
    units: tuple[Units, str] | None = None,
    root: str | None = None,
    tip: str | None = None,
    template: str = "response",
    mode: FirstMode | None = None,
) -> str:
    """Write a scene for a mesh.

    Args:
        found: a mesh that can be used.
        folder: folder of the scene, to which the path of the mesh is relative.
        units: the units of the scene, and why; by default guessed.
        root: the group to clamp; by default what the file says, or a likely part.
        tip: the group where the load acts; by default the point that the first mode moves most.
        template: "response", "stop", "rub", "damper" or "statics".
        mode: the first mode; None for a scene without loads.
    """
    system, why = units or units_of(found, None)
    relative = os.path.relpath(found.path.resolve(), folder.resolve())
    results = "" if system.is_si else "; results are in SI units"
    lines = [
        f"# A first scene for {found.path.name}. Units: {system.names}{results}.",
        "#   fenicsrom modes SCENE      frequencies, mode shapes and pictures",
        "#   fenicsrom run SCENE        the motion under the loads below",
        "# All keys: demos/keys.md of the program.",
        "",
        f"title = {toml(found.path.stem)}",
        "",
    ]
    if not system.is_si:
        lines += [f"[units] # {why}: check them"]
        keys = ("length", "mass", "time")
        lines += [*(f"{name} = {toml(getattr(system, name))}" for name in keys), ""]
    lines += [
        "[geometry]",
        f"mesh = {toml(relative)}",
        f"dimension = {found.geometry.dimension}",
        *_geometry_lines(found),
        "",
        *_material_lines(found, system),
        "",
        "[damping]",
        f"ratios = {DAMPING} # of the first modes",
        *_stiffness_damping(system, mode, template),
        "",
        *_support_lines(found, root),
        *_cyclic_lines(found),
        *attachment_lines(found),
        *joint_lines(found, _in(system, "Pa", STEEL)),
        *[f"# not taken from the file: {what}" for what in found.physics.not_taken],
        "",
        *static_lines(found.physics.loads, found.geometry.dimension),
    ]
    if mode is not None:
        lines += _task_lines(found, system, mode, tip, template)
    return "\n".join([*lines, "[basis]", "modes = 6", ""])


def _stiffness_damping(units: Units, mode: FirstMode | None, template: str) -> list[str]:
    """The damping of the modes above the first ones, without which impacts make them ring."""
    if mode is None or template not in ("stop", "rub", "damper"):
        return []
    factor = _two_digits(units, "s", IMPACTS / (math.pi * mode.frequency))
    why = f"a damping ratio of {IMPACTS} at mode 1 that grows with the frequency"
    return [f"stiffness = {factor} # {units.time}: {why}, for impacts"]


def _geometry_lines(found: Inspection) -> list[str]:
    """Lines of [geometry] that depend on the file."""
    geometry, lines = found.geometry, []
    if geometry.dimension == 2:
        lines.append(f"thickness = {found.physics.thickness or 1.0!r}")
        if found.physics.strain:
            lines.append('plane = "strain"')
    if geometry.size is not None:
        lines.append(f"size = {geometry.size:g} # m, of the cells; smaller ones are more exact")
    simplex = all(name.startswith(("triangle", "tetrahedr")) for name in found.cells)
    if geometry.mesh.suffix == ".geo" and simplex:
        lines.append('cells = "simplex"')
    if geometry.scale != 1.0:
        lines.append(f"scale = {geometry.scale:g} # m, the unit of the file")
    quadratic = any(word in name for name in found.cells for word in (" of 6", " of 8", " of 1"))
    if geometry.is_cad and abs(found.bulge) > ON_PLANE:
        lines.append("curved = true # cells with curved edges follow fillets and holes")
    elif quadratic:
        lines.append(f"# curved = true # {found.curved}")
    return lines


def _material_lines(found: Inspection, units: Units) -> list[str]:
    """The tables of the materials: those of the file, else steel."""
    steel = DeckMaterial("steel", _in(units, "Pa", STEEL), 0.3, _in(units, "kg/m³", 7850.0))
    lines: list[str] = []
    for k, material in enumerate(found.physics.materials or (steel,)):
        if k == 0:
            why = "" if found.physics.materials else ", because the file has no material"
            lines.append(f"[material] # {material.name}{why}")
        elif material.group is not None:
            lines += ["", f"[[materials]] # {material.name}", f"group = {toml(material.group)}"]
        if material.young is None:
            lines.append("# it cannot be taken from the file: give young, poisson and density here")
            continue
        note = ", of steel, because the file has none" if material.density is None else ""
        density = steel.density if note else material.density
        lines += [
            f"young = {material.young!r} # {units.name_of('Pa')}",
            f"poisson = {material.poisson!r}",
            f"density = {density!r} # {units.name_of('kg/m³')}{note}",
        ]
    return lines


def _support_lines(found: Inspection, root: str | None) -> list[str]:
    """The tables of the supports, and the names of the other groups that could be one."""
    assert found.boundary is not None
    d = found.geometry.dimension
    most = len(found.boundary) // 2  # larger groups are probably the whole boundary
    facets = [group for group in found.groups if group.kind == "facets" and group.number <= most]
    facets = [group for group in facets if not _is_cut(found, group)]
    likely = [group for group in facets if CLAMPED.search(group.name)]
    others = [group.name for group in facets]
    lines = ["[[supports]] # clamps a part of the boundary"]
    if leaves_support(found):
        lines = ["[[supports]] # a guess: the support of the file is not taken, see below"]
    if root is not None:
        _require_group(found, root, "--root")
        lines.append(f"group = {toml(root)}")
    elif found.physics.supports:
        lines = []
        for place, components in found.physics.supports:
            is_group = isinstance(place, str)
            where = f"group = {toml(place)}" if is_group else f"node = {list(place[:d])}"
            lines += ["[[supports]] # of the file", where]
            if len(components) < d:
                lines.append(f"components = {toml([AXES[k] for k in components])}")
    elif likely:
        lines.append(f"group = {toml(likely[0].name)}")
        others.remove(likely[0].name)
    elif found.sector is not None and facets:
        assert found.points is not None
        near = {g.name: found.sector.distances(found.points[g.members]).mean() for g in facets}
        others.remove(bore := min(near, key=lambda name: near[name]))
        lines.append(f"group = {toml(bore)} # next to the axis")
    elif plane := _end_plane(found):
        point, normal = plane
        lines.append(f"plane = {{ point = {point}, normal = {normal} }} # an end of the body")
    elif facets:
        lines.append(f"group = {toml(others.pop(0))}")
    else:
        lines.append(f"box = {_end_box(found)} # an end of the body")
    if found.pieces > 1 + len(found.physics.joints):
        lines.append(f"# the mesh has {found.pieces} pieces that share no node; clamp each of them")
    if others:
        lines.append(f"# groups of facets: {', '.join(map(toml, others))}")
    return lines


def _cyclic_lines(found: Inspection) -> list[str]:
    """The table of a sector of a disk, for the commands that take it, as comments."""
    sector, points = found.sector, found.points
    if sector is None or points is None:
        return []
    cuts: list[str] = []
    for k in range(2):
        cuts += [
            group.name
            for group in found.groups
            if group.kind == "facets"
            and group.members is not None
            and sector.are_cut(points[np.unique(group.members)])[k].all()
        ][:1]
    if len(cuts) < 2:
        return ["# one sector of a disk: with groups of its cut faces it could have [cyclic]"]
    axis, point = (
        [float(f"{x:.9g}") + 0.0 for x in np.round(of, 9)] for of in (sector.axis, sector.point)
    )
    d = found.geometry.dimension
    return [
        "",
        "# The mesh is one sector of a disk. This table makes it the disk, in fenicsrom modes,",
        "# campbell, run, sweep, compare and response:",
        "# [cyclic]",
        f"# sectors = {sector.number}",
        f"# left = {toml(cuts[0])}",
        f"# right = {toml(cuts[1])}",
        *([f"# axis = {axis}"] if d == 3 else []),
        f"# point = {point[:d]}",
    ]


def _require_group(found: Inspection, name: str, option: str) -> Group:
    """The group of facets or nodes of a name.

    Raises:
        SceneError: the mesh has none.
    """
    groups = [group for group in found.groups if group.kind != "cells"]
    for group in groups:
        if group.name == name:
            return group
    names = ", ".join(dict.fromkeys(group.name for group in groups)) or "none"
    reason = f"{found.path}: {option} {name}: must be a group of facets or nodes: {names}"
    key = option.lstrip("-")
    raise SceneError(reason, kind=ErrorKind.PLACE, key=key, source=str(found.path))


def _end_plane(found: Inspection) -> tuple[list[float], list[float]] | None:
    """Point and normal of an end of the box on which whole facets lie, along its longest axis."""
    d, low, high = found.geometry.dimension, found.low, found.high
    for axis in np.argsort(-(high - low), kind="stable"):
        for end in (low[axis], high[axis]):
            cut = () if found.sector is None else found.sector.places
            if any(np.ptp([*places[:, axis], end]) <= ON_PLANE * found.extent for places in cut):
                continue
            if _facets_at(found, int(axis), float(end)):
                point = [0.0] * d
                point[axis] = float(f"{end:.12g}") if abs(end) > ON_PLANE * found.extent else 0.0
                return point, [float(k == axis) for k in range(d)]
    return None


def _is_cut(found: Inspection, group: Group) -> bool:
    """Whether a group of facets lies on a cut face of a sector."""
    if found.sector is None or found.points is None or group.members is None:
        return False
    corners = found.points[np.asarray(group.members)].reshape(-1, 3)
    return bool(found.sector.are_cut(corners).all(axis=1).any())


def _facets_at(found: Inspection, axis: int, end: float) -> bool:
    """Whether a facet of the boundary, or an edge of a plane cell, lies on a plane."""
    assert found.points is not None and found.boundary is not None
    near = np.abs(found.points[:, axis] - end) <= ON_PLANE * found.extent
    return bool((near[found.boundary].sum(axis=1) >= found.geometry.dimension).any())


def _end_box(found: Inspection) -> list[list[float]]:
    """Corners of a box at the lower end of the longest axis, a tenth of the body long."""
    low, high = found.low.copy(), found.high.copy()
    axis = int(np.argmax(high - low))
    high[axis] = low[axis] + 0.1 * (high[axis] - low[axis])
    return [[float(f"{value:.6g}") for value in corner] for corner in (low, high)]


def leaves_support(found: Inspection) -> bool:
    """Whether the file has a support, but none that can be taken."""
    return found.physics.lost_support and not found.physics.supports


def _task_lines(
    found: Inspection, units: Units, mode: FirstMode, tip: str | None, template: str
) -> list[str]:
    """The load of a template, and its other tables."""
    digits = ON_PLANE * mode.extent
    point = [_in(units, "m", x if abs(x) > digits else 0.0) for x in mode.point]
    point = [float(f"{x:.9g}") for x in point]
    place = f"nearest = {point} # the point that mode 1 moves most"
    if tip is not None:
        place = f"group = {toml(tip)}"
    along = _rounded(mode.direction)
    frequency = float(f"{mode.frequency:.5g}")
    if template == "statics":
        load = [
            "[[loads]] # static: moves the place by about a hundredth of the body",
            place,
            f"direction = {along}",
            _given(units, "force", "N", 10.0 * mode.stiffness * mode.amplitude),
            "",
        ]
        needed = tip is not None or not found.physics.loads
        pulled = all(load.kind == "acceleration" for load in found.physics.loads)
        return [
            *(load if needed else ["[probe]", place, ""] if pulled else []),
            "[statics] # fenicsrom statics SCENE",
            "last = 1.0 # factor on the static loads",
            "",
            *(TIMES_OF_CONTACT if not all(x.tied for x in found.physics.joints) else ()),
        ]
    if template == "rub":
        return _rub_lines(found, units, mode, place, point)
    lines = [
        "[[loads]] # harmonic: at the first frequency, in the direction in which mode 1 moves",
        place,
        f"direction = {along}",
        f"{_given(units, 'force', 'N', mode.force)}; the amplitude becomes about "
        f"{_two_digits(units, 'm', mode.amplitude)} {units.length}",
        f"frequency = {frequency} # Hz, of mode 1",
        "",
    ]
    if template in ("stop", "damper"):
        lines += _contact_lines(found, units, mode, place, tip, template)
    return [
        *lines,
        "[response] # fenicsrom response SCENE",
        f"first = {0.9 * frequency:.5g} # Hz",
        f"last = {1.1 * frequency:.5g}",
        "",
    ]


def _rub_lines(
    found: Inspection, units: Units, mode: FirstMode, place: str, point: list[float]
) -> list[str]:
    """The tables of a blade that turns in an oval casing: the lobes excite it, without a load.

    The blade points along the longest axis of its box, and its first mode moves it in the plane of
    rotation. At a third of the first frequency, no engine order of two lobes meets the mode.
    """
    fastest = TIP_SPEED / (2.0 * math.pi * (1.0 + HUB) * mode.extent)
    rate = min(mode.frequency / 3.0, fastest)
    low, high = found.low, found.high
    along = int(np.argmax(high - low))
    outward = point[along] >= 0.5 * (low + high)[along]
    root, length = (low if outward else high)[along], (high - low)[along]
    centre = 0.5 * (low + high)
    centre[along] = root + (-HUB if outward else HUB) * length
    axis = [f"point = {[float(f'{x:.6g}') for x in centre]} # on the axis: {GUESS}"]
    if found.geometry.dimension == 3:
        across = np.abs(mode.direction)
        across[along] = np.inf
        unit = [float(k == int(np.argmin(across))) for k in range(3)]
        axis = [f"axis = {unit} # {GUESS}", *axis]
    return [
        "[rotation]",
        f"speed_rpm = {float(f'{60.0 * rate:.2g}'):g}",
        *axis,
        "coriolis = true",
        "# speeds_rpm = [first, last] # one model for all speeds, for fenicsrom map",
        "",
        "[[contacts]] # an oval casing that stands still; its lobes excite the blade",
        place,
        _given(units, "gap", "m", GAP * mode.extent),
        _given(units, "normal_stiffness", "N/m", CASING * mode.stiffness),
        _given(units, "tangential_stiffness", "N/m", CASING * mode.stiffness),
        f"friction = {FRICTION}",
        "[contacts.surface]",
        'kind = "cylinder"',
        *axis,
        f"waves = [[2, {_two_digits(units, 'm', LOBE * mode.extent)}, 0.0]] # two lobes: height "
        f"in {units.length}",
        "",
        "[time]",
        f"steps_per_period = {RUB_STEPS} # in a revolution",
        "",
    ]


def _contact_lines(
    found: Inspection, units: Units, mode: FirstMode, place: str, tip: str | None, template: str
) -> list[str]:
    """The table of a contact: against a stop across the motion, or a damper along it."""
    motion = np.array(mode.direction)
    normal, why = motion, "into the plane; along the motion of mode 1"
    group = None if tip is None else _require_group(found, tip, "--tip")
    outward = None if group is None else outer_normal(found, group)
    if outward is not None:
        normal, why = outward, "into the plane; the outer normal of the group"
    if template == "damper":
        across = normal - (normal @ motion) * motion
        if np.linalg.norm(across) < SLIDING:
            across = np.eye(len(motion))[np.abs(motion).argmin()]
            across = across - (across @ motion) * motion
        normal = across / np.linalg.norm(across)
        why = "into the plane; the body slides along it"
    towards = abs(float(normal @ motion))
    if towards < SLIDING:
        stiffness, preload = mode.stiffness, 0.5 * mode.force / FRICTION  # it slips at resonance
        limit = _given(units, "preload", "N", preload)
    else:
        stiffness, gap = STOP * mode.stiffness, 0.5 * mode.amplitude * towards
        limit = _given(units, "gap", "m", gap)
    kind = "a stop" if towards >= SLIDING else "a friction damper"
    return [
        f"[[contacts]] # {kind}",
        place,
        f"normal = {_rounded(normal)} # {why}",
        limit,
        _given(units, "normal_stiffness", "N/m", stiffness),
        _given(units, "tangential_stiffness", "N/m", stiffness),
        *([] if group is None else [_per_region(units, group)]),
        f"friction = {FRICTION}",
        "",
    ]


def _per_region(units: Units, group: Group) -> str:
    """A comment on the units of the contact of a group."""
    per = f"per {units.region(0)}"
    if group.kind != "facets":
        per = f"per {units.region(2)}, on a curve in 3D per {units.region(1)}"
    return f'# of the whole group; with at = "nodes" preload and stiffnesses are {per}'


def outer_normal(found: Inspection, group: Group) -> Array | None:
    """The mean outer normal (d,) of a group of facets; the thin axis for a group of nodes.

    The facets of the boundary go round the body in one sense, and the sum of x · n dA over all of
    them is positive if this sense gives outer normals.

    Returns:
        None if the normals of the facets go round, as in a bore.
    """
    assert found.points is not None and found.boundary is not None and group.members is not None
    d, x = found.geometry.dimension, found.points
    if group.kind != "facets" or d == 2:
        thin = int(np.argmin(group.high - group.low))
        middle = 0.5 * (found.low + found.high)
        side = 1.0 if group.low[thin] >= middle[thin] else -1.0
        return side * np.eye(d)[thin]
    areas = _areas(x, found.boundary)
    volume = np.einsum("ki,ki->", x[found.boundary].mean(axis=1), areas)
    areas = areas[members_of(found.boundary, group.members)]
    normal = areas.sum(axis=0) * np.sign(volume)
    size = float(np.linalg.norm(normal))
    flat = size > FLAT * np.linalg.norm(areas, axis=1).sum()
    return np.asarray(normal / size) if flat else None


def _areas(x: Array, facets: Array) -> Array:
    """The vectors (k, 3) of the areas of facets with corners (k, 3 or 4)."""
    corners = x[facets]
    diagonals = corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]
    if facets.shape[1] == 3:
        diagonals = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.asarray(0.5 * np.cross(*diagonals))


def _in(units: Units, unit: str, value: float) -> float:
    """A number in SI units in the units of the scene."""
    return float(units.from_si(value, unit))


def _two_digits(units: Units, unit: str, value: float) -> str:
    """A number in SI units in the units of the scene, with two digits."""
    return f"{float(f'{_in(units, unit, value):.2g}'):.6g}"


def _given(units: Units, key: str, unit: str, value: float) -> str:
    """A key with its number, with two digits and its unit."""
    return f"{key} = {_two_digits(units, unit, value)} # {units.name_of(unit)}"


def _rounded(direction: Sequence[float] | Array) -> list[float]:
    """A unit vector with three digits after the point."""
    return [round(float(value), 3) + 0.0 for value in direction]
