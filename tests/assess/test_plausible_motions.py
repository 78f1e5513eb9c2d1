"""Loads and motions that are most likely consequences of wrong input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import beam_scene, first, linear_model, oscillator

from fenicsrom.assess.errors.plausibility import (
    implausible_loads,
    implausible_motion,
    is_explained,
    strain_warnings,
)
from fenicsrom.notes import NoteKind
from fenicsrom.online.contact.points import points_on
from fenicsrom.online.motion import measures
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.stress.stress import Deformation


@pytest.mark.parametrize(
    ("first_hz", "is_warned"), [(0.02, True), (0.04, False), (300.0, False), (400.0, True)]
)
def test_first_frequency_far_from_the_loads_is_warned(first_hz: float, is_warned: bool) -> None:
    """The load has 3.2 Hz; the ratio may be up to 100."""
    scene = beam_scene(2)
    model = linear_model(np.eye(2), np.eye(2), loads=[[1.0], [0.0]])
    found = implausible_loads(model, scene, np.array([first_hz, 1e3]))
    assert bool(found) == is_warned and is_explained(found) == is_warned


@pytest.mark.parametrize(("force", "is_warned"), [(1.1e-4, True), (1.2e-4, False)])
def test_loads_of_very_different_size_are_warned(force: float, is_warned: bool) -> None:
    """The other load is 111.29 N, in a direction in which the body is four times as stiff."""
    scene = beam_scene(2, ("loads.0.direction=[0.0, 1.0]",))
    small = {"group": "load", "direction": [1.0, 0.0], "force": 0.5 * force, "frequency": 3.2}
    table = {"group": "load", "direction": [0.0, 1.0], "force": 111.29, "frequency": 3.2}
    scene = beam_scene(2, loads=[table, small])
    model = linear_model(
        np.eye(2), np.diag([1.0, 4.0]), loads=np.eye(2)[::-1], load_histories=load_histories(scene)
    )
    found = implausible_loads(model, scene, np.array([3.0]))
    assert bool(found) == is_warned
    assert all("loads[0]" in text and "loads[1]" in text for text in found)


@pytest.mark.parametrize(("factor", "is_warned"), [(0.9, False), (1.1, True)])
def test_load_that_moves_the_linear_body_far_is_warned(factor: float, is_warned: bool) -> None:
    """k = m = 1 and 3.2 Hz, of which the static response is 1 + (6.4 π)² times as large."""
    force = factor * 10.0 * 2.54 * (1.0 + (6.4 * np.pi) ** 2)
    load = {"group": "load", "direction": [0.0, 1.0], "force": force, "frequency": 3.2}
    scene = beam_scene(2, loads=[load])
    model = linear_model(
        np.eye(1), np.eye(1), loads=np.eye(1), load_histories=load_histories(scene)
    )
    found = implausible_loads(model, scene, np.array([3.0]), 2.54)
    assert bool(found) == is_warned and all("loads[0]" in text for text in found)


@pytest.mark.parametrize(("alpha", "is_warned"), [(8.9, False), (9.1, True)])
def test_mode_that_does_not_swing_is_warned(alpha: float, is_warned: bool) -> None:
    """The first frequency is 5 rad/s, so that the ratio is one where alpha + 1 is 10."""
    model = linear_model(np.eye(2), np.diag([25.0, 100.0]), damping=alpha)
    spinning = np.array([[1.0, 3.0], [-3.0, 0.0]])  # viscous damping and a gyroscopic part
    found = implausible_loads(
        model._replace(velocity_matrix=spinning), beam_scene(2), np.array([3.0])
    )
    assert bool(found) == is_warned and all("damping ratio of 1.0" in text for text in found)


@pytest.mark.parametrize(("force", "is_warned"), [(999.0, False), (1001.0, True)])
def test_contact_spring_that_is_compressed_far_is_warned(force: float, is_warned: bool) -> None:
    """1 kN on half of 1e4 N/m are 0.2 m, a twentieth of 4 m."""
    _, _, motion = oscillator()
    points, *_ = first(2, 2)
    points = points._replace(tributary_area=np.array([0.5]))
    steps = motion.time.size
    pressed = replace(
        motion,
        force=np.full((steps, 1, 2), force),
        gap=np.zeros((steps, 1)),
        displacement=0.0 * motion.displacement,
    )
    found = implausible_motion(pressed, points, 4.0, beam_scene(2))
    assert bool(found) == is_warned and all("contacts[0]" in text for text in found)


def test_motion_larger_than_the_body_is_warned() -> None:
    _, _, motion = oscillator()
    points, *_ = first(0, 2)
    reached = float(np.linalg.norm(motion.displacement, axis=2).max())
    assert implausible_motion(motion, points, 1.01 * reached, beam_scene(2)) == []
    (found,) = implausible_motion(motion, points, 0.99 * reached, beam_scene(2))
    assert found.kind is NoteKind.IMPLAUSIBLE


@pytest.mark.parametrize(("factor", "is_warned"), [(9.0, False), (11.0, True)])
def test_surface_out_of_reach_is_warned(factor: float, is_warned: bool) -> None:
    _, _, motion = oscillator()
    points, *_ = first(2, 2)
    travel = 2.0 * measures.amplitude(motion)[0]
    steps = motion.time.size
    far = replace(motion, gap=np.full((steps, 1), factor * travel), force=np.zeros((steps, 1, 2)))
    last = float(np.ptp(motion.displacement[:, 0, 0]))
    assert last == pytest.approx(travel, rel=0.5)
    far = replace(far, gap=np.full((steps, 1), factor * last))
    found = implausible_motion(far, points, np.inf, beam_scene(2))
    assert bool(found) == is_warned and all("contacts[0]" in text for text in found)
    touching = replace(far, force=np.ones((steps, 1, 2)))
    assert implausible_motion(touching, points, np.inf, beam_scene(2)) == []


@pytest.mark.parametrize(("slide", "touches", "is_warned"), [(0.9, 1, 0), (1.1, 1, 1), (1.1, 0, 0)])
def test_slide_past_the_next_point_of_a_joint_is_warned(
    slide: float, touches: int, is_warned: int
) -> None:
    _, _, motion = oscillator()
    points = points_on(
        0, np.ones(2), np.array([[0.0, 0.0], [1e-3, 0.0]]), np.tile(np.eye(2), (2, 1, 1))
    )
    steps, scene = motion.time.size, beam_scene(2)
    joint = replace(scene, contacts=(replace(scene.contacts[0], against="other"),))
    x = np.zeros((steps, 2, 2))
    x[-1, 1, 1] = slide * 1e-3
    force = touches * np.full((steps, 2, 2), 1e-3)
    moved = replace(motion, displacement=x, force=force, gap=np.zeros((steps, 2)))
    found = implausible_motion(moved, points, np.inf, joint)
    assert len(found) == is_warned and all("1.1 mm" in text for text in found)
    assert implausible_motion(moved, points, np.inf, scene) == []


@pytest.mark.parametrize(
    ("smallest", "largest", "word"),
    [(0.95, 1.05, ""), (0.85, 1.05, "compressive"), (0.95, 1.15, "tensile")],
)
def test_strains_above_a_tenth_are_warned(smallest: float, largest: float, word: str) -> None:
    state = Deformation(1.0, np.zeros(2), smallest, largest)
    found = strain_warnings([("here", state)])
    assert len(found) == bool(word) and all(word in text for text in found)
