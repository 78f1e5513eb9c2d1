"""Measures of motions known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from motions import FRICTION, PERIOD, STIFFNESS, jenkins, motion, side_by_side
from support import beam_scene, contact_points

from fenicsrom.online.contact.points import ContactPoints, no_points
from fenicsrom.online.motion import measures
from fenicsrom.online.step.state import PeriodicSearch
from fenicsrom.post.run.report import error_sentence


def test_amplitude_is_half_of_peak_to_peak_of_last_period():
    time = np.linspace(0, 3 * PERIOD, 1201)
    decay = 1 + 5 * np.exp(-40 * time)
    angle = 2 * np.pi * time / PERIOD
    u = np.stack(
        [0.7 + 0.002 * np.cos(2 * angle), -0.2 + 0.03 * np.sin(angle), 0.01 * np.cos(angle)], axis=1
    )
    got = measures.amplitudes(
        motion(time, (u * np.where(time < 2 * PERIOD - 1e-9, decay, 1)[:, None])[:, None])
    )
    assert got["normal"] == pytest.approx(0.002, rel=1e-4)
    assert got["tangential"] == pytest.approx([0.03, 0.01], rel=1e-4)


@pytest.mark.parametrize("period", [None, PERIOD])
def test_rms_is_that_of_a_sine_about_its_mean(period):
    """Also of motions that are shorter than a second."""
    time = 2 * PERIOD * np.linspace(0, 1, 2001) ** 1.2
    u = np.zeros((time.size, 1, 2))
    u[:, 0, 0], u[:, 0, 1] = 0.3, 0.5 + 0.02 * np.sin(2 * np.pi * time / PERIOD)
    found = measures.rms(motion(time, u, period=period))
    np.testing.assert_allclose(found, [0.0, 0.02 / np.sqrt(2)], rtol=2e-3, atol=1e-12)


def test_contact_fractions_with_uneven_steps_weigh_by_time():
    """Open for 30 % of the period, slip for 50 %, stick for 20 %, with ten times as many steps
    during stick."""
    parts = np.concatenate(
        [np.linspace(0, 0.8, 800, endpoint=False), np.linspace(0.8, 1, 2000, endpoint=False)]
    )
    time = PERIOD * np.append((np.arange(2)[:, None] + parts).ravel(), 2.0)
    cycle = (time / PERIOD) % 1
    state = np.select([cycle < 0.3 - 1e-9, cycle < 0.8 - 1e-9], [-1, 0], 1).astype(np.int8)[:, None]
    u = np.zeros((len(time), 1, 2))
    got = measures.contact_fractions(motion(time, u, np.zeros_like(u), state))
    assert got == pytest.approx({"open": 0.3, "slip": 0.5, "stick": 0.2}, abs=1.5e-3)
    assert sum(got.values()) == pytest.approx(1, abs=1e-12)


def test_contact_fractions_of_two_points_are_averaged():
    u = np.zeros((101, 2, 2))
    state = np.tile(np.array([1, -1], dtype=np.int8), (101, 1))
    got = measures.contact_fractions(motion(np.linspace(0, PERIOD, 101), u, u, state))
    assert got == pytest.approx({"open": 0.5, "slip": 0.0, "stick": 0.5})


@pytest.mark.parametrize("uneven", [False, True])
def test_dissipation_matches_area_of_jenkins_loop(uneven):
    """4 mu N (X - mu N / k_t) at a constant normal force; the fraction of slip follows from the
    same loop."""
    case = jenkins(normal=0.0, steps=4000, uneven=uneven)
    limit = FRICTION * 30.0
    area = 4 * limit * (8e-3 - limit / STIFFNESS)
    assert measures.friction_dissipation_per_period(case) == pytest.approx(area, rel=1e-4)
    part = case.last_period()
    assert np.trapezoid(case.force[part, 0, 1], case.displacement[part, 0, 1]) == pytest.approx(
        area, rel=1e-4
    )
    stick = np.arccos(1 - 2 * limit / STIFFNESS / 8e-3) / np.pi
    if not uneven:
        assert measures.contact_fractions(case)["stick"] == pytest.approx(stick, abs=2e-3)
    assert measures.peak_normal_force(case) == pytest.approx(30.0)


def test_fractions_and_peak_force_match_lift_off():
    """N = 30 - 50 cos 2wt opens where cos 2wt > 0.6."""
    case = jenkins(normal=5e-3, uneven=False, steps=4000)
    assert measures.contact_fractions(case)["open"] == pytest.approx(
        np.arccos(0.6) / np.pi, abs=1e-3
    )
    assert measures.peak_normal_force(case) == pytest.approx(80.0, rel=1e-4)


def test_dissipation_without_period_counts_whole_motion():
    case = jenkins(normal=0.0)
    free = motion(
        case.time, case.displacement, case.force, case.state, case.friction_dissipation, period=None
    )
    energy = case.friction_dissipation[-1]
    assert measures.friction_dissipation_per_period(free) == pytest.approx(energy)


@pytest.mark.parametrize("dimension", [2, 3])
def test_point_summaries_match_single_points(dimension):
    """A Jenkins loop, one with lift-off, and a point that only sticks: each summary equals that of
    the point alone."""
    cases = [
        jenkins(dimension, normal=0.0),
        jenkins(dimension, normal=5e-3),
        jenkins(dimension, normal=0.0, tangential=1e-4),
    ]
    together = side_by_side(*cases)
    points = measures.point_summaries(together)
    for point, case in zip(points, cases, strict=True):
        assert point["peak_normal_force_N"] == measures.peak_normal_force(case)
        assert point["fraction"] == pytest.approx(measures.contact_fractions(case))
        assert point["friction_dissipation_per_period_J"] == pytest.approx(
            measures.friction_dissipation_per_period(case), rel=1e-6, abs=1e-9
        )
    limit = FRICTION * 30.0
    if dimension == 2:
        area = 4 * limit * (8e-3 - limit / STIFFNESS)
        assert points[0]["friction_dissipation_per_period_J"] == pytest.approx(area, rel=2e-3)
    assert points[2]["friction_dissipation_per_period_J"] == pytest.approx(0.0, abs=1e-12)
    assert sum(point["friction_dissipation_per_period_J"] for point in points) == pytest.approx(
        measures.friction_dissipation_per_period(together)
    )


def test_peak_total_force_adds_forces_of_one_instant():
    """Two points are pressed in turn, so the peak of the total is smaller than the sum of the two
    peaks."""
    time = np.linspace(0, PERIOD, 401)
    force = np.zeros((401, 2, 2))
    force[:, 0, 0], force[:, 1, 0] = (
        np.maximum(0, sign * np.sin(2 * np.pi * time / PERIOD)) for sign in (30, -20)
    )
    case = motion(time, np.zeros_like(force), force, np.zeros((401, 2), dtype=np.int8))
    assert (
        measures.peak_normal_force(case)
        == measures.peak_total_normal_force(case)
        == pytest.approx(30)
    )
    force[:, 1, 0] += 5.0
    assert measures.response_summary(case)["peak_total_normal_force_N"] == pytest.approx(35)
    assert measures.response_summary(case)["peak_normal_force_N"] == pytest.approx(30)


def test_errors_are_percent_of_reference():
    exact, close = jenkins(normal=1e-3, tangential=8e-3), jenkins(normal=1.1e-3, tangential=7.96e-3)
    errors = measures.errors_percent(close, exact)
    assert list(errors) == [
        "amplitude_tangential",
        "amplitude_normal",
        "peak_normal_force",
        "friction_dissipation_per_period",
    ]
    assert errors["amplitude_tangential"] == pytest.approx(0.5, rel=1e-6)
    assert errors["amplitude_normal"] == pytest.approx(10, rel=1e-6)
    assert errors["peak_normal_force"] == pytest.approx(
        100 * 1.0 / 40.0, rel=1e-3
    )  # 30 N and 1e4 N/m * 1 or 1.1 mm
    more = (
        100
        * (close.friction_dissipation[-1] - close.friction_dissipation[1200])
        / (exact.friction_dissipation[-1] - exact.friction_dissipation[1200])
        - 100
    )
    assert errors["friction_dissipation_per_period"] == pytest.approx(abs(more)) and abs(more) > 0.1
    assert set(measures.errors_percent(exact, exact).values()) == {0.0}
    assert measures.errors_percent(close, jenkins(normal=0.0))["amplitude_normal"] is None
    free = motion(exact.time, exact.displacement)
    assert measures.errors_percent(exact, free)["peak_normal_force"] is None
    assert measures.errors_percent(exact, free)["friction_dissipation_per_period"] is None


@pytest.mark.parametrize(
    ("verdict", "tends", "told"),
    [
        ("not found", False, "not found"),
        ("stable", True, "stable"),
        ("stable", False, "not reached"),
        ("torus", True, "unstable: torus"),
    ],
)
def test_search_verdict_tells_stability_and_whether_the_run_tends_to_it(verdict, tends, told):
    search = PeriodicSearch(verdict, tends, None, 1, 5, 4, 1e-12, np.zeros(0, complex), 0)
    assert measures.search_verdict(search) == told


def test_tangential_error_in_3d_compares_vectors():
    plane, space = jenkins(2), jenkins(3, phase=np.pi / 2)
    assert measures.errors_percent(plane, space)["amplitude_tangential"] == pytest.approx(
        100 * 0.5 / 1.25**0.5, rel=1e-3
    )


def test_motion_has_settled_only_if_four_periods_agree():
    """The amplitude of the period before the last three differs."""
    for odd in range(6):
        time = np.linspace(0.0, 6 * PERIOD, 1201)
        size = np.where(np.abs(time / PERIOD - odd - 0.5) < 0.5 - 1e-6, 1.1, 1.0)
        u = np.zeros((time.size, 1, 2))
        u[:, 0, 1] = size * np.sin(2 * np.pi * time / PERIOD)
        case = replace(motion(time, u), steady=False)
        assert measures.has_settled(case) == (odd < 2)


def test_point_with_force_zero_never_touched():
    u = np.zeros((101, 2, 2))
    force = np.zeros_like(u)
    force[50, 1, 0] = 3.0
    points = ContactPoints(
        np.arange(2), np.ones(2), np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1))
    )
    case = motion(np.linspace(0, PERIOD, 101), u, force)
    (sentence,) = measures.out_of_reach(case, points)
    assert sentence.startswith("1 point ") and sentence.key == "contacts[0]"


def test_negligible_dissipation_is_not_compared():
    """A motion that sticks dissipates rounding only; the largest energy is 2 J."""

    def sticking(dissipated):
        case = jenkins()
        return replace(case, friction_dissipation=dissipated * case.time / PERIOD)

    def error(ours, theirs):
        errors = measures.errors_percent(sticking(ours), sticking(theirs))
        return errors["friction_dissipation_per_period"]

    assert error(1.9e-10, 1e-15) is None and error(1e-15, 1e-10) is None
    assert error(1e-3, 1e-15) == pytest.approx(100.0 * 1e-3 / 2e-9)
    assert error(1.1e-3, 1e-3) == pytest.approx(10.0)
    errors = {"amplitude_tangential": 1.0, "friction_dissipation_per_period": None}
    assert "zero or negligible: dissipation" in error_sentence(
        errors, beam_scene(2), contact_points([1.0, 0.0])
    )
    scene = beam_scene(2, contacts=None, probe={"group": "tip"})
    free = error_sentence(errors, scene, no_points(2))
    assert "y amplitude 1 %" in free and "dissipation" not in free
