"""Checks between keys: each function yields the keys that do not agree with the others."""

import math
import re
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.scene.base.rules import POINT_SCHEMA, Problem, Problems, Rule
from fenicsrom.scene.base.tables import entries
from fenicsrom.scene.checks import curve_checks
from fenicsrom.scene.checks.contact_checks import (
    abradable_problems,
    contact_problems,
    joined_problems,
    tie_problems,
)
from fenicsrom.scene.checks.rotation_checks import cyclic_problems, rotation_problems
from fenicsrom.scene.keys import times
from fenicsrom.scene.keys.excitation import excitations
from fenicsrom.scene.keys.loads import Load, SupportDisplacement
from fenicsrom.scene.keys.places import AXES, Elasticity, Place, Region
from fenicsrom.scene.keys.rotation import Rotation
from fenicsrom.scene.keys.schema import Geometry, Scene
from fenicsrom.scene.keys.times import FixedStep, StepsPerPeriod, StepsPerRevolution

STEPS = 10
"""Fewest fixed steps in the shortest period of an excitation."""

ROUNDING = 1e-5
"""The longest step is printed with six digits, and a step with the printed value is accepted."""


def step_problems(scene: Scene) -> Problems:
    """Yield the step of a completed scene if an excitation is too fast for it."""
    fastest = min(excitations(scene), key=lambda found: found.period, default=None)
    if fastest is None or math.isinf(fastest.period):
        return
    key, period = fastest
    shortest = f"the shortest period of {key}, {period:.6g} s"
    if key.endswith(".table"):
        shortest += (
            " (twice its shortest swing; if this is noise, smooth the table, or take a step of "
        )
        shortest += "which all its times are multiples)"
    match scene.time.stepping:
        case FixedStep(step=step) if step > (1.0 + ROUNDING) * period / STEPS:
            allowed = f"must be at most {period / STEPS:.6g}, so that {STEPS} steps resolve"
            yield Problem("time.step", f"{allowed} {shortest}")
        case StepsPerRevolution(steps_per_revolution=steps):
            assert scene.rotation is not None
            slowest = min(speed for _, speed in scene.rotation.history)
            needed = math.ceil((1.0 - ROUNDING) * STEPS * 60.0 / slowest / period)
            if steps < needed:
                allowed = f"must be at least {needed}, so that {STEPS} steps resolve {shortest}"
                yield Problem("time.steps_per_revolution", allowed)
        case StepsPerPeriod(steps_per_period=steps) if scene.period is not None:
            needed = math.ceil((1.0 - ROUNDING) * STEPS * scene.period / period)
            if steps < needed:
                allowed = f"must be at least {needed}, so that {STEPS} steps resolve {shortest}"
                yield Problem("time.steps_per_period", allowed)


def beam_problems(scene: Scene) -> Problems:
    """Yield what the beam of [reference] cannot be compared with."""
    if not scene.reference.beam:
        return
    if scene.reference.beam_section is None:
        allowed = "must be a table with beam = true"
        yield Problem("reference.beam_section", allowed, value=MISSING)
    reasons = {
        "[[materials]]": scene.materials,
        "a material that is not isotropic": not scene.material.is_isotropic,
        "[[attachments]]": scene.attachments,
        "a pressure with follower = true": scene.followers,
    }
    for reason, given in reasons.items():
        if given:
            yield Problem("reference.beam", f"must be false with {reason}")
    for index, support in enumerate(scene.supports):
        for name in ("components", "normal"):
            if getattr(support, name) is not None:
                allowed = "not allowed with reference.beam, whose end is clamped"
                yield Problem(f"supports[{index}].{name}", allowed)


def support_problems(scene: Scene) -> Problems:
    """Yield the problems of the components that the supports clamp, and of a scene without any."""
    if not scene.supports and scene.output.stresses != "none":
        allowed = 'must be "none" without [[supports]], whose reactions come with the stresses'
        yield Problem("output.stresses", allowed)
    for index, support in enumerate(scene.supports):
        yield from _component_problems(scene, f"supports[{index}]", support.components)
        if support.normal is not None and support.components is not None:
            yield Problem(f"supports[{index}].normal", "not allowed with components")


