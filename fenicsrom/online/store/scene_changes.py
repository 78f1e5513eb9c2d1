"""Keys that may change between two scenes of a stored model or of a continued run."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from typing import Any, Self

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.model.disk_model import load_diameters
from fenicsrom.scene import (
    Contact,
    Load,
    Overrides,
    Scene,
    override_table,
    parse_scene,
    scene_table,
    titled,
)
from fenicsrom.scene.reading.overrides import override_in_si, override_texts

# keys of a contact and of its surface on which the offline stages depend
CONTACT_KEYS = ("place", "normal", "against", "neighbour", "reach", "surface")
REST_KEYS = ("preload", "gap", "approach", "normal_stiffness", "tangential_stiffness")
SPEED_KEYS = ("speed_rpm", "history")
SURFACE_KEYS = ("kind", "point", "axis", "inside")  # the frames of the contact points follow

# keys of [time] that only determine when a run ends
END_KEYS = ("periods", "duration", "steady_tolerance", "steady")

Change = tuple[str, Any, Any]
"""A key of the scene, its value before and its value now."""


@dataclass(frozen=True)
class Trained:
    """What the motions hold that chose the interface vectors of bodies that touch.

    Attributes:
        loads: the largest size of each load of the scene.
        friction: the smallest coefficient of each contact.
        amplitude: the largest half of the range of the probe, m.
        duration: the length of the longest motion without a period, s; 0 without any.
        dissipation: the largest energy that friction dissipates in a motion, J.
        changed: how the equilibrium differs from theirs (`rest_changes`).
    """

    loads: tuple[float, ...]
    friction: tuple[float, ...]
    amplitude: float
    duration: float
    dissipation: float
    changed: tuple[Change, ...] = ()

    def after(self, changes: tuple[Change, ...]) -> "Trained":
        """The same, after further `rest_changes`."""
        known = {key: (was, now) for key, was, now in self.changed}
        known |= {key: (known.get(key, (was,))[0], now) for key, was, now in changes}
        moved = ((key, was, now) for key, (was, now) in known.items() if was != now)
        return replace(self, changed=tuple(moved))


def contact_keys(joined: bool) -> tuple[str, ...]:
    """The keys of contacts on which the offline stages depend, those between bodies or not."""
    return CONTACT_KEYS + (REST_KEYS if joined else ())


def first_difference(one: Any, other: Any, names: Iterable[str]) -> str | None:
    """The first of these attributes in which two objects differ, or None."""
    return next((name for name in names if getattr(one, name) != getattr(other, name)), None)


def rest_changes(made: Scene, wanted: Scene) -> tuple[Change, ...]:
    """What moves the equilibrium of bodies that touch; nothing of other bodies.

    The speed of a model for a range of speeds counts if motions chose its interface vectors.
    """
    if not made.joined:
        return ()
    one, other = (_at_rest(scene) for scene in (made, wanted))
    return tuple((key, was, other[key]) for key, was in one.items() if was != other[key])


def _at_rest(scene: Scene) -> dict[str, Any]:
    """The values on which the equilibrium of bodies that touch depends, by their keys."""
    tables = {"contacts": REST_KEYS, "bolts": ("force",)}
    found = {
        f"{table}.{k}.{name}": getattr(one, name)
        for table, names in tables.items()
        for k, one in enumerate(getattr(scene, table))
        for name in names
    }
    if scene.rotation is not None and scene.speeds_rpm and scene.basis.masters == "motion":
        found |= {f"rotation.{name}": getattr(scene.rotation, name) for name in SPEED_KEYS}
    return found


def changed_path(made: Scene, wanted: Scene) -> str | None:
    """As `changed_key`, with the first entry that differs in a table: for messages."""
    name = changed_key(made, wanted)
    scenes = (made, _with_allowed(made, wanted))
    one, other = (getattr(scene, name or "", None) for scene in scenes)
    if name is None or not (is_dataclass(one) and is_dataclass(other)):
        return name
    inner = first_difference(one, other, (entry.name for entry in fields(one)))
    return f"{name}.{inner}"


def changed_key(made: Scene, wanted: Scene) -> str | None:
    """The first key of the offline stage in which two scenes differ, or None.

    A stored model allows other sizes and histories of the loads that vary, another damping, other
    contact parameters and another time integration, bodies that touch other forces of the bolts,
    and a disk another mistuning and other damping ratios. The contacts and bolts of bodies
    that touch stay in a disk, in a range of speeds, and under follower pressures. The mesh file may
    be in another folder.
    """
    wanted = _with_allowed(made, wanted)
    names = "geometry geometrically_nonlinear materials supports attachments bolts ties rotation"
    names += " damping probe basis material cyclic"
    if (name := first_difference(made, wanted, names.split())) is not None:
        return name
    contact_key = partial(_changed_contact_key, contact_keys(_keeps_rest(made)))
    for table, changed in (("loads", _changed_load_key), ("contacts", contact_key)):
        ours, theirs = getattr(made, table), getattr(wanted, table)
        if len(ours) != len(theirs):
            return table
        for k, pair in enumerate(zip(ours, theirs, strict=True)):
            if (name := changed(*pair)) is not None:
                return f"{table}[{k}]{name}"
    return None


def require_same_model(made: Scene, wanted: Scene, source: str) -> None:
    """Check that the model of a scene is that of another one.

    Args:
        made: the scene of the model.
        wanted: the scene under which it shall run.
        source: names that scene in messages.

    Raises:
        SceneError: the error names the first key of the offline stage that differs.
    """
    if (key := changed_key(made, wanted)) is not None:
        reason = "cannot change on a stored reduced model; run the scene again, without --from"
        text = f"{source}: {changed_path(made, wanted)} {reason}"
        raise SceneError(text, kind=ErrorKind.MISMATCH, key=key, source=source)


def changed_scene(
    scene: Scene, overrides: Overrides, source: str = "", *, si: bool = False
) -> Scene:
    """A scene with other values, which its title names; its paths stay as they are.

    Args:
        scene: the scene.
        overrides: as `StoredModel.with_overrides` takes them.
        source: the file that messages name; by default that of the scene.
        si: whether the values are in SI units, and not in those of the scene's [units].

    Raises:
        SceneError: an override is wrong.
    """
    source, overrides = source or scene.source, override_texts(overrides)
    if not si:
        overrides = [override_in_si(scene, override) for override in overrides]
    changed = override_table(scene_table(scene), overrides, source)
    found = parse_scene(titled(changed, overrides, scene.source), source, None)
    return replace(found, source=scene.source)


def shares_model(made: Scene, wanted: Scene) -> bool:
    """Whether the model of a scene is that of another one, chosen by the same motion or waves."""
    motion = ("loads", "contacts", "material") if made.basis.masters == "motion" else ()
    if made.cyclic is not None and load_diameters(made) != load_diameters(wanted):
        return False
    if changed_key(made, wanted) is not None or rest_changes(made, wanted):
        return False
    return first_difference(made, wanted, motion) is None


def _keeps_rest(made: Scene) -> bool:
    """Whether the equilibrium of bodies that touch cannot be found again without a mesh."""
    several = made.cyclic is not None or made.speeds_rpm is not None
    return made.joined and (several or bool(made.followers))


def _with_allowed(made: Scene, wanted: Scene) -> Scene:
    """The wanted scene with the folder of the mesh, the damping α and open modes as made.

    The accuracy and the size of the basis may change too, and the speed of a model for a range.
    """
    basis, geometry = wanted.basis, wanted.geometry
    basis = replace(basis, accuracy=made.basis.accuracy, size=made.basis.size)
    if basis.modes == "auto":  # a stored model keeps its modes
        basis = replace(basis, modes=made.basis.modes)
    names = [[file.name for file in one.files] for one in (geometry, made.geometry)]
    if names[0] == names[1]:
        geometry = replace(geometry, mesh=made.geometry.mesh, also=made.geometry.also)
    material = replace(wanted.material, mass_damping=made.material.mass_damping)
    found = replace(wanted, basis=basis, geometry=geometry, material=material)
    if len(made.bolts) == len(wanted.bolts) and not _keeps_rest(made):
        pairs = zip(made.bolts, wanted.bolts, strict=True)
        found = replace(found, bolts=tuple(replace(b, force=a.force) for a, b in pairs))
    if made.cyclic is not None and wanted.cyclic is not None:
        alike = replace(wanted.cyclic, mistuning=made.cyclic.mistuning)
        damping = replace(made.damping, stiffness=wanted.damping.stiffness)
        found = replace(found, cyclic=alike, damping=damping)
    before, rotation = made.rotation, wanted.rotation
    if before is None or rotation is None or before.speeds_rpm is None:
        return found
    kept = replace(rotation, speed_rpm=before.speed_rpm, history=before.history)
    return replace(found, rotation=kept)


def _changed_load_key(made: Load, wanted: Load) -> str | None:
    if (name := first_difference(made, wanted, ("place", "direction", "follower"))) is not None:
        return f".{name}"
    if made.kind != wanted.kind:
        return f".{wanted.kind}"
    return ": a static load" if (made.static or wanted.static) and made != wanted else None


def _changed_contact_key(keys: Iterable[str], made: Contact, wanted: Contact) -> str | None:
    names = [name for name in keys if name != "surface"]
    if (name := first_difference(made, wanted, names)) is not None:
        return f".{name}"
    if made.surface is None or wanted.surface is None:
        return None if made.surface == wanted.surface else ".surface"
    name = first_difference(made.surface, wanted.surface, SURFACE_KEYS)
    return None if name is None else f".surface.{name}"


def changed_run_key(made: Scene, wanted: Scene) -> str | None:
    """The first key that differs between two scenes of a model and is fixed in a run, or None.

    A run that continues may only end at another time: `END_KEYS`.
    """
    names = "geometrically_nonlinear material attachments bolts ties rotation damping loads"
    names += " contacts"
    if (name := first_difference(made, wanted, names.split())) is not None:
        return name
    steps = ("steps_per_period", "steps_per_revolution", "tolerance", "step")
    settings = ("scheme", "spectral_radius", *steps)
    if (name := first_difference(made.time, wanted.time, settings)) is not None:
        return f"time.{name}"
    return "time" if (made.period is None) != (wanted.period is None) else None


class UnderScenes:
    """What is stored with its scene, and runs under others that share its offline stage.

    Attributes:
        scene: the scene.
        file: the file from which it was read, for messages; "" if there is none.
    """

    scene: Scene
    file: str

    def with_scene(self, scene: Scene) -> Self:
        """The same under the loads, damping, contacts and time integration of a scene.

        Args:
            scene: a scene that agrees with the stored scene in all keys of the offline stage.

        Raises:
            SceneError: the scenes do not agree; the error names the first key that differs. Or the
                model has no such `basis.size`, or no disk can move so.
        """
        found: Self = self._with_scene(scene, scene.source)
        return found

    def with_overrides(self, overrides: Overrides, si: bool = False) -> Self:
        """The same under its scene with other values.

        Args:
            overrides: as `--set` takes them, such as "loads.0.force=200", one or several; or a
                dict, such as {"loads.0.force": 200.0}.
            si: whether the numbers are in SI units, also if the scene has other [units].

        Raises:
            SceneError: an override is wrong, or changes a key of the offline stage.

        Example:
            >>> import fenicsrom as fr
            >>> stored = fr.load_model("out/beam.npz")
            >>> for force in (50, 100):
            ...     motion = stored.with_overrides(f"loads.0.force={force}").simulate()
            ...     print(f"{force} N: {1e3 * fr.amplitudes(motion)['tangential'][0]:.1f} mm")
            50 N: 13.9 mm
            100 N: 103.2 mm
        """
        source = self.file or self.scene.source
        changed = changed_scene(self.scene, overrides, source, si=si)
        found: Self = self._with_scene(changed, source)
        return found

    def with_values(self, values: Mapping[str, Any]) -> Self:
        """As `with_overrides`, with numbers in SI units."""
        return self.with_overrides(dict(values), si=True)

    def _with_scene(self, scene: Scene, source: str) -> Any:
        """As `with_scene`; messages name this source of the scene."""
        raise NotImplementedError
