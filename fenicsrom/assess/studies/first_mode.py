"""The first mode of a scene, from which the numbers of a starter scene follow."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenicsrom.arrays import Array
from fenicsrom.fem.solid.solid import build_solid
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis, Place, Scene

DAMPING = 0.01
"""Damping ratio of a starter scene."""

AMPLITUDE = 1e-3
"""Amplitude at the resonance, relative to the extent of the body."""


@dataclass(frozen=True)
class FirstMode:
    """The first mode without loads, and the point that it moves most.

    A mode with the modal mass 1 and the displacement u at a point has the modal stiffness ω²/|u|²
    there, for forces along u.

    Attributes:
        frequency: natural frequency, Hz.
        point: coordinates (d,) of the point, m.
        direction: (d,) unit vector of its motion.
        stiffness: modal stiffness at the point, N/m.
        extent: largest extent of the body, m.
    """

    frequency: float
    point: tuple[float, ...]
    direction: tuple[float, ...]
    stiffness: float
    extent: float

    @property
    def amplitude(self) -> float:
        """Amplitude at the resonance under `force`, m."""
        return AMPLITUDE * self.extent

    @property
    def force(self) -> float:
        """Amplitude F = 2 ζ k A of the harmonic force at the resonance, N."""
        return 2.0 * DAMPING * self.stiffness * self.amplitude


def first_mode(scene: Scene, place: Place | None) -> FirstMode:
    """Compute the first mode of a scene without loads. On one rank.

    Args:
        scene: the scene.
        place: where the motion is asked for; None for the node that moves most.

    Raises:
        SceneError: the scene does not fit the mesh.
        ConvergenceError: the mode was not found.
    """
    solid = build_solid(scene, MPI.COMM_SELF)
    modes = component_modes(solid, Basis(modes=1))
    d = solid.dimension
    if place is None:
        motion = modes.normal[:, 0].reshape(-1, d)
        node = int(np.linalg.norm(motion, axis=1).argmax())
        position: Array = solid.space.tabulate_dof_coordinates()[node]
        moved = motion[node]
    else:
        rows, position = solid.place(place, "loads[0]")
        moved = rows @ modes.normal[:, 0]
    size = float(np.linalg.norm(moved))
    along = moved / size * np.sign(moved[np.abs(moved).argmax()])
    frequency, stiffness = float(modes.frequencies_hz[0]), float(modes.omega[0] ** 2 / size**2)
    point, direction = (tuple(map(float, one)) for one in (position[:d], along))
    return FirstMode(frequency, point, direction, stiffness, solid.mesh.extent())
