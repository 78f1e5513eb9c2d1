"""Forces and moments of the supports on the body, from the stresses and from the momentum.

The equations of the clamped unknowns, which no model solves, give the force of a support. With a
test function W that is a unit translation (or rotation) of its nodes and zero on all others, and
the load vectors p of unit loads,

    R = ∫ (F S) : ∇W + W · [M (ü + α u̇) + D u̇ + k u - Ω² (c + Q u)] - Σ W · p_k s_k(t),    (1)

where D u̇ are the Coriolis force Γ u̇ and the viscous forces of [damping] and of dashpots, and k u
the forces of springs to the ground. Stiffness and mass in these viscous forces are those of the
whole body with its clamped unknowns. S is the elastic stress.

All terms but the first are linear in the coordinates, and ∇W is zero outside the cells at the
support. The same equation with a translation of the whole body has no stresses: the rate of
momentum minus all loads, contact forces and forces to the ground is the sum of the reactions. Both
agree if the equations of the free unknowns are fulfilled: for the equilibrium to the tolerance of
its solution, for a reduced motion as far as its basis can. The momentum is then the more accurate
one; the difference shows how well the basis resolves the stresses at the supports.

Moments are about the centroid of the clamped nodes of the support.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.model.loads import factors
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.stress.stress import StressLaw
from fenicsrom.scene import Scene


@dataclass(frozen=True, eq=False)
class ReactionTable:
    """The terms of (1) of S supports and of the whole body, in d dimensions with n coordinates.

    There are m test functions for each: d translations, then 1 rotation in 2D or 3 in 3D. The last
    entry of an axis of S + 1 is the whole body, whose rotations are zero.

    Attributes:
        centre: (S, d) centroids of the clamped nodes, m.
        support: (R,) support that each Gauss point belongs to.
        gradients: (1 + n, R, d, d) displacement gradients of u₀ and of every φ.
        tests: (m, R, d, d) gradients of the test functions times the volume of the points, m².
        mass: (S + 1, m, n) W · M φ, kg.
        velocity: (S + 1, m, n) W · D φ, kg/s.
        static: (S + 1, m, 1 + n) W · (k u₀ - Ω² (c + Q u₀)) in N, then W · (k - Ω² Q) φ.
        loads: (S + 1, m, loads) W · p of the unit loads.
        material: (R,) number of the material of each Gauss point; None with one material.
    """

    centre: Array
    support: NDArray[np.int64]
    gradients: Array
    tests: Array
    mass: Array
    velocity: Array
    static: Array
    loads: Array
    material: NDArray[np.int64] | None = None

    def evaluate(
        self, law: StressLaw, q: Array, velocity: Array, inertia: Array, factor: Array
    ) -> tuple[Array, Array]:
        """Reactions (k, S, m), and the sum of all forces (k, d) of the supports by momentum, N.

        The second is without the contact forces.

        Args:
            law: the law of the stresses.
            q: (k, n) coordinates.
            velocity: (k, n) their velocities.
            inertia: (k, n) accelerations plus α times the velocities.
            factor: (k, loads) time factors of the loads.
        """
        smooth = (
            inertia @ self.mass.transpose(0, 2, 1)
            + velocity @ self.velocity.transpose(0, 2, 1)
            + q @ self.static[:, :, 1:].transpose(0, 2, 1)
            + self.static[:, None, :, 0]
            - factor @ self.loads.transpose(0, 2, 1)
        ).transpose(1, 0, 2)
        change = np.asarray(np.tensordot(q, self.gradients[1:], axes=1), np.float64)
        stress = law.at(self.material).first_piola(self.gradients[0], change)
        count, d = self.centre.shape
        found = smooth[:, :count].copy()
        for support in range(count):
            mine = self.support == support
            each = stress[:, mine], self.tests[:, mine]
            found[:, support] += np.tensordot(*each, axes=((1, 2, 3), (1, 2, 3)))
        return found, smooth[:, -1, :d]


@dataclass(frozen=True, eq=False)
class Reactions:
    """The reactions of S supports at k instants; m components: forces (N), then moments (N m).

    Attributes:
        supports: names of the supports.
        time: (k,) s.
        values: (k, S, m) from the stresses at the support.
        by_momentum: (k, d) sum of the forces of all supports, from the momentum of the body, N.
    """

    supports: tuple[str, ...]
    time: Array
    values: Array
    by_momentum: Array

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the m components, with their units."""
        forces = [f"force_{axis}_N" for axis in "xyz"[: self.by_momentum.shape[1]]]
        axes = "z" if self.by_momentum.shape[1] == 2 else "xyz"
        return (*forces, *(f"moment_{axis}_Nm" for axis in axes))

    @property
    def mismatch(self) -> float:
        """Largest difference of the two sums of forces, relative to their largest change.

        The change is that from the mean, which static loads and the centrifugal force dominate;
        where nothing changes, the difference is relative to the force itself.
        """
        d = self.by_momentum.shape[1]
        difference = self.values[:, :, :d].sum(axis=1) - self.by_momentum
        worst = float(np.linalg.norm(difference, axis=1).max(initial=0.0))
        changes = self.by_momentum - self.by_momentum.mean(axis=0)
        for forces in (changes, self.by_momentum):
            size = float(np.linalg.norm(forces, axis=1).max(initial=0.0))
            if size > 0.0:
                return worst / size
        return float(worst > 0.0)


