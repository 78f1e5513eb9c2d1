"""Stored reduced models: everything the online stage needs, in one `.npz` file without dolfinx.

The arrays, in SI units, have the names of the attributes that hold them, from those of
`StoredModel` on: `model.mass`, `model.elastic.stiffness`, `tables.stress.gradients`, and of a model
for a range of speeds `whole.centrifugal`. The records state their shapes and units. A file with
a larger model has `candidates` and no `model`, which is the first `size` coordinates of the larger
one. The cubic coefficients are the different ones (`fenicsrom.online.model.polynomial`).

The entry `header` is JSON text: the format, the scene with its source, and the tree of all other
attributes (`fenicsrom.online.store.store.pack`). The entry `digest` is the SHA-256 of all other
entries: a file that was changed is refused.

`fenicsrom.online.store.scene_changes` states which keys may change when a stored model runs again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.contact.points import ContactPoints, contacts_of, paired
from fenicsrom.online.contact.surfaces import Coating, Contacts, history_of, speed_history
from fenicsrom.online.contact.together import all_closed, require_planes
from fenicsrom.online.model.bolts import Bolts
from fenicsrom.online.model.disk_model import Sector
from fenicsrom.online.model.loads import PressurePolynomial
from fenicsrom.online.model.model import ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial, paired_cubic, unique_cubic
from fenicsrom.online.model.subspace import about, nested_model
from fenicsrom.online.model.turning import Turning
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.online.step.speed_range import AtSpeed, RangeErrors, RangeModel
from fenicsrom.online.step.statics import together
from fenicsrom.online.store.disk import StoredDisk
from fenicsrom.online.store.scene_changes import (
    Change,
    Trained,
    UnderScenes,
    require_same_model,
    rest_changes,
)
from fenicsrom.online.store.store import pack, unpack, without
from fenicsrom.online.stress.reactions import ReactionTable, Recovery, reduced_modes
from fenicsrom.online.stress.stress import Deformation, StressLaw, StressTable, deformation_at
from fenicsrom.scene import Bolt, Scene, parse_scene, scene_table
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import brief

FORMAT = "fenicsrom reduced model 10"
SUPERELEMENT = "superelement"  # the method of a model that was made of matrices
EARLIER = "fenicsrom reduced model"  # start of the names of earlier formats
UNJUDGED_REST = "the equilibrium under other contacts or bolts is not known on finer elements"
Meshes = tuple[ReducedModel, ReducedModel, list[int]]


@brief("scene", "method", "size", "labels", "frequencies_hz", "dofs", "model", "recovery", "file")
@dataclass(frozen=True, eq=False, repr=False)
class StoredModel(UnderScenes):
    """A reduced model with its scene, as a file holds it.

    Attributes:
        model: the model, under the load histories and the damping of the scene.
        scene: the scene from which the model was made, or under which it runs.
        method: "rubin", "craig-bampton" or "superelement".
        labels: (n,) labels of the coordinates of the model.
        dofs: number of free unknowns of the solid.
        frequencies_hz: (v,) natural frequencies of the normal modes.
        provenance: versions of the programs that made it, by name.
        tables: tables of the stresses and reactions for all coordinates, those of `further`
            included; None if the scene did not ask for them.
        candidates: the larger model that judges the basis, whose first n coordinates are those of
            the model; None if it was not made.
        deformation: extremes of the deformation in the equilibrium; None of an undeformed body.
        file: the file from which it was read, for messages; "" if there is none.
        further: labels of the other coordinates of the larger model.
        finer: the model of finer elements, which judges the mesh; None if it was not made.
        finer_labels: labels of its coordinates.
        finer_frequencies_hz: (v,) those of `frequencies_hz` with finer elements; (0,) unknown.
        unjudged: why there is no model of finer elements; "" if there is one.
        whole: the model for a range of speeds from which the model at the speed of the scene
            follows; None of a model for one speed.
        trained: what the motions hold that chose the interface vectors; None without such vectors.
        notes: notes on the solid of a model for a range of speeds (`fenicsrom.notes.packed`).
    """

    model: ReducedModel
    scene: Scene
    method: str
    labels: tuple[str, ...]
    dofs: int
    frequencies_hz: Array
    provenance: dict[str, str]
    tables: Recovery | None = None
    candidates: ReducedModel | None = None
    deformation: Deformation | None = None
    file: str = ""
    further: tuple[str, ...] = ()
    finer: ReducedModel | None = None
    finer_labels: tuple[str, ...] = ()
    finer_frequencies_hz: Array = field(default_factory=lambda: np.zeros(0))
    unjudged: str = ""
    whole: RangeModel | None = None
    trained: Trained | None = None
    notes: Sequence[Sequence[str]] = ()

    @property
    def meshes(self) -> Meshes | None:
        """The models of the same coordinates on the elements of the mesh and on finer ones.

        A list gives for each of these coordinates its number in the model of this file, or -1 if
        that model lacks it.

        Raises:
            ConvergenceError: the finer elements have no equilibrium at the speed of the scene.
        """
        finer, labels = self.finer, self.finer_labels
        if self.whole is not None and self.whole.finer is not None:
            found = replace(self, whole=self.whole.finer).at_speed()
            known = {*self.labels, *self.further}
            found = found.resized([label for label in found.labels if label in known])
            finer, labels = found.model, found.labels
        if finer is None:
            return None
        numbered = {label: number for number, label in enumerate(self.labels)}
        numbers = [numbered.get(label, -1) for label in labels]
        return self.resized(labels).model, finer, numbers

    @property
    def normal_modes(self) -> dict[int, float]:
        """Frequencies in Hz of the structure's modes among the coordinates, by their numbers.

        They are nan where the normal modes are those of a held interface.
        """
        count = self.frequencies_hz.size
        if self.method == "craig-bampton":
            return dict.fromkeys(range(1, count + 1), math.nan)
        numbers = [int(label[:-1]) for label in self.labels if re.fullmatch(r"\d+V", label)]
        return {k: float(self.frequencies_hz[k - 1]) for k in sorted(numbers) if k <= count}

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.model.size

    @property
    def recovery(self) -> Recovery | None:
        """The tables of the stresses and reactions for the coordinates of the model."""
        return None if self.tables is None else self.tables.of(range(self.size))

    @property
    def least_size(self) -> int:
        """The fewest coordinates that the model may have: those of the contact and one more."""
        return least_size((*self.labels, *self.further))

    def require_size(self) -> None:
        """Check the number of coordinates that the scene asks for.

        Raises:
            SceneError: the model has no such `basis.size`.
        """
        require_size(self.scene, (*self.labels, *self.further), self.size)

    def resized(self, chosen: int | Sequence[str]) -> StoredModel:
        """The model of other coordinates of those that the file holds, without a mesh.

        Args:
            chosen: the labels of the coordinates in their order, or the number of the first ones.

        Raises:
            ValueError: there are no such coordinates.
        """
        known = (*self.labels, *self.further)
        labels = known[: max(chosen, 0)] if isinstance(chosen, int) else tuple(chosen)
        wanted = chosen if isinstance(chosen, int) else len(labels)
        if not (0 < wanted == len(set(labels)) and set(labels) <= set(known)):
            raise ValueError(f"{chosen}: must be coordinates of {' '.join(known)}")
        if labels == self.labels:
            return self
        order = [known.index(label) for label in labels]
        order += [k for k in range(len(known)) if k not in set(order)]
        whole = nested_model(self.candidates or self.model, order)
        return replace(
            self,
            model=nested_model(whole, range(len(labels))),
            labels=labels,
            tables=None if self.tables is None else self.tables.of(order),
            candidates=whole if len(labels) < len(known) else None,
            further=tuple(known[k] for k in order[len(labels) :]),
        )

    def _with_scene(self, scene: Scene, source: str) -> StoredModel:
        require_same_model(self.scene, scene, source)
        changes: dict[str, Any] = {
            "load_histories": load_histories(scene),
            "damping": float(scene.material.mass_damping),
        }
        models = {"model": self.model, "candidates": self.candidates, "finer": self.finer}
        changed: dict[str, Any] = {
            name: None if model is None else model._replace(**changes)
            for name, model in models.items()
        }
        moved = rest_changes(self.scene, scene)
        trained = self.trained and self.trained.after(moved)
        found = replace(self, scene=scene, trained=trained, **changed)
        if self.whole is not None:
            found = replace(found, whole=self.whole.under(**changes))
            if scene.rotation != self.scene.rotation:
                found = found.at_speed()
        found.require_size()
        if moved and self.whole is None:
            return found._together(self.scene.bolts, moved)
        return found

    def _together(self, before: Sequence[Bolt], changes: tuple[Change, ...]) -> StoredModel:
        """The model about the equilibrium of bodies that touch, found in all its coordinates.

        The damping besides α M stays, and an estimate of the mesh needs the equilibrium of finer
        elements.

        Args:
            before: the bolts of the equilibrium so far.
            changes: what moved it (`rest_changes`).

        Raises:
            ConvergenceError: there is no equilibrium.
            SceneError: a round surface presses on a body, or the file does not hold the bolts.
        """
        scene, every = self.scene, self.candidates or self.model
        pulls = np.array([a.force - b.force for a, b in zip(scene.bolts, before, strict=True)])
        if pulls.any() and len(every.bolts.line) < pulls.size:
            reason = "an earlier version of this program wrote the model, which does not hold its "
            source = self.file or scene.source
            raise refuse(source, f"{reason}bolts; run the scene again", ErrorKind.MISMATCH, "bolts")
        pulled = every.bolts.pulled(every.elastic, pulls, scene.geometrically_nonlinear)
        every = every._replace(elastic=pulled)
        contacts = contacts_of(scene, every.points)
        closed = all_closed(contacts, paired(scene, every.points))
        q = together(every, contacts, closed, np.zeros(every.size))
        every = about(every, q)
        require_planes(contacts, every.points, every.contact_offset, scene.source)
        modes = dict.fromkeys(range(1, self.frequencies_hz.size + 1), math.nan)
        found = replace(
            self,
            model=nested_model(every, range(self.size)),
            candidates=None if self.candidates is None else every,
            frequencies_hz=reduced_modes(every, scene, modes)[1],
        )
        if self.tables is not None:
            tables = self.tables.about(q)
            deformation = deformation_at(tables.stress, np.zeros(q.size))
            found = replace(found, tables=tables, deformation=deformation)
        if self.finer is None or all(key.endswith(".tangential_stiffness") for key, *_ in changes):
            return found
        return replace(found, finer=None, finer_labels=(), unjudged=UNJUDGED_REST)

    def at_speed(self) -> StoredModel:
        """The model at the speed or for the history of its scene, from that for the range.

        It has the coordinates of this model, if there are any of their labels at this speed.

        Raises:
            ConvergenceError: there is no equilibrium at this speed.
        """
        whole, scene = self.whole, self.scene
        assert whole is not None and scene.rotation is not None
        history, omega = history_of(scene.rotation), scene.rotation.omega
        if history.size:
            return self._with_coordinates(whole.over(history, omega))
        modes = isinstance(scene.basis.masters, int)
        return self._with_coordinates(whole.at(omega, modes, scene.geometrically_nonlinear))

    def over_speeds(self, first: float, last: float) -> StoredModel:
        """The model for all speeds between two in rev/min, from that for the range.

        Its `model.turning` says how it depends on the speed, as that of a model for a speed that
        varies (`fenicsrom.online.periodic.shooting.speed_family`).

        Raises:
            ConvergenceError: there is no equilibrium at a speed.
        """
        whole, rotation = self.whole, self.scene.rotation
        assert whole is not None and rotation is not None
        history = speed_history([[0.0, np.pi / 30.0 * first], [1.0, np.pi / 30.0 * last]])
        return self._with_coordinates(whole.over(history, rotation.omega))

    def _with_coordinates(self, found: AtSpeed) -> StoredModel:
        """The model with other coordinates, in the order of those of this model if they are."""
        made = replace(
            self,
            model=found.model,
            candidates=found.candidates if found.further else None,
            labels=found.labels,
            further=found.further,
            frequencies_hz=found.frequencies_hz,
        )
        same = self.labels and {*self.labels} <= {*found.labels, *found.further}
        return made.resized(self.labels) if same else made

    @property
    def nodes(self) -> Array:
        """(N, d) vertices of the cells of the undeformed body, m.

        Raises:
            SceneError: the scene did not ask for `output.stresses`.
        """
        return self._stress_table().vertex_position

    def displacement(self, coordinates: Array) -> Array:
        """The displacement of the `nodes`, that of the equilibrium included.

        Args:
            coordinates: (n,) or (k, n) coordinates q, such as `Motion.coordinates`, m.

        Returns:
            (N, d) or (k, N, d), m, in global axes.

        Raises:
            SceneError: the scene did not ask for `output.stresses`.
        """
        return self._stress_table().displacement(coordinates)

    def mode_shapes(self) -> tuple[Array, Array]:
        """The structure's modes in the basis about the equilibrium, without contact and damping.

        Returns:
            (k,) frequencies, Hz, of the modes with the numbers of `normal_modes`; and (k, N, d)
            displacements of the `nodes` in the modes, which have the modal mass 1 kg, 1/sqrt(kg).

        Raises:
            SceneError: the scene did not ask for `output.stresses`.
        """
        vectors = self._stress_table().vertex_displacement[1:]
        _, frequencies, modes = reduced_modes(self.model, self.scene, self.normal_modes)
        return frequencies, np.asarray(np.tensordot(modes.T, vectors, 1))

    def _stress_table(self) -> StressTable:
        """The table with the displacements of the nodes.

        Raises:
            SceneError: there is none.
        """
        if self.recovery is None:
            reason = (
                "the model knows the displacements of its contact points and of its probe only; "
                'for those of all nodes, build it with output.stresses="cauchy"'
            )
            source = self.file or self.scene.source
            raise refuse(source, reason, ErrorKind.MISSING, "output.stresses")
        return self.recovery.stress

    def simulate(self, scene: Scene | None = None, **options: Any) -> Motion:
        """Integrate the model under a scene: its loads, damping, contacts and time integration.

        Args:
            scene: the scene; by default the scene of the model.
            options: as `fenicsrom.online.run.simulate.simulate`.

        Raises:
            SceneError: the scene differs in a key of the offline stage.
            ConvergenceError: the smallest step did not converge.
            AccuracyError: the error of the energy balance is too large.

        Example:
            >>> import fenicsrom as fr
            >>> motion = fr.load_model("out/beam.npz").simulate()
            >>> motion.time.size == motion.displacement.shape[0]
            True
            >>> round(float(motion.force[:, 0, 0].max()), 1)  # normal force of the first point, N
            40.0
        """
        run = self if scene is None else self.with_scene(scene)
        return simulate(run.model, run.scene, **options)


def least_size(labels: Sequence[str]) -> int:
    """The fewest of these coordinates that a model may have: those of the contact and one more."""
    return 1 + next((k for k, label in enumerate(labels) if label[-1] != "S"), 0)


def require_size(scene: Scene, labels: Sequence[str], own: int) -> None:
    """Check the number of coordinates that a scene asks for.

    Args:
        scene: the scene.
        labels: of all coordinates that its model can hold.
        own: number of the first of these, which a model without `basis.size` begins with.

    Raises:
        SceneError: there is no model of `basis.size` that the other coordinates can judge.
    """
    size, least, known = scene.basis.size, least_size(labels), len(labels)
    if size is None or (own < known and least <= size < known):
        return
    allowed = (
        f"must be from {least} to {known - 1}; the model holds {known} coordinates, and those "
        "that it leaves out judge it"
        if own < known
        else "not allowed: the model holds no coordinates besides its own"
    )
    raise Where(scene.source, "basis.size").refuse(size, allowed)


def save_model(path: Path, stored: StoredModel | StoredDisk) -> None:
    """Write a reduced model or a disk to a file that appears only when it is complete.

    Raises:
        OSError: the file cannot be written.
    """
    write_archive(path, *model_contents(stored))


def model_contents(stored: StoredModel | StoredDisk) -> tuple[dict[str, Any], dict[str, Any]]:
    """The header and the arrays of the file of a reduced model."""
    if isinstance(stored, StoredModel) and stored.candidates:
        kept: Any = replace(stored, model=None)  # type: ignore[arg-type]
    else:
        kept = stored
    tree, arrays = pack(kept, FORMS, named=True)
    scene = {"source": stored.scene.source, "scene": scene_table(stored.scene)}
    return {"format": FORMAT, "tree": tree, **scene}, arrays


def _with_unique_cubic(cubic: Array, stiffness: Array, **others: Array) -> dict[str, Any]:
    """The fields of a polynomial, of which a file keeps the different cubic coefficients."""
    return {"cubic": unique_cubic(cubic, len(stiffness)), "stiffness": stiffness, **others}


def _polynomial(cubic: Array, stiffness: Array, **others: Array) -> ElasticPolynomial:
    """The polynomial of the fields that a file keeps."""
    paired = paired_cubic(cubic, len(stiffness))
    return ElasticPolynomial(stiffness=stiffness, cubic=paired, **others)


FORMS: dict[str, Callable[..., dict[str, Any]]] = {
    "StoredModel": without("scene", "file"),
    "StoredDisk": without("scene", "file"),
    "ReducedModel": without("work", "load_histories"),
    "ElasticPolynomial": _with_unique_cubic,
    "StressTable": without("law"),
}
"""What a file keeps of the records; the scene gives the rest."""


def makers(scene: Scene) -> dict[str, Any]:
    """The functions that make records again from what a file keeps of them and of its scene."""
    plain = ContactPoints, Bolts, PressurePolynomial, Turning, Recovery, ReactionTable, Deformation
    more = RangeModel, RangeErrors, Trained, Sector, Contacts, Coating
    return {kind.__name__: kind for kind in (*plain, *more)} | {
        "ElasticPolynomial": _polynomial,
        "ReducedModel": partial(reduced_model, load_histories=load_histories(scene)),
        "StressTable": partial(StressTable, StressLaw.of(scene)),
    }


def load_model(path: Path) -> StoredModel:
    """Read a reduced model.

    Raises:
        SceneError: the file is missing, damaged or of another format.

    Example:
        A run without a mesh: `fenicsrom import demos/superelement/beam.op4 --scene
        demos/superelement/rub.toml --output out/beam.npz` writes this model.

        >>> import fenicsrom as fr
        >>> stored = fr.load_model("out/beam.npz")
        >>> stored.size, stored.frequencies_hz[:2].round(2).tolist()
        (9, [3.28, 20.58])
    """
    found = load_stored(path)
    if isinstance(found, StoredDisk):
        reason = "holds a disk of sectors: fenicsrom run --from takes it, and load_disk"
        raise refuse(path, reason, ErrorKind.CONFLICT, "cyclic")
    return found


def load_disk(path: Path) -> StoredDisk:
    """Read a disk of reduced sectors.

    Raises:
        SceneError: the file is missing, damaged or of another format, or holds no disk.
    """
    found = load_stored(path)
    if isinstance(found, StoredModel):
        reason = "holds the model of a body, not of a disk: load_model reads it"
        raise refuse(path, reason, ErrorKind.CONFLICT, "cyclic")
    return found


def load_stored(path: Path) -> StoredModel | StoredDisk:
    """Read a reduced model, or a disk of reduced sectors.

    Raises:
        SceneError: the file is missing, damaged or of another format.
    """
    with read_archive(path, "a reduced model", FORMAT, EARLIER) as (header, data):
        return model_of_contents(path, header, data)


def model_of_contents(path: Path, header: dict[str, Any], data: dict[str, Any]) -> Any:
    """The reduced model or disk of a header and arrays; `path` names their file in messages.

    Raises:
        SceneError: the scene in the header is wrong.
    """
    scene = parse_scene(header["scene"], str(header["source"]), None)

    def made(model: Any, labels: Any, candidates: Any, **others: Any) -> StoredModel:
        model = nested_model(candidates, range(len(labels))) if model is None else model
        known = {"labels": labels, "candidates": candidates, "file": str(path), **others}
        return StoredModel(model, scene, **known)

    disk = partial(StoredDisk, scene=scene, file=str(path))
    return unpack(header["tree"], data, {**makers(scene), "StoredModel": made, "StoredDisk": disk})
