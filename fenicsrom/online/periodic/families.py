"""Families of periodic problems: for each value of a parameter, a problem with its derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fenicsrom.arrays import Array
from fenicsrom.online.derivative.sensitivity import Drift, no_drift
from fenicsrom.online.model.loads import AMPLITUDE, OMEGA
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.model.turning import no_turning

Family = Callable[[float], Problem]
"""The problem at a value of the parameter; its `drift` holds the derivatives by the parameter."""


def frequency_family(
    problem: Problem, *, spin: bool = False, displaced: NDArray[np.bool_] | None = None
) -> Family:
    """Problems by the excitation frequency in Hz: all sines keep their ratio to it.

    Args:
        problem: the problem at one frequency.
        spin: whether the surfaces turn in proportion to the frequency (an engine order).
        displaced: (s,) sines of a given displacement of the supports
            (`fenicsrom.online.model.support_motion.displacement_sines`); none by default.
    """
    contacts, period, nothing = problem.contacts, problem.period, _no_drift(problem)
    # the amplitude of a load is proportional to this power of the frequency
    powers = np.zeros(len(nothing.sines)) if displaced is None else 2.0 * displaced

    def at(frequency: float) -> Problem:
        factor = frequency * period
        sines = problem.model.load_histories.sines.copy()
        sines[:, OMEGA] *= factor
        sines[:, AMPLITUDE] *= factor**powers
        by_sines = nothing.sines.copy()
        by_sines[:, OMEGA] = sines[:, OMEGA] / frequency
        by_sines[:, AMPLITUDE] = powers * sines[:, AMPLITUDE] / frequency
        moved, by_contacts = contacts, nothing.contacts
        if spin:
            moved = contacts._replace(spin=contacts.spin * factor)
            by_contacts = by_contacts._replace(spin=contacts.spin * period)
        return _with_sines(problem, sines)._replace(
            contacts=moved,
            period=1.0 / frequency,
            drift=nothing._replace(contacts=by_contacts, sines=by_sines, period=-1.0 / frequency),
        )

    return at


def speed_family(problem: Problem, speed: float, displaced: NDArray[np.bool_]) -> Family:
    """Problems by the speed of rotation in rev/min, which all loads and surfaces follow.

    The model at a speed Omega has the elastic force f(q) - Omega^2 (c + Q q) and the forces
    (D + Omega G) v of `fenicsrom.online.model.turning`.

    Args:
        problem: the problem at one speed, whose model has the data of a varying speed.
        speed: this speed, rev/min.
        displaced: as `frequency_family`.
    """
    by_frequency = frequency_family(problem, spin=True, displaced=displaced)
    model, unit, ratio = problem.model, np.pi / 30.0, 1.0 / (problem.period * speed)
    turning = model.turning
    rest = CubicSpline(turning.rest[:, 0], turning.rest[:, 3:])

    def at(rpm: float) -> Problem:
        found, omega = by_frequency(ratio * rpm), unit * rpm
        drift, square, by_rpm = found.drift, omega**2, 2.0 * unit * omega
        elastic = model.elastic._replace(
            force=model.elastic.force - square * turning.centrifugal,
            stiffness=model.elastic.stiffness - square * turning.softening,
        )
        velocity = model.velocity_matrix + omega * turning.coriolis
        slower = drift.contacts._replace(spin=ratio * drift.contacts.spin)
        return found._replace(
            model=found.model._replace(
                elastic=elastic,
                velocity_matrix=velocity if velocity.any() else np.zeros((0, 0)),
                turning=no_turning(),
            ),
            drift=drift._replace(
                contacts=slower,
                sines=ratio * drift.sines,
                period=ratio * drift.period,
                force=-by_rpm * turning.centrifugal,
                stiffness=-by_rpm * turning.softening,
                velocity=unit * turning.coriolis,
                rest=by_rpm * rest(square, 1),
            ),
            rest=rest(square),
        )

    return at


def force_family(problem: Problem, load: int | None = None) -> Family:
    """Problems by a factor on the amplitude of one load, or on those of all loads that vary."""
    histories, nothing = problem.model.load_histories, _no_drift(problem)
    if load is None:
        chosen = histories.sines[:, OMEGA] != 0.0
    else:
        chosen = np.zeros(histories.sines.shape[0], dtype=bool)
        chosen[slice(*histories.spans[load, :2])] = True

    def at(factor: float) -> Problem:
        sines, by_sines = histories.sines.copy(), nothing.sines.copy()
        by_sines[chosen, AMPLITUDE] = sines[chosen, AMPLITUDE]
        sines[chosen, AMPLITUDE] *= factor
        return _with_sines(problem, sines)._replace(drift=nothing._replace(sines=by_sines))

    return at


def contact_family(problem: Problem, name: str, weights: Array | None = None) -> Family:
    """Problems by a number of the contacts: p times `weights`.

    Args:
        problem: the problem, with P contact points.
        name: "preload", "normal_stiffness", "tangential_stiffness", "friction", "spin", or "gap".
            The gap is added to the radius (subtracted outside of a surface) of the contacts given.
        weights: (P,) what one unit of p means at each point; 0 leaves a point as it is. 1 if not
            given.
    """
    contacts, nothing = problem.contacts, _no_drift(problem)
    weights = np.ones(contacts.preload.size) if weights is None else np.asarray(weights, float)

    def at(value: float) -> Problem:
        if name == "gap":
            change = weights * contacts.side
            moved = contacts._replace(radius=contacts.radius + value * change)
            drift = nothing.contacts._replace(radius=change)
        else:
            given = getattr(contacts, name)
            chosen: dict[str, Any] = {name: np.where(weights != 0.0, value * weights, given)}
            moved = contacts._replace(**chosen)
            along: dict[str, Any] = {name: weights}
            drift = nothing.contacts._replace(**along)
        return problem._replace(contacts=moved, drift=nothing._replace(contacts=drift))

    return at


def damping_family(problem: Problem) -> Family:
    """Problems by the mass-proportional damping alpha in 1/s."""
    drift = _no_drift(problem)._replace(damping=1.0)

    def at(value: float) -> Problem:
        return problem._replace(model=problem.model._replace(damping=float(value)), drift=drift)

    return at


def _no_drift(problem: Problem) -> Drift:
    """The derivatives of data that stay as they are."""
    return no_drift(problem.contacts, problem.model.load_histories)


def _with_sines(problem: Problem, sines: Array) -> Problem:
    """The problem with other sines of its load histories."""
    histories = problem.model.load_histories._replace(sines=sines)
    return problem._replace(model=problem.model._replace(load_histories=histories))
