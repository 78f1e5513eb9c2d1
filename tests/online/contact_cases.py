"""Contact points in front of every kind of surface, and one step of the contact law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import one_contact

from fenicsrom.online.contact.coating import Ring, coated
from fenicsrom.online.contact.law import at_rest, commit_contact_state, contact_force
from fenicsrom.online.contact.state import (
    ContactScratch,
    ContactState,
    ContactStep,
    Interval,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact.surfaces import CYLINDER, SPHERE, Contacts, frame
from fenicsrom.scene import Abradable

Array = NDArray[np.float64]


RUB = one_contact(
    preload=40.0, gap=1e-3, normal_stiffness=1e4, tangential_stiffness=2e4, friction=0.5
)
RUB3 = one_contact(
    3, preload=40.0, gap=1e-3, normal_stiffness=1e4, tangential_stiffness=2e4, friction=0.5
)
SCHEMES = [(0.0, False), (0.4, False), (0.5, True)]


def spoiled_scratch(points: int, d: int) -> ContactScratch:
    """Scratch arrays in which the results of an earlier step are NaN: nothing may depend on it."""
    found = contact_scratch(points, d)
    for array in (found.mean_force, found.mean_friction, found.slider_motion, found.guess):
        array.fill(np.nan)
    found.force_derivative.fill(np.nan)
    return found


def rest(contacts: Contacts, x: Array, slider: Array) -> ContactState:
    """The law at a displacement (d,) with a slider (d - 1,) in the tangent plane, at rest."""
    found = zero_contact_state(1, x.size)
    at_rest(contacts, x[None], np.array([[0.0, *slider]]), 0.0, found, contact_scratch(1, x.size))
    return found


def apply(contacts: Contacts, x: Array, slider: Array) -> tuple[int, Array, Array]:
    """State, force [N, T] and new slider in front of a plane."""
    found = rest(contacts, x, slider)
    return int(found.state[0]), (found.normal + found.friction)[0], found.slider[0, 1:]


def step(
    contacts: Contacts,
    start: ContactState,
    x: Array,
    a: float,
    line: bool,
    time: tuple[float, float] = (0.0, 1.0),
    blending: float = 0.0,
) -> Any:
    """A step of all points to x (P, d): the state at its end, the results, the dissipation and the
    work of the surface."""
    points, d = x.shape
    end, found, interval = (
        zero_contact_state(points, d),
        spoiled_scratch(points, d),
        Interval(*time, a, line),
    )
    end.x[:] = x
    found.blending[:] = blending
    sums = np.zeros(2)
    made = ContactStep(contacts, interval, start, end, found)
    for p in range(points):
        contact_force(made, p)
        sums += commit_contact_state(made, p)[:2]
    return end, found, *sums


def casing(
    d: int = 3,
    *,
    kind: int = CYLINDER,
    inside: bool = True,
    waves: bool = False,
    spin: float = 0.0,
    **values: Any,
) -> Contacts:
    """A point in front of a round surface of radius about 0.3 m with an oblique axis, whose normal
    there is the first axis."""
    given = {
        "preload": 3.0,
        "normal_stiffness": 2e4,
        "tangential_stiffness": 1e4,
        "friction": 0.4,
    } | values
    flat = one_contact(d, **given)
    side = 1.0 if inside else -1.0
    axes = np.zeros((1, d, d))
    if d == 2 or kind == SPHERE:
        axes[0] = frame(np.array([0.8, 0.6, 0.0][:d]))
    else:
        axes[0, :2] = np.array([[0.8, 0.6 * 0.6, 0.6 * 0.8], [-0.6, 0.8 * 0.6, 0.8 * 0.8]])
    return flat._replace(
        kind=np.array([kind]),
        axes=axes,
        centre=np.array([[-0.3 * side, 0.0, 0.0][:d]]),
        radius=np.array([0.3]),
        side=np.array([side]),
        spin=np.array([spin]),
        order=np.array([2.0, 5.0] if waves else []),
        height=np.array([[3e-3, -1e-3] if waves else []]),
        phase=np.array([[0.3, 1.0] if waves else []]),
        times=np.array([0.0, 2.0]),
        approach=np.array([[0.0, 4e-3]]),
    )


def worn_casing(d: int, **values: Any) -> Contacts:
    """A turning casing with a worn abradable layer of 20 nodes, whose stiffness is twice that of
    its contact spring."""
    made = casing(d, spin=2e-3, **values)
    layer = Abradable(thickness=5e-3, modulus=1e6, yield_stress=2e4, hardening=1e5, area=2e-4)
    ring = Ring(0, (0,), 0, 20, 0.0, 0.3, 0.02, 1e-3, layer)
    made = coated(made, [ring], np.array([2e-4]))
    made.coating.worn[:] = np.random.default_rng(3).uniform(0.0, 1e-4, 20)
    return made


SURFACES = [
    pytest.param(lambda d: RUB if d == 2 else RUB3, id="plane"),
    pytest.param(lambda d: casing(d), id="casing"),
    pytest.param(lambda d: casing(d, inside=False), id="shaft"),
    pytest.param(lambda d: casing(d, waves=True, spin=2e-3), id="oval casing that turns"),
    pytest.param(worn_casing, id="worn casing"),
    pytest.param(lambda d: casing(d, kind=SPHERE) if d == 3 else casing(d), id="sphere"),
]
