"""The sentences on deformations at which the material law has no meaning."""

from __future__ import annotations

import numpy as np

from fenicsrom.assess.errors.plausibility import strain_warnings
from fenicsrom.online.stress.stress import Deformation


def state(volume_ratio: float, smallest: float, largest: float = 1.5) -> Deformation:
    return Deformation(volume_ratio, np.array([0.5, 0.25]), smallest, largest)


def test_small_strains_are_not_mentioned() -> None:
    assert not strain_warnings([("at A", state(0.95, 0.91, 1.09))])


def test_first_large_compression_is_named_with_the_largest() -> None:
    states = [("at A", state(1.0, 1.0)), ("at B", state(1.0, 0.89)), ("at C", state(1.0, 0.8))]
    (said,) = strain_warnings(states)
    assert "at B" in said and "20 %" in said


def test_first_inverted_state_is_named_with_its_place() -> None:
    states = [("at A", state(0.5, 0.6)), ("at B", state(-0.2, 0.3)), ("at C", state(-0.9, 0.1))]
    (said,) = strain_warnings(states)
    assert "at B" in said and "-0.2" in said and "(0.5, 0.25)" in said
