"""Estimated errors of frequencies and deflections due to the mesh.

`fenicsrom.assess.errors.estimates.mesh_errors` judges motions. Where there are none, of modes,
Campbell diagrams, static equilibria and curves, the natural frequencies and the deflection of the
probe are compared with those of elements of one degree more. An estimate is `MESH_SAFETY` times the
relative difference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.estimates import MESH_SAFETY
from fenicsrom.assess.errors.verdicts import FREQUENCY_ERROR, check_error, finer_mesh, in_percent
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import Scene

if TYPE_CHECKING:
    from fenicsrom.fem.solid.finer import FinerSolid
    from fenicsrom.fem.solid.solid import Solid

IN_A_NODE = 1e-6
"""A probe that moves by a smaller part of the largest displacement has no relative error."""


@dataclass(frozen=True)
class MeshCheck:
    """Estimated relative errors due to the mesh.

    Attributes:
        frequencies: those of the natural frequencies of the structure's modes 1, 2, ..
        deflection: that of the static deflection of the probe; None without one.
        missing: why they are not estimated; empty if they are.
    """

    frequencies: tuple[float, ...] = ()
    deflection: float | None = None
    missing: str = ""

    def sentence(self) -> str:
        """The estimates in words; empty without any."""
        listed = [in_percent(error) for error in self.frequencies]
        said = [f"of the natural frequencies {', '.join(listed)}"] if listed else []
        if self.deflection is not None:
            said.append(f"of the static deflection {in_percent(self.deflection)}")
        return f"Estimated error due to the mesh: {'; '.join(said)}." if said else ""

    def warnings(self, scene: Scene, quantity: str = "") -> list[Note]:
        """One note if there is no estimate, or a frequency is too wrong; else none.

        Args:
            scene: the scene, for the remedy.
            quantity: what wrong frequencies cast doubt on; all by default.
        """
        if self.missing:
            text = f"the error due to the mesh is not estimated: {self.missing}"
            return [Note(NoteKind.UNCHECKED, text)]
        worst = max(self.frequencies, default=0.0)
        if worst <= FREQUENCY_ERROR:
            return []
        mode = self.frequencies.index(worst) + 1
        text = (
            f"the mesh is too coarse: elements of degree {scene.geometry.degree + 1} change the "
            f"frequency of mode {mode} by {in_percent(worst / MESH_SAFETY)}: "
            f"{finer_mesh(scene, 2.0 * worst)}"
        )
        return [Note(NoteKind.ERROR, text, "geometry", quantity=quantity)]

    def failure(self, scene: Scene) -> AccuracyError | None:
        """The error of a static deflection that is too wrong, or None.

        Args:
            scene: the scene, for the remedy.
        """
        try:
            check_error(scene, "mesh", self.deflection or 0.0)
        except AccuracyError as error:
            return error
        return None


def of_solid(
    scene: Scene,
    solid: Solid,
    squares: tuple[Array, Callable[[Solid], Array]] | None = None,
    deflection: Callable[[Solid], Array] | None = None,
    further: Callable[[FinerSolid], None] = lambda finer: None,
) -> MeshCheck:
    """Compare results of a solid with those of finer elements. Collective.

    Args:
        scene: the scene of the solid.
        solid: the solid.
        squares: omega^2 (v,) of the natural frequencies, rad^2/s^2, and what gives those of the
            finer solid.
        deflection: gives the displacement (local,) of a solid, m.
        further: what else the finer solid is needed for.
    """
    from fenicsrom.fem.solid.finer import FinerSolid, too_large

    reason = too_large(solid)
    if reason is not None:
        return MeshCheck(missing=reason)
    try:
        finer = FinerSolid(scene, solid)
        ours, theirs = squares or (np.zeros(0), lambda finer: np.zeros(0))
        frequencies = _of_squares(ours, theirs(finer)[: ours.size])
        moved = None if deflection is None else _moved(deflection, solid, finer)
        further(finer)
        finer.destroy()
    except (AccuracyError, ConvergenceError, SceneError) as error:
        return MeshCheck(missing=str(error))
    return MeshCheck(frequencies, moved)


def of_model(stored: StoredModel, *speeds_rpm: float) -> MeshCheck:
    """The estimated errors of the natural frequencies of a stored model.

    Args:
        stored: the model. A superelement has no estimates: its matrices do not know the mesh.
        speeds_rpm: of a model for a range of speeds, the largest errors at these speeds are taken;
            by default the speed of its scene counts.
    """
    if stored.unjudged:
        return MeshCheck(missing=stored.unjudged)
    whole, rotation = stored.whole, stored.scene.rotation
    if whole is None or rotation is None:
        better = stored.finer_frequencies_hz
        return MeshCheck(_relative(stored.frequencies_hz[: better.size], better))
    if whole.finer is None:
        return MeshCheck()
    found = []
    try:
        for omega in np.pi / 30.0 * np.array(speeds_rpm or [rotation.speed_rpm]):
            found.append(_of_squares(whole.squares(omega), whole.finer.squares(omega)))
    except ConvergenceError as error:
        return MeshCheck(missing=str(error))
    return MeshCheck(tuple(max(errors) for errors in zip(*found, strict=True)))


def _of_squares(squares: Array, better: Array) -> tuple[float, ...]:
    """Estimated errors of frequencies, from omega^2 (v,) of the mesh and of finer elements."""
    ours, theirs = (np.sqrt(np.maximum(value, 0.0)) for value in (squares, better))
    return _relative(ours, theirs)


def _relative(ours: Array, theirs: Array) -> tuple[float, ...]:
    """Estimated errors of frequencies (v,) of the mesh, from those of finer elements."""
    apart = MESH_SAFETY * np.abs(ours - theirs) / np.where(theirs > 0.0, theirs, np.inf)
    return tuple(float(value) for value in apart)


def _moved(deflection: Callable[[Solid], Array], solid: Solid, finer: Solid) -> float | None:
    """The estimated error of a deflection of the probe; None where the probe stands still."""
    probes, largest = [], 0.0
    for body in (solid, finer):
        found = deflection(body)
        probes.append(np.asarray(body.comm.allreduce(body.probe_rows @ found)))
        largest = max(largest, float(body.largest(found[:, None])[0]))
    size = float(np.linalg.norm(probes[1]))
    if size <= IN_A_NODE * largest:
        return None
    return MESH_SAFETY * float(np.linalg.norm(probes[0] - probes[1])) / size