def _component_problems(scene: Scene, key: str, components: tuple[str, ...] | None) -> Problems:
    known = AXES[: scene.geometry.dimension]
    for k, axis in enumerate(components or ()):
        if axis not in known:
            allowed = f"must be {' or '.join(known)} in {len(known)}D"
            yield Problem(f"{key}.components[{k}]", allowed)


def attachment_problems(scene: Scene) -> Problems:
    """Yield the problems of the masses, springs and dashpots."""
    for index, found in enumerate(scene.attachments):
        key = f"attachments[{index}]"
        yield from _component_problems(scene, key, found.components)
        if not (found.mass or found.stiffness or found.stiffness_per_area or found.viscous):
            allowed = "a mass, a stiffness or a damping above 0 must be given"
            yield Problem(f"{key}.mass", allowed, value=MISSING)
        if found.to == found.place:
            yield Problem(f"{key}.to", "must be another place")
        for name in ("mass", "stiffness_per_area", "damping_per_area") if found.to else ():
            if getattr(found, name):
                yield Problem(f"{key}.{name}", "not allowed with to")
        for name in ("stiffness", "damping"):
            per_area = getattr(found, f"{name}_per_area")
            if per_area and not found.place.is_mean:
                allowed = f"only allowed on a whole region; use {name}"
                yield Problem(f"{key}.{name}_per_area", allowed)


def follower_problems(scene: Scene) -> Problems:
    """Yield the problems of the pressures that follow the deformation."""
    if not scene.followers:
        return
    key = f"loads[{scene.followers[0]}].follower"
    if not scene.geometrically_nonlinear:
        yield Problem(key, "only allowed with geometrically_nonlinear = true")
    if "projection" in (scene.basis.elastic_force, *scene.compare.elastic_force):
        yield Problem(key, 'only allowed with elastic_force = "polynomial"')
    if scene.output.stresses != "none":
        allowed = f'must be "none" with {key} = true, whose forces are not in the reactions'
        yield Problem("output.stresses", allowed)


PARALLEL = 1.0 - 1e-6
"""Larger cosines of the angle between two axes count as parallel: the angle is 0.08 degrees."""

WORDS = {
    2: ("two Young's moduli", "[nu12, nu23]", "the number G12"),
    3: ("three Young's moduli", "[nu12, nu13, nu23]", "[G12, G13, G23]"),
}
"""Names of the constants by the number of Young's moduli."""


def material_problems(scene: Scene) -> Problems:
    """Yield the problems of the materials."""
    dimension = scene.geometry.dimension
    yield from _problems_of_one(scene.material, "material", dimension)
    for index, group in enumerate(scene.materials):
        key = f"materials[{index}]"
        yield from _problems_of_one(group, key, dimension)
        if group.group in [other.group for other in scene.materials[:index]]:
            yield Problem(f"{key}.group", "must occur only once")
        if dimension == 3 and group.thickness is not None:
            yield Problem(f"{key}.thickness", "only allowed in 2D")


