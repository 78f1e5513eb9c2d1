"""The error of a motion due to its basis, from the candidates that are stored with the model.

The larger model with the coordinates (q, e) contains the reduced model at e = 0
(`fenicsrom.reduction.candidates`). At a motion q(t) of the reduced model the equations of e have
the residual

    r_e(t) = M_eq q'' + (alpha M_eq + Gamma_eq) q' + f_e(q, 0) - p_e(t) + B_e^T F(t),    (1)

which is a polynomial in q. It would drive the candidates as linear oscillators,

    e'' + alpha e' + K_ee e = -r_e(t),    (2)

whose response (by harmonics, with at least `LEAST_RATIO` of damping) shows which combinations of
candidates the motion lacks: the singular vectors of e(t) in the norm of the elastic energy. The
reduced model is enriched by the largest of them, at most `DIRECTIONS`, and runs again. Its motion
contains what the residual does to q, to the contact and to the probe; its distance from the given
motion is the estimate. The residual therefore selects, and a solution of the nonlinear equations
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
    time, residual = residuals(candidates, size, motion)
    stiffness = candidates.elastic.stiffness[size:, size:]
    squares, axes = np.linalg.eigh(0.5 * (stiffness + stiffness.T))  # the mass matrix is identity
    omega = np.sqrt(np.maximum(np.abs(squares), np.finfo(float).tiny))
    span = (time[-1] - time[0]) * time.size / (time.size - 1)
    frequency = 2.0 * np.pi * np.arange(time.size // 2 + 1)[:, None] / span
    damping = candidates.damping + 2.0 * LEAST_RATIO * omega
    transfer = 1.0 / (omega**2 - frequency**2 + 1j * frequency * damping)
    response = transfer * np.fft.rfft(residual @ axes, axis=0)
    energetic = np.concatenate([response.real, response.imag]) * omega
    shares = np.sum(energetic**2, axis=0)
    # rounding in soft modes would couple them to stiff ones in one direction
    energetic[:, shares < NOISE * shares.sum()] = 0.0
    _, values, rows = np.linalg.svd(energetic, full_matrices=False)
    if not values[0] > 0.0:
        return np.zeros((axes.shape[0], 0))
    left_out = 1.0 - np.cumsum(values**2) / np.sum(values**2)
    count = min(int(np.argmax(left_out <= NEGLIGIBLE_ENERGY)) + 1, DIRECTIONS)
    found, _ = np.linalg.qr(axes @ (rows[:count].T / omega[:, None]))
    return np.asarray(found)


def residuals(candidates: ReducedModel, size: int, motion: Motion) -> tuple[Array, Array]:
    """The residual (1) at equal steps along a motion: instants (k,), s, and residuals (k, w), N."""
    assert motion.coordinates is not None and motion.coordinate_time is not None
    times = motion.coordinate_time
    count = min(max(2 * times.size, 64), SAMPLES)
    time = np.linspace(times[0], times[-1], count, endpoint=False)
    q = np.array([np.interp(time, times, column) for column in motion.coordinates.T]).T
    velocity = np.gradient(q, time, axis=0)
    acceleration = np.gradient(velocity, time, axis=0)
    mass = candidates.mass[size:, :size]
    damping = candidates.damping * mass
    if candidates.gyroscopic:
        damping = damping + candidates.gyroscopic_matrix[size:, :size]
    loads = np.array([factors(candidates.load_histories, t) for t in time])
    residual = acceleration @ mass.T + velocity @ damping.T + elastic_residual(candidates, size, q)
    residual -= loads @ candidates.loads[size:].T
    if candidates.contact_rows.size:
        flat = motion.force.reshape(motion.time.size, -1)
        force = np.array([np.interp(time, motion.time, column) for column in flat.T]).T
        residual += force @ candidates.contact_rows[:, size:]
    return time, residual


def elastic_residual(candidates: ReducedModel, size: int, q: Array) -> Array:
    """Elastic force (k, w) on the candidates at coordinates q (k, n) of the reduced model, N."""
    elastic, n, total = candidates.elastic, size, candidates.size
    force = elastic.force[n:] + q @ elastic.stiffness[n:, :n].T
    if candidates.linear:
        return np.asarray(force)
    index = pair_index(total)
    first, second = pairs(n)
    inside = index[first, second]
    products = q[:, first] * q[:, second]
    halved = products * np.where(first == second, 0.5, 1.0)
    force += halved @ elastic.quadratic[inside, n:]
    for k in range(n):
        force += q[:, k : k + 1] * (products @ elastic.cubic[np.ix_(index[n:, k], inside)].T) / 3.0
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
    gyroscopic = t.T @ model.gyroscopic_matrix @ t if model.gyroscopic else None
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
        gyroscopic,
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
