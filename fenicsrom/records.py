"""The records of a run of a scene and of a stored model: results and files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.reduction.derivatives import Selection
from fenicsrom.words import brief

if TYPE_CHECKING:
    from fenicsrom.arrays import Array
    from fenicsrom.assess.errors.comparisons import MeshCheck, ModeAgreement
    from fenicsrom.assess.errors.estimates import MotionErrors
    from fenicsrom.assess.errors.sizing import Sized
    from fenicsrom.assess.rotation.run_up import RunUp
    from fenicsrom.notes import Note
    from fenicsrom.online.contact.points import ContactPoints
    from fenicsrom.online.model.model import ReducedModel
    from fenicsrom.online.motion.motion import Motion
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.store.scene_changes import Trained
    from fenicsrom.online.stress.reactions import Recovery, Stresses
    from fenicsrom.online.stress.stress import Deformation
    from fenicsrom.reduction.basis import ReducedBasis
    from fenicsrom.reduction.modes import ComponentModes
    from fenicsrom.reduction.stages import Derivatives
    from fenicsrom.scene import Scene


@brief("stored", "motion", "errors", "unfinished", "warnings", "stresses", "files")
@dataclass(eq=False, repr=False)
class Rerun:
    """The record of a run of a stored model.

    Attributes:
        stored: the stored model, under the scene of the run.
        motion: the motion; up to the failure if there was one.
        errors: estimated relative errors of the motion by their causes, as `Study.errors`.
        unfinished: "reduced" and the error of the integration or of a check, or None.
        warnings: warnings for the user.
        sized: how the basis got its size; None if it has no candidates.
        stresses: the largest stresses, and the reactions; None if the scene does not ask for them,
            or the model does not have them.
        left_out: the reasons why something was not computed, with its name as the key.
        files: the written files, the report first.
        pictures: the written pictures, as `fenicsrom.post.base.picture.Drawn`.
        seconds: stage -> run time, s.
        run_up: the motion by revolutions; None at a constant speed of rotation.
    """

    stored: StoredModel
    motion: Motion
    errors: dict[str, MotionErrors]
    unfinished: tuple[str, Exception] | None
    warnings: list[Note]
    sized: Sized | None = None
    stresses: Stresses | None = None
    left_out: list[Note] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    pictures: list[Any] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    run_up: RunUp | None = None

    @property
    def scene(self) -> Scene:
        """The scene of the run."""
        return self.stored.scene

    @property
    def model(self) -> ReducedModel:
        """The reduced model."""
        return self.stored.model

    @property
    def points(self) -> ContactPoints:
        """The contact points."""
        return self.stored.model.points

    @property
    def candidates(self) -> ReducedModel | None:
        """The larger model that judges the basis."""
        return self.stored.candidates

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies, Hz."""
        return self.stored.frequencies_hz

    @property
    def recovery(self) -> Recovery | None:
        """The tables of the stresses and reactions."""
        return self.stored.recovery

    @property
    def trained(self) -> Trained | None:
        """What the motions hold that chose the interface vectors."""
        return self.stored.trained

    @property
    def motions(self) -> dict[str, Motion]:
        """The motion by the name of its model."""
        return {"reduced": self.motion}

    @property
    def sizes(self) -> dict[str, int]:
        """Number of unknowns of the model."""
        return {"reduced": self.stored.size}