def _problems_of_one(material: Elasticity, key: str, dimension: int) -> Problems:
    """Yield the problems of the constants and axes of one material."""
    poisson, shear = material.poisson, material.shear
    if not isinstance(material.young, tuple):
        if isinstance(poisson, tuple):
            yield Problem(f"{key}.poisson", "must be a number with one Young's modulus")
        for name in ("shear", "axes"):
            if getattr(material, name) is not None:
                yield Problem(f"{key}.{name}", "not allowed with one Young's modulus")
        return
    count = len(material.young)
    moduli, ratios, shears = WORDS[count]
    if not isinstance(poisson, tuple) or len(poisson) != count:
        yield Problem(f"{key}.poisson", f"must be {ratios} with {moduli}")
    elif shear is None or isinstance(shear, tuple) != (count == 3):
        yield Problem(f"{key}.shear", f"must be {shears} with {moduli}")
    elif not _is_positive_definite(material):
        allowed = (
            "the elastic energy must be positive for every strain: |nu12| < sqrt(E1 / E2) and so "
            "on, and the determinant of the compliance must be positive"
        )
        yield Problem(f"{key}.poisson", allowed, ErrorKind.RANGE)
    axes, key = material.axes or (), f"{key}.axes"
    if dimension == 2 and len(axes) == 2:
        yield Problem(key, "must be one vector in 2D")
    if dimension == 3 and count == 3 and len(axes) == 1:
        yield Problem(key, "must be two vectors with three Young's moduli in 3D")
    if len(axes) == 2 and abs(sum(a * b for a, b in zip(*axes, strict=True))) > PARALLEL:
        yield Problem(key, "the two vectors must not be parallel", ErrorKind.RANGE)


def _is_positive_definite(material: Elasticity) -> bool:
    """Whether the compliance is positive definite: its leading minors are positive."""
    (e1, e2, e3), (nu12, nu13, nu23), _ = material.orthotropic_constants
    a, b, c = nu12 * math.sqrt(e2 / e1), nu13 * math.sqrt(e3 / e1), nu23 * math.sqrt(e3 / e2)
    return max(abs(a), abs(b), abs(c)) < 1.0 and 1.0 - a * a - b * b - c * c - 2.0 * a * b * c > 0.0


FEW_CONTACTS = 4  # up to this number of points, every contact displacement is a coordinate
MORE_CONTACTS = 8  # up to this number, interface modes hold all their directions
INTERFACE_MODES = 10  # number of interface modes for more points, and where derivatives are paired
LEAST_MODES = 3  # number of normal modes with modes = "auto"
REGION_KEYS = ("group", "node", "nearest", "box", "plane")


def problems(scene: Scene, unloaded: bool = False) -> Problems:
    """Yield the keys of a scene that do not agree with each other, in the order of the checks.

    A scene that is `unloaded` may be without loads, contacts, probe and times.
    """
    yield from _geometry_problems(scene.geometry)
    yield from rotation_problems(scene)
    yield from cyclic_problems(scene)
    yield from _vector_problems(scene)
    yield from material_problems(scene)
    yield from beam_problems(scene)
    yield from _place_problems(scene)
    yield from support_problems(scene)
    yield from attachment_problems(scene)
    yield from follower_problems(scene)
    for index, contact in enumerate(scene.contacts):
        yield from contact_problems(contact, f"contacts[{index}]", scene.geometry.dimension)
        yield from abradable_problems(scene, contact, f"contacts[{index}]")
        if contact in scene.contacts[:index]:
            same = scene.contacts.index(contact)
            allowed = f"must differ from contacts[{same}]"
            yield Problem(f"contacts[{index}]", allowed, value="the same contact")
    yield from joined_problems(scene)
    yield from tie_problems(scene)
    for index, load in enumerate(scene.loads):
        yield from _load_problems(load, f"loads[{index}]")
        if load.moves_supports:
            yield from _support_motion_problems(load, f"loads[{index}]", scene.rotation)
    if not scene.is_seen and not unloaded and scene.cyclic is None:
        what = "without contacts and without a load at a place"
        yield Problem("probe", f"must be a table in a scene {what}")
    yield from _basis_problems(scene)
    if not unloaded:
        yield from _time_problems(scene)
    yield from curve_checks.response_problems(scene)
    yield from curve_checks.backbone_problems(scene)
    yield from curve_checks.statics_problems(scene)


def regions(scene: Scene) -> list[tuple[str, Region]]:
    """Give the supports, the places and the second regions of contacts with their keys."""
    supports = [(f"supports[{k}]", support) for k, support in enumerate(scene.supports)]
    seconds = [
        (f"contacts[{k}].against", contact.against)
        for k, contact in enumerate(scene.contacts)
        if isinstance(contact.against, Region)
    ]
    return [*supports, *_places(scene), *seconds]


