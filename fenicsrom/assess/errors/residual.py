"""The residual indicator: the error of a basis without a run of the full model.

At some steps of the steady state the balance of the full model's own time step is evaluated at the
reduced motion, with its contact forces. The residual r is zero where the basis contains the full
motion. Its size is measured by the work that it does on the linear structure, relative to the work
of the load amplitude p,

    indicator = sqrt(mean_k r_k^T K^-1 r_k / p^T K^-1 p),

which is the energy norm of the displacement that the residual would cause in the linear structure.
The indicator has no unit. This measure does not depend on the mesh, or on the ratio of stiff axial
to soft transverse forces. The plain norm |r|/|p| depends on both, and is computed only to compare
how well the two norms rank the bases.
"""

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.fem.full.full import full_model
from fenicsrom.online.model.loads import largest
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.step.scheme import scheme
from fenicsrom.online.step.state import no_state
from fenicsrom.online.step.step import step_coefficients, write_residual
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.principal import combinations
from fenicsrom.reduction.protocols import Structure
from fenicsrom.scene import Scene

INSTANTS = 16  # steps of the last period at which the residual is taken


def residuals(body: Structure, vectors: Array, motion: Motion, scene: Scene) -> Array:
    """Residuals of the full model's time step along the last period of a reduced motion.

    Args:
        body: the solid or the beam.
        vectors: (local, n) the basis R.
        motion: the reduced motion, with the coordinates of its last period.
        scene: the scene of the motion.

    Returns:
        (local, k) residuals at `INSTANTS` steps, N.
    """
    model = full_model(body)
    plan = scheme(scene.time.scheme, model, scene.time.spectral_radius or 0.0)
    assert motion.coordinates is not None and motion.coordinate_time is not None
    assert motion.velocity is not None and motion.acceleration is not None
    time, count = motion.coordinate_time, motion.coordinate_time.size
    first = motion.time.size - count
    state = no_state(vectors.shape[0], 0, 1)
    trial, found = state.trial, []
    for k in _instants(motion):
        state.q[:] = vectors @ motion.coordinates[k]
        state.v[:] = vectors @ motion.velocity[k]
        state.a[:] = vectors @ motion.acceleration[k]
        trial.dq[:] = vectors @ (motion.coordinates[k + 1] - motion.coordinates[k])
        at = step_coefficients(plan, time[k + 1] - time[k])
        trial.inertia_offset[:] = at.inertia_v * state.v + at.inertia_a * state.a
        trial.external_force[:] = (1.0 - plan.alpha_f) * model.load(time[k + 1])
        trial.external_force[:] += plan.alpha_f * model.load(time[k])
        model.set_interval(time[k], time[k])
        if plan.start_weight:
            state.elastic_force[:] = model.elastic_at(state.q)[0]
        model.set_interval(time[k], time[k + 1])
        elastic, _ = model.elastic_over_step(
            state.elastic_force, state.q, trial.dq, plan.start_weight, plan.points, plan.weights
        )
        write_residual(model, plan, state, at, elastic)
        force = motion.mean_force[first + k + 1].reshape(-1)
        found.append(trial.residual + body.contact_rows.T @ force)
    return np.array(found).T


def _instants(motion: Motion) -> NDArray[np.int64]:
    """The steps of the last period, by their starts, at which the residual is taken."""
    assert motion.coordinate_time is not None
    last = motion.coordinate_time.size - 2
    return np.unique(np.linspace(0, last, INSTANTS).round().astype(np.int64))


def unseen(
    body: Structure, modes: ComponentModes, basis: ReducedBasis, motion: Motion, scene: Scene
) -> tuple[Array, Array]:
    """Static responses K^-1 r to the residuals along a motion, outside of the basis of the motion.

    Args:
        body: the solid or the beam.
        modes: its component modes.
        basis: the basis of the motion.
        motion: the motion, with the coordinates of its last period.
        scene: the scene of the motion.

    Returns:
        The principal responses (local, k), the largest elastic energy first, and the square roots
        of these energies (k,), relative to the mean elastic energy of the motion.
    """
    found = modes.inverse.solve(residuals(body, basis.vectors, motion, scene))
    vectors, energies = combinations(body, modes, basis, found / np.sqrt(found.shape[1]))
    assert motion.coordinates is not None
    moved = basis.vectors @ motion.coordinates[_instants(motion)].T
    energy = np.mean(np.diag(body.inner(moved, body.stiffness_times(moved))))
    return vectors, np.sqrt(energies / energy) if energy > 0.0 else np.zeros(energies.size)


def indicators(
    body: Structure, vectors: Array, motion: Motion, scene: Scene
) -> tuple[float | None, float | None]:
    """Root mean squares of the residual, relative to the amplitude of the loads.

    Returns:
        The value in the energy norm, and the value in the plain norm; None without loads that vary.
    """
    found = residuals(body, vectors, motion, scene)
    varying = [not load.static for load in scene.loads]
    factors = np.where(varying, largest(body.load_histories), 0.0)
    loads = np.abs(body.load_vectors) @ factors[:, None]

    def sizes(block: Array) -> tuple[Array, ...]:
        work = block * body.factor.solve(block), block**2
        return tuple(body.comm.allreduce(np.sum(part, axis=0)) for part in work)

    energy, plain = (
        float(np.sqrt(np.mean(size) / load[0])) if load[0] > 0.0 else None
        for size, load in zip(sizes(found), sizes(loads), strict=True)
    )
    return energy, plain
