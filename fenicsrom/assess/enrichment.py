"""The error of a motion due to its basis, from the candidates that are stored with the model.

The larger model with the coordinates (q, e) contains the reduced model at e = 0
(`fenicsrom.reduction.candidates`). At a motion q(t) of the reduced model the equations of e have
the residual

    r_e(t) = M_eq q'' + (alpha M_eq + Gamma_eq) q' + f_e(q, 0) - p_e(t) + B_e^T F(t),    (1)

which is a polynomial in q. It would drive the candidates as linear oscillators,

    e'' + alpha e' + K_ee e = -r_e(t),    (2)

whose response e_1 (by harmonics, with at least `LEAST_RATIO` of damping) shows which combinations
of candidates the motion lacks. A missing mode needs its derivatives too, which (1) does not excite;
the nonlinear part f_e(q, e_1) - f_e(q, 0) - K_ee e_1 of the force does, in a second response e_2.
The directions are the singular vectors of both, each scaled to unit elastic energy. The reduced
model is enriched by the largest of them, at most `DIRECTIONS`, and runs again. Its motion contains
what the residual does to q, to the contact and to the probe; its distance from the given motion is
the estimate. The residual therefore selects, and a solution of the nonlinear equations
measures.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.load_histories import factors
from fenicsrom.online.model import ReducedModel, reduced_model
from fenicsrom.online.motion import Motion
from fenicsrom.online.polynomial import ElasticPolynomial, pairs
from fenicsrom.online.pressure import transformed_pressure, unit_forces

SAMPLES = 4096  # most instants at which the residual is taken
DIRECTIONS = 8  # most combinations of candidates that are added to a nonlinear model
LEAST_RATIO = 0.02  # damping ratio that bounds the response of a candidate in resonance
NOISE = 1e-6  # part of the energy of the response that is rounding if one mode has no more
NEGLIGIBLE_ENERGY = 1e-5  # part of the energy of the response that the directions may leave out


def enriched(candidates: ReducedModel, size: int, motion: Motion) -> ReducedModel:
    """Enrich a reduced model by the candidates that a motion of it lacks.

    Args:
        candidates: the larger model, under the loads and the damping of the motion.
        size: n, the number of coordinates of the reduced model.
        motion: its motion, with the coordinates of the last period, or of the whole run.

    Returns:
        A model whose first n coordinates are those of the reduced model.
    """
    if candidates.linear:
        return candidates
    axes = directions(candidates, size, motion)
    transformation = np.zeros((candidates.size, size + axes.shape[1]))
    transformation[:size, :size] = np.eye(size)
    transformation[size:, size:] = axes
    return transformed(candidates, transformation)


def directions(candidates: ReducedModel, size: int, motion: Motion) -> Array:
    """The combinations (w, k) of candidates that a motion lacks, the largest first.

    Args:
        candidates: the larger model.
        size: n.
        motion: a motion of the reduced model with its coordinates.
    """
    time, q, residual = residuals(candidates, size, motion)
    stiffness = candidates.rest_stiffness()[size:, size:]
    squares, axes = np.linalg.eigh(0.5 * (stiffness + stiffness.T))  # the mass matrix is identity
    omega = np.sqrt(np.maximum(np.abs(squares), np.finfo(float).tiny))
    response = _response(time, residual @ axes, omega, candidates.damping)
    energetic = [response * omega]
    if not candidates.linear:
        bounded = response @ axes.T
        linear = candidates.elastic.stiffness[size:, size:]
        force = elastic_residual(candidates, size, q, bounded) - bounded @ linear.T
        force -= elastic_residual(candidates, size, q, np.zeros_like(bounded))
        energetic.append(_response(time, force @ axes, omega, candidates.damping) * omega)
    least = NOISE * float(np.sum(energetic[0] ** 2))
    found = np.concatenate([_significant(rows, least) for rows in energetic])
    _, values, rows = np.linalg.svd(found, full_matrices=False)
    if not values[0] > 0.0:
        return np.zeros((axes.shape[0], 0))
    left_out = 1.0 - np.cumsum(values**2) / np.sum(values**2)
    count = min(int(np.argmax(left_out <= NEGLIGIBLE_ENERGY)) + 1, DIRECTIONS)
    kept, _ = np.linalg.qr(axes @ (rows[:count].T / omega[:, None]))
    return np.asarray(kept)


def _response(time: Array, force: Array, omega: Array, damping: float) -> Array:
    """Response (k, w) of linear oscillators to the opposite of forces (k, w), by harmonics."""
    span = (time[-1] - time[0]) * time.size / (time.size - 1)
    frequency = 2.0 * np.pi * np.arange(time.size // 2 + 1)[:, None] / span
    loss = damping + 2.0 * LEAST_RATIO * omega
    transfer = 1.0 / (omega**2 - frequency**2 + 1j * frequency * loss)
    return np.asarray(-np.fft.irfft(transfer * np.fft.rfft(force, axis=0), time.size, axis=0))


def _significant(energetic: Array, least: float) -> Array:
    """Responses (k, w) scaled to unit energy, without those that are rounding.

    Rounding in soft modes would otherwise couple them to stiff ones in one direction. If all
    together have at most the energy `least`, all are rounding.
    """
    shares = np.sum(energetic**2, axis=0)
    total = float(shares.sum())
    if not total > least:
        return np.zeros_like(energetic)
    return np.where(shares < NOISE * total, 0.0, energetic) / np.sqrt(total)


def residuals(candidates: ReducedModel, size: int, motion: Motion) -> tuple[Array, Array, Array]:
    """The residual (1) at equal steps along a motion.

    Returns:
        Instants (k,) in s, coordinates q (k, n), and residuals (k, w) in N.
    """
    assert motion.coordinates is not None and motion.coordinate_time is not None
    times = motion.coordinate_time
    count = min(max(2 * times.size, 64), SAMPLES)
    time = np.linspace(times[0], times[-1], count, endpoint=False)
    q = np.array([np.interp(time, times, column) for column in motion.coordinates.T]).T
    velocity = np.gradient(q, time, axis=0)
    acceleration = np.gradient(velocity, time, axis=0)
    mass = candidates.mass[size:, :size]
    damping = candidates.damping * mass
    if candidates.velocity_forces:
        damping = damping + candidates.velocity_matrix[size:, :size]
    loads = np.array([factors(candidates.load_histories, t) for t in time])
    residual = acceleration @ mass.T + velocity @ damping.T
    residual += elastic_residual(candidates, size, q, np.zeros((count, mass.shape[0])))
    residual -= loads @ candidates.loads[size:].T
    if candidates.pressure.numbers.size:
        x = np.pad(q, ((0, 0), (0, candidates.size - size)))
        for k, number in enumerate(candidates.pressure.numbers):
            forces = unit_forces(candidates.pressure, k, x)[:, size:]
            residual -= loads[:, number, None] * forces
    if candidates.contact_rows.size:
        flat = motion.force.reshape(motion.time.size, -1)
        force = np.array([np.interp(time, motion.time, column) for column in flat.T]).T
        residual += force @ candidates.contact_rows[:, size:]
    return time, q, residual


def elastic_residual(candidates: ReducedModel, size: int, q: Array, e: Array) -> Array:
    """Elastic force (k, w) on the candidates at coordinates q (k, n) and e (k, w), N."""
    elastic, n = candidates.elastic, size
    x = np.concatenate([q, e], axis=1)
    force = elastic.force[n:] + x @ elastic.stiffness[n:].T
    if candidates.linear:
        return np.asarray(force)
    first, second = pairs(candidates.size)
    index = pair_index(candidates.size)
    products = x[:, first] * x[:, second]
    force += (products * np.where(first == second, 0.5, 1.0)) @ elastic.quadratic[:, n:]
    for k in range(e.shape[1]):
        force[:, k] += np.sum(x * (products @ elastic.cubic[index[n + k]].T), axis=1) / 3.0
    return np.asarray(force)


def pair_index(count: int) -> NDArray[np.int64]:
    """Position (n, n) of each pair in the order of `fenicsrom.online.polynomial.pairs`."""
    first, second = pairs(count)
    index = np.zeros((count, count), dtype=np.int64)
    index[first, second] = index[second, first] = np.arange(first.size)
    return index


def transformed(model: ReducedModel, t: Array) -> ReducedModel:
    """A model in the coordinates y of q = T y.

    Args:
        model: the model in q (N,).
        t: (N, m) T.
    """
    velocity = t.T @ model.velocity_matrix @ t if model.velocity_forces else None
    return reduced_model(
        t.T @ model.mass @ t,
        model.damping,
        _transformed_polynomial(model.elastic, t),
        t.T @ model.loads,
        model.load_histories,
        model.points,
        model.contact_rows @ t,
        model.contact_offset,
        model.probe @ t,
        model.probe_offset,
        velocity,
        transformed_pressure(model.pressure, t),
    )


def _transformed_polynomial(elastic: ElasticPolynomial, t: Array) -> ElasticPolynomial:
    """The elastic force T^T f(T y)."""
    force, stiffness = t.T @ elastic.force, t.T @ elastic.stiffness @ t
    if not elastic.cubic.size:
        return ElasticPolynomial(force, stiffness, elastic.quadratic, elastic.cubic)
    first, second = pairs(t.shape[0])
    one, other = pairs(t.shape[1])
    # a symmetric sum over i, j of T_ia T_jb S_ij is a sum over the pairs i <= j
    across = t[np.ix_(first, one)] * t[np.ix_(second, other)]
    swapped = t[np.ix_(second, one)] * t[np.ix_(first, other)]
    across += np.where(first == second, 0.0, 1.0)[:, None] * swapped
    plain = elastic.cubic / np.where(first == second, 0.5, 1.0)[None, :]
    cubic = across.T @ plain @ across * np.where(one == other, 0.5, 1.0)[None, :]
    return ElasticPolynomial(force, stiffness, across.T @ elastic.quadratic @ t, cubic)
