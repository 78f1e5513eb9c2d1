"""Whether the St Venant-Kirchhoff law has a meaning at a deformation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.stress.deformation import Deformation
from fenicsrom.online.stress.stress import StressLaw
from fenicsrom.online.stress.stress_peaks import Stresses
from fenicsrom.scene import Scene

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid

EQUILIBRIUM = "in equilibrium"

LARGE_STRAIN = 0.1
"""Strain from which the user is warned. At a stretch of 0.9, the slope of the law under
uniaxial stress is ½ (3 · 0.9² − 1) = 72 % of Young's modulus."""


LARGE_MOTION = 0.1
"""The strains of a motion that is smaller than this part of the body are hardly large."""


def strain_warnings(states: Sequence[tuple[str, Deformation]]) -> list[Note]:
    """Say where the material is turned inside out, or is compressed so much that it softens.

    Args:
        states: where a state is, such as "at the load factor 2", and its deformation.

    Returns:
        A sentence on the first state that turns the material inside out; else a sentence on the
        first state with a large compression, or else with a large extension, if there is one.
    """
    for where, state in states:
        if state.is_inverted:
            place = ", ".join(f"{x + 0.0:.4g}" for x in state.position)
            text = (
                f"the material is turned inside out {where}: the volume ratio det F is "
                f"{state.volume_ratio:.2g} at ({place}) m, where the St Venant-Kirchhoff law has "
                "no meaning"
            )
            return [Note(NoteKind.LAW, text)]
    compressed = [1.0 - state.smallest_stretch for _, state in states]
    extended = [state.largest_stretch - 1.0 for _, state in states]
    for strains, name, meaning in (
        (compressed, "compressive", "softens in compression and loses its stiffness at 42 %"),
        (extended, "tensile", "is made for small strains, and hardens in tension"),
    ):
        for (where, _), strain in zip(states, strains, strict=True):
            if strain > LARGE_STRAIN:
                text = (
                    f"the {name} strain exceeds {100.0 * LARGE_STRAIN:g} % {where} and reaches "
                    f"{100.0 * max(strains):.3g} %: the St Venant-Kirchhoff law {meaning}"
                )
                return [Note(NoteKind.LAW, text)]
    return []


def equilibrium_deformation(solid: Solid, scene: Scene) -> Deformation | None:
    """The deformation in the equilibrium of a solid; None of an undeformed one. Collective."""
    from fenicsrom.fem.body.stress_points import body_deformation

    if not solid.loaded or not StressLaw.of(scene).deformed:
        return None
    return body_deformation(solid, scene, solid.equilibrium)


def equilibrium_warnings(found: Deformation | None) -> list[Note]:
    """The sentences of `strain_warnings` on an equilibrium; none on an undeformed body."""
    return [] if found is None else strain_warnings([(EQUILIBRIUM, found)])


def motion_warnings(solid: Solid, scene: Scene, vectors: Array, motion: Motion) -> list[Note]:
    """The sentences of `strain_warnings` on the state of a motion with most elastic energy.

    Args:
        solid: the solid.
        scene: its scene.
        vectors: (local, n) the basis.
        motion: a motion with the coordinates of its last period.
    """
    from fenicsrom.fem.body.stress_points import body_deformation

    assert motion.coordinates is not None and motion.coordinate_time is not None
    energies = motion.elastic[-motion.coordinate_time.size :]
    k = int(np.argmax(energies))
    u = solid.equilibrium + vectors @ motion.coordinates[k]
    where = f"at t = {motion.coordinate_time[k]:.6g} s"
    return strain_warnings([(where, body_deformation(solid, scene, u))])


def state_warnings(stresses: Stresses, *, motion_only: bool = False) -> list[Note]:
    """The sentences of `strain_warnings` on the states whose stresses were found.

    Args:
        stresses: the stresses of the run, with their states.
        motion_only: whether to leave out the equilibrium, which `equilibrium_warnings` judged.
    """
    return strain_warnings(
        [
            (EQUILIBRIUM if peak.time is None else f"at t = {peak.time:.6g} s", deformed)
            for peak, deformed in zip(stresses.peaks, stresses.deformations, strict=True)
            if peak.time is not None or not motion_only
        ]
    )
