"""Contacts with complex parameters, by which the contact law is differentiated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_cases import RUB, SURFACES, casing, worn_casing

from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.state import STICK, Interval, contact_scratch, zero_contact_state
from fenicsrom.online.contact.surfaces import Contacts, planes
from fenicsrom.online.derivative.contact_sensitivity import (
    contact_data,
    differentiate_along,
    differentiate_law,
    law_derivative,
    state_of,
)
from fenicsrom.online.kernels.numbers import STEP, vector


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("surface", SURFACES)
def test_state_of_sticking_point_is_that_of_a_point_at_rest(surface: Any, d: int) -> None:
    contacts, rng = surface(d), np.random.default_rng(6)
    for _ in range(10):
        rest = zero_contact_state(1, d)
        x = rng.uniform(1e-3, 3e-3, (1, d))
        slider = x + rng.uniform(-1e-4, 1e-4, (1, d))
        at_rest(contacts, x, slider, 0.1, rest, contact_scratch(1, d))
        assert rest.state[0] == STICK
        found = state_of(contacts, 0, vector(x[0]), vector(rest.slider[0]), 0.1)
        np.testing.assert_allclose(found.trial, rest.trial_normal_force[0], rtol=1e-12)
        np.testing.assert_allclose(found.normal[:d], rest.normal[0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.friction[:d], rest.friction[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", sorted({*Contacts._fields} - {"kind", "history", "coating"}))
def test_law_depends_on_each_parameter_that_changes(name: str) -> None:
    base = casing(3, waves=True)
    assert not contact_data(base, base).varies[0]
    moved = base._replace(**{name: getattr(base, name) + 1j * STEP})
    assert contact_data(base, moved).varies[0]


def test_law_of_a_layer_depends_on_its_yield_stress() -> None:
    base = worn_casing(3)
    coating = base.coating._replace(yield_force=base.coating.yield_force + 1j * STEP)
    assert contact_data(base, base._replace(coating=coating)).varies[0]


def test_law_of_a_surface_that_moves_depends_on_the_period() -> None:
    assert not contact_data(RUB, RUB, retimed=True).varies[0]
    turning = RUB._replace(spin=np.ones(1))
    approaching = RUB._replace(times=np.array([0.0]), approach=np.array([[1e-3]]))
    for contacts in (turning, approaching):
        assert contact_data(contacts, contacts, retimed=True).varies[0]
        assert not contact_data(contacts, contacts).varies[0]


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("discrete_gradient", [True, False])
@pytest.mark.parametrize(("stretch", "sticks"), [(2e-6, True), (2e-5, False)])
def test_law_before_a_plane_has_the_derivatives_of_complex_steps(
    stretch: float, sticks: bool, discrete_gradient: bool, d: int
) -> None:
    preload, kn, kt, mu = (np.array([value]) for value in (3.0, 2e5, 1e5, 0.3))
    contacts = planes(preload, np.zeros(1), kn, kt, mu, d)
    data, law, along = contact_data(contacts, contacts), law_derivative(1, d), []
    rng = np.random.default_rng(3)
    blending = complex(0.2, STEP) if discrete_gradient else 0j
    times: Any = 0j, 1e-4 + 0j
    step = Interval(*times, 0.5 if discrete_gradient else 0.3, discrete_gradient)
    w0, x0, x1 = (rng.uniform(-1e-6, 1e-6, d) for _ in range(3))
    x0[1:] += 0.5 * stretch
    x1[1:] += stretch
    for c in range(3 * d + 1):
        if c != 2 * d:  # the normal component of the slider, which has no effect
            differentiate_along(law, data.still, step, 0, c, x0, x1, w0, blending, False)
        along.append((law.force[0, :, c].copy(), law.slider[0, :, c].copy()))
    assert differentiate_law(law, data, step, 0, x0, x1, w0, blending, False) == sticks
    for c, (force, slider) in enumerate(along):
        np.testing.assert_allclose(law.force[0, :, c], force, rtol=1e-12, atol=1e-10)
        np.testing.assert_allclose(law.slider[0, :, c], slider, rtol=1e-12, atol=1e-14)
