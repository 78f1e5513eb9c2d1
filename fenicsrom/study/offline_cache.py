"""Offline results in the cache: no stage on the mesh is computed twice.

Three archives belong to a scene. One holds the equilibrium and the component modes, one the
selection, the derivatives, the basis and the reduced models, and one the larger model that has seen
the residual of the full equations along the motion. A run that finds them builds no mesh and no
solid, unless it draws the body or runs the full model. A run that finds the first one only, because
its loads or its friction select other derivatives, computes no equilibrium and no modes. The
results are the same to the last digit. The model for a range of speeds is one archive.

Only runs on one rank use the cache: the arrays of several ranks belong to one partition of a mesh.

The name of an archive is a hash of all that decides its content: the mesh file and the scene with
its defaults, without the keys that this module leaves out.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.notes import Note, NoteKind, has_kind, packed, unpacked
from fenicsrom.online.store import store
from fenicsrom.online.store.scene_changes import SURFACE_KEYS, contact_keys
from fenicsrom.progress import log
from fenicsrom.scene import Contact, Load, Scene, Surface, scene_table
from fenicsrom.scene.base.rules import BY_MOTION
from fenicsrom.scene.base.tables import plain
from fenicsrom.scene.keys.excitation import highest_frequency
from fenicsrom.study import building
from fenicsrom.study.scene_stages import offline_stages, with_stresses

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.study.stage import Run


ONLINE_TABLES = (
    "title reference output compare campbell map damping response backbone ringdown statics loads "
    "contacts time"
).split()
"""Keys and tables that do not matter as such; `modes_table` and `model_table` add their parts."""


def modes_table(scene: Scene) -> dict[str, Any]:
    """The values, without the mesh file, on which mesh, equilibrium and component modes depend."""
    table = {name: value for name, value in scene_table(scene).items() if name not in ONLINE_TABLES}
    table["material"] = {**table["material"], "mass_damping": None}
    table["basis"] = {
        k: v for k, v in table["basis"].items() if k in ("method", "modes", "masters")
    }
    table["loads"] = [_shape(load) for load in scene.loads]
    keys = contact_keys(scene.joined)
    table["contacts"] = [_frames(contact, keys) for contact in scene.contacts]
    if scene.basis.masters == "motion":
        table["trained"] = [model_table(scene), motion_table(scene)]
        table["trained"] += map(plain, (scene.damping, scene.backbone, scene.response))
    if scene.basis.modes == "auto":
        table["excitation"] = highest_frequency(scene)
    return table


def model_table(scene: Scene) -> dict[str, Any]:
    """The values on which the reduced model depends, besides `modes_table`.

    The linear transient, which selects modes and derivatives, depends on nearly all of the scene.
    """
    from fenicsrom.reduction.snapshots import transient_time

    basis = scene.basis
    table: dict[str, Any] = {
        "basis": {**plain(basis), "accuracy": None, "size": None},
        "damping": plain(scene.damping),
        "stresses": scene.output.stresses,
    }
    if scene.geometrically_nonlinear and basis.derivatives in BY_MOTION:
        whole = scene_table(scene)
        table |= {name: whole.get(name) for name in ("loads", "contacts", "material", "response")}
        if scene.backbone is not None and basis.derivatives == "principal":
            table["backbone"] = (scene.backbone.mode, scene.backbone.last)
        table["time"] = plain(transient_time(scene))
        table["excitation"] = highest_frequency(scene)
    return table


def motion_table(scene: Scene) -> dict[str, Any]:
    """The values on which the motion depends, besides `modes_table` and `model_table`."""
    whole = scene_table(scene)
    return {name: whole.get(name) for name in ("loads", "contacts", "material", "time", "basis")}


def keys_of(scene: Scene) -> tuple[str, str, str] | None:
    """The hashes of `modes_table`, with `model_table`, and with `motion_table`.

    None if the mesh file reads other files.

    Raises:
        OSError: the mesh file cannot be read.
    """
    mesh = store.mesh_digest(scene.geometry.files)
    if mesh is None:
        return None
    modes = modes_table(scene)
    modes["geometry"] = {**modes["geometry"], "mesh": mesh}
    modes["suffix"] = scene.geometry.mesh.suffix
    model = model_table(scene)
    return (
        store.key_of(modes),
        store.key_of([modes, model]),
        store.key_of([modes, model, motion_table(scene)]),
    )


def _shape(load: Load) -> Any:
    """The values on which a unit load depends; all values of a load that deforms the body."""
    if load.static:
        return plain(load)
    without_size = {**plain(load.action), load.kind: None}
    return {**(plain(load.place) or {}), **without_size, "varies": True}


def _frames(contact: Contact, keys: tuple[str, ...]) -> dict[str, Any]:
    """The values of a contact on which its points and their frames depend, by these keys."""
    table = _without(plain(contact), Contact, keys)
    if contact.surface is not None:
        table["surface"] = _without(table["surface"], Surface, SURFACE_KEYS)
    return table


def _without(table: dict[str, Any], kind: type, kept: tuple[str, ...]) -> dict[str, Any]:
    """A table without the fields of a dataclass, except the fields to keep."""
    dropped = {field.name for field in fields(kind)} - set(kept)
    return {name: value for name, value in table.items() if name not in dropped}


MODES_STAGES = ("mesh", "solid", "interface vectors", "modes")
MODEL_STAGES = (
    "linear transient",
    "nonlinear statics",
    "selection",
    "derivatives",
    "basis",
    "candidates",
    "reduction",
    "finer elements",
    "stress points",
)
"""The stages whose results the first two archives hold."""

RESIDUAL = "residual"
"""The stage whose larger model the third archive holds. It finds the motion of this model again."""

BODY = MODES_STAGES[:2]
"""The stages of the body, which a later stage may need in spite of their known results."""

Contents = tuple[dict[str, Any], dict[str, Any]]

WHAT = "the offline results"
SOLID = ("free", "extent", "loaded", "unstable", "equilibrium", "interface", "points")
EQUILIBRIUM = ("deflection", "deformation", "trained")
"""Attributes of the solid and of the record that the first archive holds."""

FINER = ("finer", "finer_labels", "finer_frequencies_hz")


class Late:
    """Stands for an object, such as a solid; an attribute that is not known makes the object."""

    def __init__(self, make: Callable[[], Any], **known: Any):
        """Keep the function that makes the object, and attributes with their values."""
        self._make = make
        self._made: Any = None
        self.__dict__ |= known

    def __getattr__(self, name: str) -> Any:
        """Give an attribute of the object, which is made at the first call."""
        if self._made is None:
            self._made = self._make()
        return getattr(self._made, name)


class OfflineCache:
    """The archives of a scene.

    Attributes:
        reused: names of the stages whose results were read.
    """

    def __init__(self, run: Run, folder: Path, keys: tuple[str, str, str]):
        """Store the run, the folder and the hashes of the archives."""
        self._run, self._folder, self._keys = run, folder, keys
        self._warned, self._judged = 0, False
        self._last = "stress points" if with_stresses(run.study.scene) else "finer elements"
        self.reused: tuple[str, ...] = ()

    def restore(self) -> None:
        """Read the stored results into the record, and say which results these are."""
        if not self._read(0, _read_modes):
            return
        self.reused = MODES_STAGES
        self._warned = len(self._run.study.warnings)
        if self._read(1, _read_model):
            self.reused += MODEL_STAGES[: MODEL_STAGES.index(self._last) + 1]
            self._judged = self._read(2, _read_judge)
        building.check_size(self._run.study)
        listed = offline_stages(self._run.study.scene, modes_only=False)
        names = [one.name for one in listed if one.needed and self.has(one.name)]
        log.info(f"taken from an earlier run: {', '.join(names)} (--fresh computes them again)")
        reason = "taken from an earlier run; --fresh computes it again"
        self._run.study.left_out += [Note(NoteKind.LEFT_OUT, reason, name) for name in names]

    def has(self, stage: str) -> bool:
        """Whether the results of a stage were read."""
        return stage in self.reused

    def keep(self, stage: str) -> None:
        """Write an archive after its last stage."""
        if stage == MODES_STAGES[-1]:
            self._warned = len(self._run.study.warnings)
            self._write(0, _modes_contents(self._run))
        elif stage == self._last:
            self._write(1, _model_contents(self._run, self._warned))
        elif stage == RESIDUAL and not self._judged and self._run.study.judge is not None:
            from fenicsrom.online.store.archive import model_contents

            self._write(2, model_contents(self._run.study.judge))

    def _read(self, which: int, take: Callable[[Run, Any, Any], None]) -> bool:
        """Take the contents of an archive into the record; False if it is missing or damaged."""

        def taken(header: Any, arrays: Any) -> bool:
            take(self._run, header, arrays)
            return True

        return bool(store.read_results(self._folder, self._keys[which], WHAT, taken))

    def _write(self, which: int, contents: Contents) -> None:
        """Write an archive."""
        store.write_results(self._folder, self._keys[which], WHAT, *contents)


def offline_cache(run: Run, fresh: bool) -> OfflineCache | None:
    """The cache of a run; None if it has no archives, or is switched off.

    Args:
        run: a run up to a reduced model that can be stored; on a mesh of its scene.
        fresh: whether to ignore the results in the cache. The damaged files are written again.
    """
    place = None if run.comm.size > 1 or run.mesh is not None else _place(run.study.scene)
    found = None if place is None else OfflineCache(run, *place)
    if found is not None and not fresh:
        found.restore()
    return found


def _place(scene: Scene) -> tuple[Path, tuple[str, str, str]] | None:
    """The folder and the hashes of the archives; None if a scene has none."""
    folder = store.cache_folder()
    try:
        keys = keys_of(scene)
    except OSError:  # the mesh stage says what is wrong with the file
        return None
    return None if folder is None or keys is None else (folder, keys)


def kept_range(scene: Scene, fresh: bool, build: Callable[[], StoredModel]) -> StoredModel:
    """The model for a range of speeds, of an earlier run if the cache has it.

    Args:
        scene: the scene; the hash of its motion names the archive.
        fresh: build it also if the cache has it.
        build: builds it.
    """
    from fenicsrom.online.store.archive import model_contents, model_of_contents

    if (place := _place(scene)) is None:
        return build()
    folder, key = place[0], place[1][2]
    take = partial(model_of_contents, Path(scene.source))
    found = None if fresh else store.read_results(folder, key, WHAT, take)
    if found is None:
        found = build()
        store.write_results(folder, key, WHAT, *model_contents(found))
    else:
        log.info("taken from an earlier run: the model for all speeds (--fresh computes it again)")
    return replace(found, scene=scene, file="")


def _modes_contents(run: Run) -> Contents:
    """The archive of the equilibrium and the modes."""
    study, solid = run.study, run.study.solid
    # the notes on fast loads depend on loads that may change
    notes = (note for note in study.warnings if not has_kind([note], NoteKind.BASIS))
    kept = {
        "solid": {name: getattr(solid, name) for name in SOLID},
        "modes": study.modes,
        "equilibrium": {name: getattr(study, name) for name in EQUILIBRIUM},
        "body": _fingerprint(solid),
        "warnings": packed(notes),
    }
    tree, arrays = store.pack(kept, {"ComponentModes": store.without("inverse")}, named=True)
    return {"tree": tree}, arrays


def _read_modes(run: Run, header: Any, arrays: Any) -> None:
    """Read the equilibrium and the modes into the record."""
    from fenicsrom.online.contact.points import ContactPoints
    from fenicsrom.online.store.scene_changes import Trained
    from fenicsrom.online.stress.stress import Deformation
    from fenicsrom.reduction.load_responses import LoadVectors
    from fenicsrom.reduction.modes import ComponentModes, ConstrainedInverse

    classes = {kind.__name__: kind for kind in (ContactPoints, Deformation, LoadVectors, Trained)}
    kept = store.unpack(header["tree"], arrays, {**classes, "ComponentModes": dict})
    scene, body, modes = run.study.scene, kept["body"], kept["modes"]
    solid: Any = Late(
        lambda: _build(run, scene, body),
        **kept["solid"],
        comm=run.comm,
        warnings=unpacked(kept["warnings"]),
    )
    inverse: Any = Late(lambda: solid.factor)
    if modes["method"] == "craig-bampton" and modes["rows"].shape[0]:
        inverse = ConstrainedInverse(inverse, modes["rows"], modes["masters"], solid)
    found = ComponentModes(inverse=inverse, **modes)
    run.study.solid = solid
    for name in EQUILIBRIUM:
        setattr(run.study, name, kept["equilibrium"][name])
    building.set_modes(run, found)


def _model_contents(run: Run, warned: int) -> Contents:
    """The archive of the stages after the modes, which added warnings to the first ones."""
    from fenicsrom.online.store.archive import model_contents

    study = run.study
    assert study.basis is not None
    model, arrays = model_contents(study.stored)
    kept = {
        "selection": study.selection,
        "mesh_check": study.mesh_check,
        "derivatives": study.derivatives,
        "extended": study.extended,
        "basis": {key: getattr(study.basis, key) for key in ("masters", "dropped", "condition")},
        "warnings": packed(study.warnings[warned:]),
    }
    forms = {"Selection": store.without("principal"), "Derivatives": store.without("further")}
    tree, more = store.pack(kept, forms, named=True)
    return {"model": model, "tree": tree}, arrays | more


def _read_model(run: Run, header: Any, arrays: Any) -> None:
    """Take the results of the stages after the modes into the record."""
    from fenicsrom.assess.errors.comparisons import MeshCheck
    from fenicsrom.online.store.archive import model_of_contents
    from fenicsrom.reduction.basis import ReducedBasis
    from fenicsrom.reduction.derivatives import Selection
    from fenicsrom.reduction.stages import Derivatives

    study = run.study
    classes = {kind.__name__: kind for kind in (MeshCheck, ReducedBasis, Selection, Derivatives)}
    kept = store.unpack(header["tree"], arrays, classes)
    open_size = replace(study.scene, basis=replace(study.scene.basis, size=None))
    stored = model_of_contents(Path(study.scene.source), header["model"], arrays)
    stored = stored.with_scene(open_size)  # `restore` checks the size
    vectors = kept["extended"].vectors[:, : stored.size]
    basis = ReducedBasis(stored.method, vectors, stored.labels, **kept["basis"])
    # nothing raises from here on: the record has all or nothing
    study.basis = basis
    for name in ("selection", "mesh_check", "derivatives", "extended"):
        setattr(study, name, kept[name])
    for name in ("model", "candidates", "tables", "further", *FINER):
        setattr(study, name, getattr(stored, name))
    study.warnings.extend(unpacked(kept["warnings"]))
    building.note_selection(study)


def _read_judge(run: Run, header: Any, arrays: Any) -> None:
    """Take the larger model that has seen the residual into the record, without its motion."""
    from fenicsrom.online.store.archive import model_of_contents

    scene = run.study.scene
    stored = model_of_contents(Path(scene.source), header, arrays)
    run.study.judge = stored.with_scene(replace(scene, basis=replace(scene.basis, size=None)))


def _build(run: Run, scene: Scene, body: str) -> Solid:
    """Build the solid of a scene in its known equilibrium.

    Raises:
        AccuracyError: the mesh has other nodes than the mesh of the results.
    """
    from fenicsrom.fem.solid.solid import KnownEquilibrium, solid_of

    user = f'the stage "{run.watch.stage}" needs the body' if run.watch.stage else "they are used"
    kept = "; the equilibrium is the earlier one" if run.study.solid.loaded else ""
    log.info(f"{', '.join(BODY)}: made again, because {user}{kept}")
    left_out = run.study.left_out
    left_out[:] = [note for note in left_out if note.key not in BODY]
    with run.watch("mesh"):
        building.mesh(run)
    assert run.mesh is not None
    with run.watch("solid"):
        known = KnownEquilibrium(run.study.solid.equilibrium, run.study.solid.unstable)
        solid = solid_of(scene, run.mesh, known, free=True)
    if _fingerprint(solid) != body:
        raise AccuracyError(
            f"{scene.source}: the mesh differs from the one of the results in the cache; "
            "run again with --fresh",
            kind=ErrorKind.MISMATCH,
        )
    solid.warnings = run.study.warnings  # they hold those of the mesh already
    return solid


def _fingerprint(solid: Any) -> str:
    """A hash of the order and places of the nodes."""
    return hashlib.sha256(solid.space.tabulate_dof_coordinates().tobytes()).hexdigest()
