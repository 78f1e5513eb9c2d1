"""Contacts with complex parameters, by which the contact law is differentiated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_cases import RUB, SURFACES, casing

from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.state import STICK, contact_scratch, zero_contact_state
from fenicsrom.online.contact.surfaces import Contacts, planes
from fenicsrom.online.derivative.contact_sensitivity import (
    PARAMETERS,
    ComplexInterval,
    differentiate_along,
    differentiate_law,
    is_constant,
    law_derivative,
    perturb,
    state_of,
)
from fenicsrom.online.kernels.dense import STEP, as_complex


def no_change(base: Contacts) -> Contacts:
    """Derivatives of the parameters of contacts that are zero."""
    return base._replace(**{name: np.zeros_like(getattr(base, name)) for name in PARAMETERS})


def test_every_parameter_of_a_contact_is_perturbed() -> None:
    base = casing(3, waves=True, spin=0.7)
    changes = {
        name: np.full_like(getattr(base, name), 2.0 + k) for k, name in enumerate(PARAMETERS)
    }
    found = as_complex(
        casing(3, waves=True, preload=7.0)._replace(phase=base.phase + 1.0), PARAMETERS
    )
    perturb(found, 0, base, base._replace(**changes), 0.5)
    for name, change in changes.items():
        np.testing.assert_array_equal(getattr(found, name), getattr(base, name) + 0.5j * change)


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("surface", SURFACES)
def test_state_of_sticking_point_is_that_of_a_point_at_rest(surface: Any, d: int) -> None:
    contacts, rng = surface(d), np.random.default_rng(6)
    for _ in range(10):
        rest, found = zero_contact_state(1, d), zero_contact_state(1, d)
        x = rng.uniform(1e-3, 3e-3, (1, d))
        slider = x + rng.uniform(-1e-4, 1e-4, (1, d))
        at_rest(contacts, x, slider, 0.1, rest, contact_scratch(1, d))
        assert rest.state[0] == STICK
        found.x[:], found.slider[:] = x, rest.slider
        state_of(contacts, 0, 0.1, found, contact_scratch(1, d))
        np.testing.assert_allclose(found.trial_normal_force, rest.trial_normal_force, rtol=1e-12)
        np.testing.assert_allclose(found.normal, rest.normal, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.friction, rest.friction, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", PARAMETERS)
def test_law_depends_on_each_parameter_that_changes(name: str) -> None:
    base = casing(3, waves=True)._replace(times=np.zeros(0), approach=np.zeros((1, 0)))
    nothing = no_change(base)
    assert is_constant(base, nothing, 0)
    changed = nothing._replace(**{name: np.ones_like(getattr(base, name))})
    assert is_constant(base, changed, 0) == (name == "approach")  # there is none


def test_law_of_a_surface_that_moves_depends_on_the_period() -> None:
    nothing = no_change(RUB)
    assert is_constant(RUB, nothing, 0)
    assert not is_constant(RUB._replace(spin=np.ones(1)), nothing, 0)
    approaching = RUB._replace(times=np.array([0.0]), approach=np.array([[1e-3]]))
    assert not is_constant(approaching, nothing._replace(approach=np.zeros((1, 1))), 0)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("discrete_gradient", [True, False])
@pytest.mark.parametrize(("stretch", "sticks"), [(2e-6, True), (2e-5, False)])
def test_law_before_a_plane_has_the_derivatives_of_complex_steps(
    stretch: float, sticks: bool, discrete_gradient: bool, d: int
) -> None:
    preload, kn, kt, mu = (np.array([value]) for value in (3.0, 2e5, 1e5, 0.3))
    contacts = planes(preload, np.zeros(1), kn, kt, mu, d)
    nothing = contacts._replace(
        **{name: np.zeros_like(getattr(contacts, name)) for name in PARAMETERS}
    )
    law, along, rng = law_derivative(contacts, 1, d), [], np.random.default_rng(3)
    blending = complex(0.2, STEP) if discrete_gradient else 0j
    step = ComplexInterval(0j, 1e-4 + 0j, 0.5 if discrete_gradient else 0.3, discrete_gradient)
    w0, x0, x1 = (rng.uniform(-1e-6, 1e-6, d) for _ in range(3))
    x0[1:] += 0.5 * stretch
    x1[1:] += stretch
    perturb(law.contacts, 0, contacts, nothing, 0.0)
    for c in range(3 * d + 1):
        if c != 2 * d:  # the normal component of the slider, which has no effect
            differentiate_along(law, step, 0, c, x0, x1, w0, blending, False)
        along.append((law.force[0, :, c].copy(), law.slider[0, :, c].copy()))
    assert differentiate_law(law, contacts, nothing, step, 0, x0, x1, w0, blending, False) == sticks
    for c, (force, slider) in enumerate(along):
        np.testing.assert_allclose(law.force[0, :, c], force, rtol=1e-12, atol=1e-10)
        np.testing.assert_allclose(law.slider[0, :, c], slider, rtol=1e-12, atol=1e-14)
