"""Families of periodic motions: for a parameter, the data of the motion and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.derivative.sensitivity import Drift, no_drift
from fenicsrom.online.model.loads import AMPLITUDE, OMEGA
from fenicsrom.online.model.model import ReducedModel


class Problem(NamedTuple):
    """The data of a periodic motion at one value of the parameter.

    Attributes:
        model: the model.
        contacts: parameters of the contact points.
        period: period of the loads, s.
        drift: derivatives of the data by the parameter.
    """

    model: ReducedModel
    contacts: Contacts
    period: float
    drift: Drift


Family = Callable[[float], Problem]


def frequency_family(
    model: ReducedModel,
    contacts: Contacts,
    period: float,
    *,
    spin: bool = False,
    displaced: NDArray[np.bool_] | None = None,
) -> Family:
    """Problems by the excitation frequency in Hz: all sines keep their ratio to it.

    Args:
        model: the model.
        contacts: parameters of the contact points.
        period: period of the loads that are given, s.
        spin: whether the surfaces turn in proportion to the frequency (an engine order).
        displaced: (s,) sines of a given displacement of the supports
            (`fenicsrom.online.model.support_motion.displacement_sines`); none by default.
    """
    nothing = no_drift(contacts, model.load_histories)
    # the amplitude of a load is proportional to this power of the frequency
    powers = np.zeros(len(nothing.sines)) if displaced is None else 2.0 * displaced

    def at(frequency: float) -> Problem:
        factor = frequency * period
        sines = model.load_histories.sines.copy()
        sines[:, OMEGA] *= factor
        sines[:, AMPLITUDE] *= factor**powers
        by_sines = nothing.sines.copy()
        by_sines[:, OMEGA] = sines[:, OMEGA] / frequency
        by_sines[:, AMPLITUDE] = powers * sines[:, AMPLITUDE] / frequency
        moved, by_contacts = contacts, nothing.contacts
        if spin:
            moved = contacts._replace(spin=contacts.spin * factor)
            by_contacts = by_contacts._replace(spin=contacts.spin * period)
        return Problem(
            model._replace(load_histories=model.load_histories._replace(sines=sines)),
            moved,
            1.0 / frequency,
            Drift(by_contacts, by_sines, 0.0, -1.0 / frequency),
        )

    return at


def force_family(
    model: ReducedModel, contacts: Contacts, period: float, load: int | None = None
) -> Family:
    """Problems by a factor on the amplitude of one load, or on those of all loads that vary."""
    spans = model.load_histories.spans
    chosen = np.zeros(model.load_histories.sines.shape[0], dtype=bool)
    for k in range(spans.shape[0]):
        if load is None or k == load:
            chosen[spans[k, 0] : spans[k, 1]] = True
    if load is None:
        chosen &= model.load_histories.sines[:, OMEGA] != 0.0

    def at(factor: float) -> Problem:
        sines = model.load_histories.sines.copy()
        nothing = no_drift(contacts, model.load_histories)
        by_sines = nothing.sines.copy()
        by_sines[chosen, AMPLITUDE] = sines[chosen, AMPLITUDE]
        sines[chosen, AMPLITUDE] *= factor
        return Problem(
            model._replace(load_histories=model.load_histories._replace(sines=sines)),
            contacts,
            period,
            nothing._replace(sines=by_sines),
        )

    return at


def excitation_family(problem: Problem) -> Family:
    """Problems by a factor on all periodic loads of one problem; its own are at 1."""
    chosen = problem.model.load_histories.sines[:, OMEGA] != 0.0

    def at(factor: float) -> Problem:
        model, contacts = problem.model, problem.contacts
        sines, nothing = model.load_histories.sines.copy(), no_drift(contacts, model.load_histories)
        by_sines = nothing.sines.copy()
        by_sines[chosen, AMPLITUDE] = sines[chosen, AMPLITUDE]
        sines[chosen, AMPLITUDE] *= factor
        return problem._replace(
            model=model._replace(load_histories=model.load_histories._replace(sines=sines)),
            drift=nothing._replace(sines=by_sines),
        )

    return at


def contact_family(
    model: ReducedModel,
    contacts: Contacts,
    period: float,
    name: str,
    weights: Array | None = None,
) -> Family:
    """Problems by a number of the contacts: p times `weights`.

    Args:
        model: the model.
        contacts: parameters of the contact points.
        period: period of the loads, s.
        name: "preload", "normal_stiffness", "tangential_stiffness", "friction", "spin", or "gap".
            The gap is added to the radius (subtracted outside of a surface) of the contacts given.
        weights: (P,) what one unit of p means at each point; 0 leaves a point as it is. 1 if not
            given.
    """
    weights = np.ones(contacts.preload.size) if weights is None else np.asarray(weights, float)

    def at(value: float) -> Problem:
        nothing = no_drift(contacts, model.load_histories)
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
        return Problem(model, moved, period, nothing._replace(contacts=drift))

    return at


def damping_family(model: ReducedModel, contacts: Contacts, period: float) -> Family:
    """Problems by the mass-proportional damping alpha in 1/s."""

    def at(value: float) -> Problem:
        nothing = no_drift(contacts, model.load_histories)
        return Problem(
            model._replace(damping=float(value)), contacts, period, nothing._replace(damping=1.0)
        )

    return at