def _places(scene: Scene) -> list[tuple[str, Place]]:
    """Give the places of a scene with their keys."""
    loads = enumerate(scene.loads)
    places = [(f"loads[{k}]", load.place) for k, load in loads if not load.everywhere]
    places += [(f"contacts[{k}]", contact.place) for k, contact in enumerate(scene.contacts)]
    for k, found in enumerate(scene.attachments):
        places += [(f"attachments[{k}]", found.place)]
        places += [(f"attachments[{k}].to", found.to)] if found.to else []
    return places + ([("probe", scene.probe)] if scene.probe else [])


def _vectors(table: Any, prefix: str = "") -> Iterator[tuple[str, tuple[float, ...]]]:
    """Yield every vector in a table and in the tables inside it, with its key."""
    kind: Any = type(table)
    for name, (rule, _) in entries(kind).items():
        value = getattr(table, name)
        key = f"{prefix}{name}" if isinstance(rule, Rule) else prefix[:-1]
        schema = rule.schema if isinstance(rule, Rule) else {}
        if is_dataclass(value):
            yield from _vectors(value, f"{key}.")
        elif schema is POINT_SCHEMA and value is not None:
            yield key, value
        for index, entry in enumerate(value if isinstance(value, tuple) else ()):
            if is_dataclass(entry):
                yield from _vectors(entry, f"{key}[{index}].")
            elif schema.get("items") is POINT_SCHEMA:
                yield f"{key}[{index}]", entry


def _vector_problems(scene: Scene) -> Problems:
    dimension = scene.geometry.dimension
    for key, vector in _vectors(scene):
        if len(vector) != dimension:
            allowed = f"must have {dimension} components with geometry.dimension = {dimension}"
            yield Problem(key, allowed)


def _place_problems(scene: Scene) -> Problems:
    for key, region in regions(scene):
        given = {name: value for name in REGION_KEYS if (value := getattr(region, name, None))}
        if not given:
            names = [name for name in REGION_KEYS if hasattr(region, name)]
            allowed = f"one of {', '.join(names[:-1])} and {names[-1]} must be given"
            yield Problem(f"{key}.group", allowed)
        if len(given) > 1:
            first, second = list(given)[:2]
            yield Problem(f"{key}.{second}", f"not allowed with {first}")
    cuts = (scene.cyclic.left, scene.cyclic.right) if scene.cyclic else ()
    for key, place in _places(scene):
        if place.group in cuts and key != "probe":
            yield Problem(f"{key}.group", "must not be a cut face of [cyclic]")
        if place.at == "nodes" and not key.startswith("contacts"):
            yield Problem(f"{key}.at", 'only allowed for a contact; use "mean" or "centre"')
        if place.at != "mean" and (place.node or place.nearest):
            other = "node" if place.node else "nearest"
            yield Problem(f"{key}.at", f"not allowed with {other}")


def require_motion(scene: Scene, command: str) -> None:
    """Check that something moves in a scene.

    Raises:
        SceneError: all its loads are static.
    """
    if scene.static_only:
        reason = f"all are static; {command} needs a load that varies, or a time.duration"
        raise refuse(scene.source, reason, ErrorKind.MISSING, "loads")


def require_no_sector(scene: Scene, command: str) -> None:
    """Check that a scene is no sector of a disk, for a command that does not take one.

    Raises:
        SceneError: it is one.
    """
    if scene.cyclic is not None:
        allowed = f"not allowed in fenicsrom {command}: sectors of disks are allowed in fenicsrom "
        allowed += "run, sweep, response, modes, campbell, compare, plan and export --format inp"
        raise refuse(scene.source, allowed, ErrorKind.CONFLICT, "cyclic")


