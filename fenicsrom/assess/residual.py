"""The residual indicator: the error of a basis without a run of the full model.

At some steps of the steady state the balance of the full model's own time step is evaluated at the
reduced motion, with its contact forces. The residual r is zero where the basis contains the full
motion. It is measured by its work on the linear structure, relative to that of the amplitude p of
the loads,

    indicator = sqrt(mean_k r_k^T K^-1 r_k / p^T K^-1 p),

the energy norm of the displacement that belongs to the residual. It has no unit. Neither the mesh
nor the mix of stiff axial and soft transverse forces changes its meaning, as they change that of
the plain norm |r|/|p|. The plain norm is kept beside it, to compare how well both rank the bases.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.fem.full import full_model
from fenicsrom.online.load_histories import largest
from fenicsrom.online.motion import Motion
from fenicsrom.online.scheme import scheme
from fenicsrom.scene import Scene

if TYPE_CHECKING:
    from fenicsrom.reduction.modes import Structure

INSTANTS = 16  # steps of the last period at which the residual is taken


def residuals(body: Structure, vectors: Array, motion: Motion, scene: Scene) -> Array:
    """Residuals of the full model's time step along the last period of a reduced motion.

    Args:
        body: the solid or the beam.
        vectors: (local, n) the basis R.
        motion: the reduced motion, with the coordinates of its last period.
        scene: of the motion.

    Returns:
        (local, k) residuals at `INSTANTS` steps, N.
    """
    model = full_model(body)
    plan = scheme(scene.time.scheme, model, scene.time.spectral_radius or 0.0)
    am, af, beta, gamma = plan.alpha_m, plan.alpha_f, plan.beta, plan.gamma
    assert (
        motion.coordinates is not None
        and motion.velocity is not None
        and motion.acceleration is not None
    )
    assert motion.coordinate_time is not None
    time, count = motion.coordinate_time, motion.coordinate_time.size
    first = motion.time.size - count
    rows = body.contact_rows
    found = []
    for k in np.unique(np.linspace(0, count - 2, INSTANTS).round().astype(int)):
        h = time[k + 1] - time[k]
        q, v, a = (
            vectors @ motion.coordinates[k],
            vectors @ motion.velocity[k],
            vectors @ motion.acceleration[k],
        )
        dq = vectors @ (motion.coordinates[k + 1] - motion.coordinates[k])
        a1 = dq / (beta * h * h) - v / (beta * h) - (0.5 / beta - 1.0) * a
        v1 = v + h * ((1.0 - gamma) * a + gamma * a1)
        start = model.elastic_at(q)[0] if plan.start_weight else np.zeros_like(q)
        elastic, _ = model.elastic_over_step(
            start, q, dq, plan.start_weight, plan.points, plan.weights
        )
        inertia = (1.0 - am) * a1 + am * a + plan.damping * ((1.0 - af) * v1 + af * v)
        load = (1.0 - af) * model.load(time[k + 1]) + af * model.load(time[k])
        force = motion.mean_force[first + k + 1].reshape(-1)
        found.append(model.mass_times(inertia) + elastic + rows.T @ force - load)
    return np.array(found).T


def indicators(
    body: Structure, vectors: Array, motion: Motion, scene: Scene
) -> tuple[float, float]:
    """Root mean squares of the residual, relative to the amplitude of the loads.

    Returns:
        In the energy norm, and in the plain norm.
    """
    found = residuals(body, vectors, motion, scene)
    varying = [not load.static for load in body.scene.loads]
    loads = (
        np.abs(body.load_vectors) @ np.where(varying, largest(body.load_histories), 0.0)[:, None]
    )

    def sizes(block: Array) -> tuple[Array, Array]:
        total = body.comm.allreduce
        return total(np.sum(block * body.factor.solve(block), axis=0)), total(
            np.sum(block**2, axis=0)
        )

    (energy, plain), (load_energy, load_plain) = sizes(found), sizes(loads)
    return float(np.sqrt(np.mean(energy) / load_energy[0])), float(
        np.sqrt(np.mean(plain) / load_plain[0])
    )