def support_names(scene: Scene) -> tuple[str, ...]:
    """A name of each support: that of its group, where it has one, and there is no other."""
    groups = [support.group for support in scene.supports]
    return tuple(
        group if group and groups.count(group) == 1 else f"supports[{k}]"
        for k, group in enumerate(groups)
    )


def equilibrium_reactions(table: ReactionTable, scene: Scene) -> Reactions:
    """The reactions in the static equilibrium, without contact forces."""
    none = np.zeros((1, table.mass.shape[2]))
    sizes = np.array([[load.size if load.static else 0.0 for load in scene.loads]])
    sizes = sizes.reshape(1, len(scene.loads))
    values, total = table.evaluate(StressLaw.of(scene), none, none, none, sizes)
    return Reactions(support_names(scene), np.zeros(1), values, total)


def motion_reactions(table: ReactionTable, scene: Scene, model: Any, motion: Motion) -> Reactions:
    """The mean reactions of each time step of the last period of a motion.

    The mean of a step does not contain the oscillations from step to step of waves that the time
    step does not resolve. The mean of the stresses is exact, by two Gauss points along the step;
    that of the inertia is the change of momentum. With the discrete gradient these are the terms of
    the balance that the step fulfils.

    Args:
        table: the table of the model.
        scene: the scene of the motion.
        model: the reduced model.
        motion: its motion, with coordinates at two instants or more.
    """
    q, v, time = motion.coordinates, motion.velocity, motion.coordinate_time
    assert q is not None and v is not None and time is not None
    middle, half = 0.5 * (q[1:] + q[:-1]), (q[1:] - q[:-1]) / (2.0 * np.sqrt(3.0))
    velocity = 0.5 * (v[1:] + v[:-1])
    inertia = np.diff(v, axis=0) / np.diff(time)[:, None] + model.damping * velocity
    instant = np.array([factors(model.load_histories, float(t)) for t in time])
    factor = 0.5 * (instant[1:] + instant[:-1]).reshape(time.size - 1, len(scene.loads))
    law = StressLaw.of(scene)
    ends = [
        table.evaluate(law, middle + side * half, velocity, inertia, factor) for side in (-1.0, 1.0)
    ]
    values, total = (0.5 * (one + other) for one, other in zip(*ends, strict=True))
    force = motion.mean_force[1 - time.size :]
    contact = np.einsum("kpi,pix->kx", force, model.points.frame)
    return Reactions(support_names(scene), 0.5 * (time[1:] + time[:-1]), values, total + contact)