def _load_problems(load: Load, key: str) -> Problems:
    """Yield the keys of a place on which this kind of load cannot act."""
    if load.kind == "force":
        return
    whole = load.everywhere
    where = "the whole body" if whole else "facets"
    why = f"not allowed with {load.kind}, which acts on {where}"
    for name in REGION_KEYS if whole else ("node", "nearest"):
        if getattr(load.place, name) is not None:
            yield Problem(f"{key}.{name}", why)
    if load.place.at != "mean":
        yield Problem(f"{key}.at", why)


def _support_motion_problems(load: Load, key: str, rotation: Rotation | None) -> Problems:
    """Yield the keys that do not agree with a motion of the supports."""
    if load.static:
        allowed = "must vary in time; use acceleration for a constant one"
        yield Problem(f"{key}.{load.kind}", allowed)
    if load.transient and isinstance(load.action, SupportDisplacement):
        allowed = (
            "must have a frequency or harmonics, so that its acceleration is known; use "
            "support_acceleration"
        )
        yield Problem(f"{key}.support_displacement", allowed)
    if rotation is not None:
        yield Problem(f"{key}.{load.kind}", "not allowed with [rotation], whose axis is at rest")


def _geometry_problems(geometry: Geometry) -> Problems:
    suffix, is_step, plane = geometry.mesh.suffix, geometry.is_cad, geometry.dimension == 2
    if plane and geometry.thickness is None:
        yield Problem("geometry.thickness", "must be a number above 0 in 2D")
    if is_step and geometry.size is None:
        yield Problem("geometry.size", "must be the cell size in m for a .step file")
    for k, path in enumerate(geometry.also):
        if path.suffix.lower() == ".geo":
            reason = "must be a mesh or .step file: make a mesh file of a .geo file with gmsh"
            yield Problem(f"geometry.also[{k}]", reason)
        if path.stem in [other.stem for other in geometry.files[: k + 1]]:
            reason = "files must have different names, with which the names of groups begin"
            yield Problem(f"geometry.also[{k}]", reason)
    keys = {
        "thickness": (plane, "in 2D"),
        "plane": (plane, "in 2D"),
        "parameters": (suffix == ".geo", "if mesh is a .geo file"),
        "cells": (suffix == ".geo" or is_step, "if mesh is a .geo or .step file"),
        "size": (is_step, "if mesh is a .step file"),
        "meshing": (is_step, "if mesh is a .step file"),
        "glue": (is_step, "with a .step file: the nodes of a mesh file join its bodies"),
        "scale": (geometry.has_mesh, f"if mesh is a mesh file, not for a {suffix} file"),
    }
    usual = Geometry(mesh=geometry.mesh, dimension=geometry.dimension)
    for name, (allowed, where) in keys.items():
        if not allowed and getattr(geometry, name) != getattr(usual, name):
            yield Problem(f"geometry.{name}", f"only allowed {where}")
    if "structured" in geometry.parameters:
        yield Problem("geometry.parameters.structured", "use geometry.cells instead")


def default_masters(scene: Scene) -> str | int:
    """Give the masters of the basis: the given value, or the default for these contacts."""
    if scene.basis.masters is not None:
        return scene.basis.masters
    regions = any(contact.has_region for contact in scene.contacts)
    if scene.joined:
        return "motion"
    count, paired = len(scene.contacts), scene.basis.derivatives != "principal"
    if not regions and count <= FEW_CONTACTS:
        return "all"
    if regions or paired or count > MORE_CONTACTS:
        return INTERFACE_MODES
    return count * scene.geometry.dimension


def too_small(masters: int) -> str:
    """Say which sizes a basis with a number of contact coordinates may have."""
    return f"must be above {masters}, the number of contact coordinates, which all models hold"