@brief("scene", "labels", "modes", "model", "motions", "errors", "unfinished", "left_out", "files")
@dataclass(eq=False, repr=False)
class Study:
    """The results of the stages of a scene. A stage that did not run leaves its default.

    Attributes:
        scene: the scene.
        solid: the solid body.
        modes: its component modes.
        selection: the selected modes and derivatives.
        derivatives: the modal derivatives.
        basis: the reduced basis.
        model: the reduced model.
        extended: the basis with its candidates (`fenicsrom.reduction.candidates`).
        further: labels of the candidates, in the order of the larger model.
        candidates: the larger model, which judges the basis.
        finer: the model of finer elements, which judges the mesh.
        finer_labels: labels of its coordinates.
        finer_frequencies_hz: (v,) frequencies of its normal modes, in the order of `modes`.
        mesh_check: estimated errors of frequencies and deflections due to the mesh.
        contact_hz: (v, 2) natural frequencies without contact and with all contact points stuck.
        trained: the motion that chose the interface vectors.
        agreement: the modes of the reduced model beside those of the full model.
        motions: "reduced", "full" or "beam" -> motion.
        seconds: stage -> run time, s.
        left_out: the reasons why something was not computed, with its name as the key.
        errors: estimated relative errors of the reduced model by their causes, "time step",
            "basis" and "mesh".
        judge: the model with the responses to the residual of the full equations along the motion.
        sized: how the basis got its size; None if it has no candidates.
        deflection: (d,) displacement of the probe in the static equilibrium, m; None without static
            loads.
        deformation: extremes of the deformation in the equilibrium; None of an undeformed body.
        tables: of the stresses and reactions for the basis with its candidates, if the scene
            asks for them.
        stresses: the largest stresses, and the reactions.
        unfinished: the name of the model whose integration or check failed, and its error.
        files: the written files.
        pictures: the written pictures, as `fenicsrom.post.base.picture.Drawn`.
        body: what the pictures of the body show, or None, in a tuple; None before the first one.
    """

    scene: Scene
    solid: Any = None
    modes: ComponentModes | None = None
    selection: Selection = field(default_factory=lambda: Selection((), (), {}, {}))
    derivatives: Derivatives | None = None
    basis: ReducedBasis | None = None
    model: Any = None
    extended: ReducedBasis | None = None
    further: tuple[str, ...] = ()
    candidates: ReducedModel | None = None
    finer: ReducedModel | None = None
    finer_labels: tuple[str, ...] = ()
    finer_frequencies_hz: Array = field(default_factory=lambda: np.zeros(0))
    mesh_check: MeshCheck | None = None
    contact_hz: Array | None = None
    trained: Trained | None = None
    agreement: ModeAgreement | None = None
    motions: dict[str, Motion] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    left_out: list[Note] = field(default_factory=list)
    errors: dict[str, MotionErrors] = field(default_factory=dict)
    judge: StoredModel | None = None
    sized: Sized | None = None
    deflection: Array | None = None
    deformation: Deformation | None = None
    tables: Recovery | None = None
    stresses: Stresses | None = None
    unfinished: tuple[str, Exception] | None = None
    files: list[Path] = field(default_factory=list)
    pictures: list[Any] = field(default_factory=list)
    body: Any = None

    @property
    def warnings(self) -> list[Note]:
        """Warnings for the user; those of the mesh and the solid come first."""
        found: list[Note] = self.solid.warnings
        return found

    @property
    def points(self) -> ContactPoints:
        """The contact points."""
        found: ContactPoints = self.solid.points
        return found

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies, Hz; none without modes."""
        return np.zeros(0) if self.modes is None else self.modes.frequencies_hz

    @property
    def stored(self) -> StoredModel:
        """The content of `reduced_model.npz`.

        Raises:
            SceneError: the model has no such `basis.size`.
        """
        from fenicsrom.online.store.archive import StoredModel
        from fenicsrom.online.store.store import provenance

        assert self.basis is not None and self.modes is not None
        found = StoredModel(
            model=self.model,
            scene=self.scene,
            method=self.basis.method,
            labels=self.basis.labels,
            dofs=self.solid.free,
            frequencies_hz=self.modes.frequencies_hz,
            provenance=provenance(),
            tables=self.tables,
            candidates=self.candidates,
            deformation=self.deformation,
            further=self.further,
            finer=self.finer,
            finer_labels=self.finer_labels,
            finer_frequencies_hz=self.finer_frequencies_hz,
            unjudged="" if self.mesh_check is None else self.mesh_check.missing,
            trained=self.trained,
        )
        found.require_size()
        return found

    @property
    def recovery(self) -> Recovery | None:
        """The tables of the stresses and reactions for the basis."""
        if self.tables is None or self.basis is None:
            return self.tables
        return self.tables.of(range(self.basis.size))

    @property
    def dropped_modes(self) -> list[str]:
        """Labels of the modes that the selection left out of the basis."""
        modes = self.modes.labels if self.modes is not None else ()
        return [label for label in modes if label not in self.selection.modes]

    @property
    def labels(self) -> Sequence[str]:
        """Labels of the basis vectors, or of the modes and derivatives if there is no basis."""
        if self.basis is not None:
            return self.basis.labels
        modes = self.modes.labels if self.modes is not None else ()
        return [*modes, *(self.derivatives.labels if self.derivatives is not None else ())]

    @property
    def sizes(self) -> dict[str, int]:
        """Number of unknowns of each model."""
        reference = self.scene.reference
        section = reference.beam_section if reference.beam else None
        return {
            "reduced": self.basis.size if self.basis is not None else 0,
            "full": self.solid.free,
            "beam": 3 * section.elements if section is not None else 0,
        }
