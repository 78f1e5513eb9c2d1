"""Contacts with complex parameters, by which the contact law is differentiated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_cases import RUB, SURFACES, casing

from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.state import STICK, contact_scratch, zero_contact_state
from fenicsrom.online.derivative.contact_sensitivity import (
    PARAMETERS,
    is_constant,
    perturb,
    state_of,
)
from fenicsrom.online.kernels.complex_step import as_complex


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
    nothing = base._replace(**{each: np.zeros_like(getattr(base, each)) for each in PARAMETERS})
    assert is_constant(base, nothing, 0)
    changed = nothing._replace(**{name: np.ones_like(getattr(base, name))})
    assert is_constant(base, changed, 0) == (name == "approach")  # there is none


def test_law_of_a_surface_that_moves_depends_on_the_period() -> None:
    nothing = RUB._replace(**{each: np.zeros_like(getattr(RUB, each)) for each in PARAMETERS})
    assert is_constant(RUB, nothing, 0)
    assert not is_constant(RUB._replace(spin=np.ones(1)), nothing, 0)
    approaching = RUB._replace(times=np.array([0.0]), approach=np.array([[1e-3]]))
    assert not is_constant(approaching, nothing._replace(approach=np.zeros((1, 1))), 0)