def _basis_problems(scene: Scene) -> Problems:
    basis = scene.basis
    if not scene.contacts:
        if basis.modes == 0:
            yield Problem("basis.modes", "must be at least 1 in a scene without contact")
        if basis.masters is not None:
            yield Problem("basis.masters", "not allowed in a scene without contact")
    if basis.size is not None and not basis.adapts:
        allowed = 'only allowed with derivatives = "principal" and elastic_force = "polynomial"'
        yield Problem("basis.size", allowed)
    if any(contact.has_region for contact in scene.contacts):
        return  # the number of static modes is known only with the mesh
    points, dimension = len(scene.contacts), scene.geometry.dimension
    masters = default_masters(scene)
    each = dimension if masters == "all" else 1
    static = points * each if isinstance(masters, str) else min(masters, points * dimension)
    if basis.size is not None and basis.size <= static:
        yield Problem("basis.size", too_small(static), ErrorKind.RANGE)
    if not isinstance(basis.derivatives, tuple):
        return
    available = {"V": LEAST_MODES if isinstance(basis.modes, str) else basis.modes, "S": static}
    for index, label in enumerate(basis.derivatives):
        modes = re.findall(r"([0-9]+)([VS])", label)
        if any(int(count) > available[kind] for count, kind in modes):
            normal = f"at least {LEAST_MODES}" if basis.modes == "auto" else basis.modes
            allowed = f"the basis has {normal} normal (V) and {static} static (S) modes"
            yield Problem(f"basis.derivatives[{index}]", allowed)


def _time_problems(scene: Scene) -> Problems:
    time = scene.time
    if time.spectral_radius is not None and time.scheme != times.GENERALISED_ALPHA:
        allowed = f'only allowed with scheme = "{times.GENERALISED_ALPHA}"'
        yield Problem("time.spectral_radius", allowed)
    if scene.period is None:
        yield from _duration_problems(scene)
    else:
        yield from _period_problems(scene)


def _duration_problems(scene: Scene) -> Problems:
    """Yield the problems of the times of a scene without a period."""
    time = scene.time
    transient = [index for index, load in enumerate(scene.loads) if load.transient]
    why = f"loads[{transient[0]}] does not repeat" if transient else "no load has a frequency"
    varies = scene.rotation is not None and bool(scene.rotation.history)
    if varies:
        why = "the speed of rotation varies"
    if isinstance(time.span, times.Periodic):
        given = ("steady_tolerance", "steady")
        default = times.Periodic()
        name = next((n for n in given if getattr(time, n) != getattr(default, n)), "periods")
        yield Problem(f"time.{name}", f"use duration, because {why}")
    if scene.static_only:
        if scene.contacts or transient or varies or not isinstance(time.stepping, times.NoStep):
            yield Problem("time.duration", f"must be a number above 0, because {why}")
        return
    duration, either = time.duration or 0.0, "steps_per_revolution, " if varies else ""
    match time.stepping:
        case times.NoStep():
            allowed = f"{either}a step (number above 0) or a tolerance must be given, because {why}"
            yield Problem("time.step", allowed)
        case times.StepsPerPeriod():
            yield Problem("time.steps_per_period", f"use {either}step or tolerance, because {why}")
        case times.StepsPerRevolution() if not varies:
            yield Problem("time.steps_per_revolution", "only allowed with rotation.history")
        case times.FixedStep(step=step):
            if step > duration:
                yield Problem("time.step", f"must be at most the duration of {duration:g}")


def _period_problems(scene: Scene) -> Problems:
    """Yield the problems of the times and frequencies of a scene with a period."""
    time = scene.time
    why = "because the excitation repeats"
    if isinstance(time.span, times.Duration):
        yield Problem("time.duration", f"use periods, {why}")
    if isinstance(time.stepping, times.FixedStep | times.StepsPerRevolution):
        key = fields(time.stepping)[0].name
        yield Problem(f"time.{key}", f"use steps_per_period or tolerance, {why}")
    frequencies = [load.frequency for load in scene.loads]
    lowest = min(filter(None, frequencies), default=0.0)
    for index, frequency in enumerate(frequencies):
        if frequency is not None and abs(math.remainder(frequency, lowest)) > 1e-9 * lowest:
            allowed = f"must be an integer multiple of the lowest frequency, {lowest:.12g}"
            yield Problem(f"loads[{index}].frequency", allowed)
