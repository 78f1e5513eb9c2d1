"""Response curves with unstable stretches that are shorter than a step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import beam_scene, excited_stiffness
from test_response_runs import assert_continued, interrupted

from fenicsrom.assess.curves.checks import contradictions
from fenicsrom.assess.curves.denials import Denials
from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.response_problem import family_of, start_motion
from fenicsrom.assess.curves.trust import checks
from fenicsrom.online.curves.continuation import Continuation, follow
from fenicsrom.online.curves.curve import UNSURE, Piece
from fenicsrom.online.curves.events import outside
from fenicsrom.online.periodic.shooting import Shooting
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import read_scene


def excited() -> StoredModel:
    """A mode that loses its stability in 0.1 % of the range."""
    scene = beam_scene(
        2,
        (
            "loads.0.force=0.03",
            "loads.0.frequency=0.15",
            "material.mass_damping=1e-4",
            "time.steps_per_period=200",
            f"response.first={0.9 / (2.0 * np.pi)}",
            f"response.last={1.1 / (2.0 * np.pi)}",
        ),
        contacts=None,
        probe={"group": "tip"},
    )
    model = excited_stiffness(scene.material.mass_damping, 8.0, load_histories(scene))
    return StoredModel(model, scene, "rubin", ("1V", "2V"), 9, np.array([0.3, 0.15]), {})


@pytest.mark.slow
def test_curve_interrupted_at_a_short_unstable_stretch_continues(tmp_path: Path) -> None:
    stored = excited()
    whole = response(stored)
    (curve,) = whole.curves
    assert [point.kind for point in curve.special] == ["branch point", "branch point"]
    (number,) = (k for k, point in enumerate(curve.points) if outside(point))
    reached = set()
    for calls in range(number - 1, number + 3):  # before and after the stretch
        folder = tmp_path / str(calls)
        part = interrupted(stored, folder, calls)
        reached.add(any(outside(point) for point in part.curves[0].points))
        assert_continued(response(stored, resume=folder), part, whole)
    assert reached == {False, True}


def test_instability_that_long_steps_have_moved_is_contradicted_by_half_the_step() -> None:
    """The tongue of the first mode is narrower than its shift by the midpoint rule."""
    steps, e = 40, 1e-4
    stored = excited().with_overrides([f"time.steps_per_period={steps}"])
    family = family_of(stored)
    centre = (1.0 + 2.0 * e - (2.0 * np.pi / steps) ** 2 / 12.0) / (2.0 * np.pi)
    shooting = Shooting(family(centre))
    path = Continuation(shooting, family, 0.1, 0.2, np.zeros(shooting.map.size))
    points = [
        path.at_parameter(np.zeros(shooting.map.size), centre * (1.0 + share * e))
        for share in (-0.4, -0.2, 0.0, 0.2, 0.4)
    ]
    assert not any(point.stable for point in points)
    found = checks([Piece(points)], family)
    assert all(check.finer_verdict == "stable" for check in found)
    assert all(check.contradicted_by_step for check in found)
    (said,) = contradictions(found, stored.scene, "frequency")
    assert f"{len(found)} of {len(found)}" in said and "steps_per_period" in said


@pytest.mark.slow
def test_short_unstable_stretch_of_the_beam_is_found_with_the_default_steps() -> None:
    pytest.importorskip("dolfinx")
    from fenicsrom.study import build_model

    demo = Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"
    stored = build_model(read_scene(demo))
    changed = stored.with_overrides(["response.first=2.9", "response.last=3.6"])
    family = family_of(changed)
    start = start_motion(changed, family, 2.9)
    curve = follow(family, start, 2.9, (2.9, 3.6))
    kinds = [point.kind for point in curve.special]
    assert kinds == ["first lift-off", "branch point", "branch point", "last lift-off"]
    ends = [point.parameter for point in curve.special if point.kind == "branch point"]
    assert ends == pytest.approx([3.239364, 3.240123], abs=2e-6)  # steps of 0.004 see them too
    assert len(curve.points) < 80
    # half the time step has no such stretch between 3.19 and 3.29 Hz
    piece = Piece(curve.points, curve.special)
    Denials(family, lambda: None).apply([piece])
    (denied,) = (point for point in piece.points if point.denied)
    assert ends[0] < denied.parameter < ends[1] and denied.known_stability == UNSURE
    assert [point.kind for point in piece.special] == ["first lift-off", "last lift-off"]
