"""Stiffness damping of the shortening by bending: its share is the error of the amplitude."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import beam_scene

import fenicsrom as fr
from fenicsrom.assess.curves.backbone import backbone
from fenicsrom.assess.curves.response import response
from fenicsrom.assess.errors.shortening import shortening_notes, shortening_share
from fenicsrom.assess.studies.ringdown import ringdown
from fenicsrom.notes import AMPLITUDES, DAMPING_RATIOS
from fenicsrom.online.store.archive import StoredModel

pytestmark = pytest.mark.slow

FREQUENCY, RATIO = 25.0169, 0.01  # Hz, of the first mode
MODAL, STIFF = {"ratios": [RATIO]}, {"stiffness": RATIO / (np.pi * FREQUENCY)}
SIZES = ("length=1", "height=0.03", "elements_along=10", "load_at=0.5")


def cantilever(damping: dict[str, Any], force: float, **tables: Any) -> StoredModel:
    """A steel cantilever of 1 m by 30 mm that a force on its tip excites at its resonance."""
    overrides = (f"geometry.parameters.{size}" for size in SIZES)
    up = {"direction": [0.0, 1.0], "force": force, "frequency": FREQUENCY}
    scene = beam_scene(
        2,
        (*overrides, "material.mass_damping=0", "time.steps_per_period=100"),
        contacts=None,
        damping=damping,
        loads=[{"group": "tip", **up}],
        probe={"group": "tip"},
        basis={"modes": 2},
        **tables,
    )
    return fr.build_model(scene)


@pytest.mark.parametrize(("force", "doubtful"), [(0.9, False), (5.0, True)])
def test_share_is_what_the_amplitude_lacks_beside_modal_damping(
    force: float, doubtful: bool
) -> None:
    found = []
    for damping in (MODAL, STIFF):
        stored = cantilever(damping, force)
        motion = stored.simulate(keep_coordinates=True)
        found.append(np.ptp(motion.probe[motion.last_period(), 1]))
    share = shortening_share(stored, motion)
    assert share == pytest.approx(1.0 - found[1] / found[0], rel=0.1, abs=1e-4)
    assert bool(shortening_notes(stored, motion)) == doubtful == (share > 0.01)
    assert shortening_share(cantilever(MODAL, force), motion) == 0.0


def test_curves_and_decays_in_which_shortening_is_damped_are_in_doubt() -> None:
    tables = {
        "response": {"first": 0.99 * FREQUENCY, "last": 1.01 * FREQUENCY},
        "backbone": {"mode": 1, "first": 1e-3, "last": 1e-2},
        "ringdown": {"mode": 1, "periods": 3, "factor": 30.0},
    }
    stored = cantilever(STIFF, 10.0, **tables)
    notes = {
        AMPLITUDES: response(stored).warnings,
        DAMPING_RATIOS: backbone(stored).warnings,
        "ringdown": ringdown(stored).warnings,
    }
    for quantity, warnings in notes.items():
        (note,) = [note for note in warnings if note.key == "damping.stiffness"]
        assert note.quantity == {"ringdown": DAMPING_RATIOS}.get(quantity, quantity)
