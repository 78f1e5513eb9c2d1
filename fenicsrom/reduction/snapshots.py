"""Deflections of the structure (snapshots) that select modes and derivatives.

Two sets of snapshots (Mashayekhi and Zucca 2024, sec. 2.2): U_t of a geometrically linear transient
with friction, and U_st of nonlinear statics under the force of eq. (18).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.simulate import simulate
from fenicsrom.progress import tracked
from fenicsrom.reduction.basis import build_basis
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.projection import project
from fenicsrom.reduction.protocols import Structure
from fenicsrom.scene import Scene

SNAPSHOTS = 200
"""Largest number of snapshots of the linear transient."""

STATIC_LEVELS = 10
"""Number of load levels of the nonlinear statics."""

SNAPSHOT_STEADINESS = 1e-3
"""The linear transient ends if its relative change over a period is smaller."""


class Snapshots:
    """The snapshots of a structure; each set is computed when it is first read."""

    def __init__(self, structure: Structure, scene: Scene, modes: ComponentModes):
        """Store what the snapshots are computed from.

        Args:
            structure: the structure.
            scene: its contacts and time integration define the linear transient.
            modes: component modes of the structure.
        """
        self._structure, self._scene, self._modes = structure, scene, modes

    @cached_property
    def linear(self) -> Array:
        """U_t (local, s): snapshots of the linear transient, m."""
        return linear_snapshots(self._structure, self._scene, self._modes)

    @cached_property
    def static(self) -> Array:
        """U_st (local, `STATIC_LEVELS`): snapshots of the nonlinear statics, m."""
        return static_snapshots(self._structure, self.linear)


def linear_snapshots(structure: Structure, scene: Scene, modes: ComponentModes) -> Array:
    """Compute a geometrically linear transient with friction in the component modes.

    Args:
        structure: the structure.
        scene: its contacts and time integration.
        modes: component modes of the structure.

    Returns:
        Deflections (local, s) over the last period, from the equilibrium, m.

    Raises:
        ConvergenceError: a time step did not converge.
    """
    labels = [label for label in modes.labels if label.endswith("V")]
    basis = build_basis(
        modes.method,
        modes.masters,
        modes.rows,
        modes.normal,
        labels,
        structure.mass_inner,
        structure.comm.allreduce,
    )
    time, tolerance = scene.time, scene.time.steady_tolerance
    if tolerance is not None:
        time = time.changed(steady_tolerance=max(tolerance, SNAPSHOT_STEADINESS), steady="march")
    model = project(structure, basis, nonlinear=False)
    motion = simulate(model, replace(scene, time=time), keep_coordinates=True)
    assert motion.coordinates is not None
    step = -(-motion.coordinates.shape[0] // SNAPSHOTS)
    return basis.vectors @ motion.coordinates[::step].T


def static_snapshots(structure: Structure, linear: Array) -> Array:
    """Compute nonlinear static deflections.

    The force f = K u (eq. 18) holds the linear structure in its largest deflection u of the linear
    transient. It acts at equal levels, in addition to the static loads.

    Args:
        structure: the structure.
        linear: (local, s) snapshots of the linear transient, m.

    Returns:
        Deflections (local, `STATIC_LEVELS`) from the equilibrium, m.

    Raises:
        ConvergenceError: the statics did not converge.
    """
    sizes = np.array([structure.mass_inner(u[:, None], u[:, None])[0, 0] for u in linear.T])
    force = structure.stiffness_times(linear[:, [int(np.argmax(sizes))]])[:, 0]
    rest = structure.rest_force
    u, found = structure.equilibrium, []
    for level in tracked(range(1, STATIC_LEVELS + 1)):
        u = structure.static(rest + level / STATIC_LEVELS * force, u)
        found.append(u - structure.equilibrium)
    return np.array(found).T
