"""Deflections by which modes and derivatives are chosen."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.simulate import simulate
from fenicsrom.reduction.basis import build_basis
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.projection import project
from fenicsrom.reduction.selection import STATIC_LEVELS

if TYPE_CHECKING:
    from fenicsrom.reduction.modes import Structure

SNAPSHOTS = 200  # of the linear transient, at most
SNAPSHOT_STEADINESS = (
    1e-3  # change over a period at which the linear transient is steady enough to choose modes by
)


class Snapshots:
    """The deflections by which modes and derivatives are chosen, each kind found when it is first
    asked for.
    """

    def __init__(self, solid: Structure, modes: ComponentModes):
        """Keep the body and its component modes."""
        self._solid, self._modes = solid, modes

    @cached_property
    def linear(self) -> Array:
        """(local, s) of the geometrically linear transient."""
        return linear_snapshots(self._solid, self._modes)

    @cached_property
    def static(self) -> Array:
        """(local, levels) of the nonlinear statics."""
        return static_snapshots(self._solid, self.linear)


def linear_snapshots(solid: Structure, modes: ComponentModes) -> Array:
    """Deflections (local, s) over the last period of a geometrically linear transient with
    friction.
    """
    scene = solid.scene
    labels = [label for label in modes.labels if label.endswith("V")]
    basis = build_basis(
        modes.method,
        modes.masters,
        modes.rows,
        modes.normal,
        labels,
        solid.mass_inner,
        solid.comm.allreduce,
    )
    coarse = scene.time.steady_tolerance
    time = scene.time
    if coarse is not None:
        time = time.changed(steady_tolerance=max(coarse, SNAPSHOT_STEADINESS))
    motion = simulate(
        project(solid, basis, nonlinear=False), replace(scene, time=time), keep_coordinates=True
    )
    assert motion.coordinates is not None
    step = -(-motion.coordinates.shape[0] // SNAPSHOTS)
    return basis.vectors @ motion.coordinates[::step].T


def static_snapshots(solid: Structure, linear: Array) -> Array:
    """Nonlinear static deflections (local, `STATIC_LEVELS`) from the equilibrium.

    The force is the one that would hold the linear structure in its largest deflection of the
    transient, f = K u (eq. 18 at the phase of the largest deflection), in equal levels up to all of
    it.
    """
    sizes = np.array([solid.mass_inner(u[:, None], u[:, None])[0, 0] for u in linear.T])
    force = solid.stiffness_times(linear[:, [int(np.argmax(sizes))]])[:, 0]
    rest = solid.rest_force
    u, found = solid.equilibrium, []
    for level in range(1, STATIC_LEVELS + 1):
        u = solid.static(rest + level / STATIC_LEVELS * force, u)
        found.append(u - solid.equilibrium)
    return np.array(found).T
