"""Models of some of the coordinates of a larger model."""

from __future__ import annotations

import numpy as np
from support import random_model

from fenicsrom.online.model.subspace import nested_model


def test_nested_model_has_the_force_and_energy_of_the_larger_one() -> None:
    whole, chosen = random_model(5, masters=2), [0, 1, 4, 2]
    part = nested_model(whole, chosen)
    q = np.random.default_rng(3).standard_normal(4)
    embedded = np.zeros(5)
    embedded[chosen] = q
    force, energy = part.elastic_at(q)
    wanted, same = whole.elastic_at(embedded)
    np.testing.assert_allclose(force, wanted[chosen], rtol=1e-12)
    assert abs(energy - same) < 1e-12 * abs(same)
    np.testing.assert_array_equal(
        part.contact_displacement(q), whole.contact_displacement(embedded)
    )
    np.testing.assert_allclose(part.mass_times(q), whole.mass_times(embedded)[chosen], rtol=1e-12)
    np.testing.assert_array_equal(part.load(0.1), whole.load(0.1)[chosen])
