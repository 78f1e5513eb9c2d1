"""Contacts with complex parameters, by which the contact law is differentiated."""

from __future__ import annotations

import numpy as np
from contact_cases import casing

from fenicsrom.online.complex_step import as_complex
from fenicsrom.online.contact_sensitivity import PARAMETERS, perturb


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
