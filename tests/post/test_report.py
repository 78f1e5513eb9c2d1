"""Numbers, figures and reports from motions known in closed form, and files that appear whole or
not at all."""

import itertools
import json
import re
import resource
import signal
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from fenicsrom.errors import AccuracyError
from fenicsrom.files import atomic_folder, atomic_write
from fenicsrom.online import measures
from fenicsrom.online.motion import Motion
from fenicsrom.post import figures

PERIOD = 0.25
FRICTION, NORMAL_STIFFNESS, STIFFNESS = 0.5, 1e4, 2e4


def jenkins(
    dimension=2,
    preload=30.0,
    normal=1e-3,
    tangential=8e-3,
    periods=4,
    steps=400,
    uneven=True,
    phase=0.0,
):
    """A point led around: u_n = -normal cos 2wt, u_t = tangential sin wt, with the contact law
    applied step by step."""
    parts = np.linspace(0, 1, steps + 1)[:-1]
    if uneven:
        parts = parts + 0.12 * np.sin(2 * np.pi * parts) / (2 * np.pi)
    time = PERIOD * np.append((np.arange(periods)[:, None] + parts).ravel(), periods)
    angle = 2 * np.pi * time / PERIOD
    shift = np.zeros((len(time), 1, dimension))
    shift[:, 0, 0] = -normal * np.cos(2 * angle)
    shift[:, 0, 1] = tangential * np.sin(angle)
    if dimension == 3:
        shift[:, 0, 2] = 0.5 * tangential * np.sin(angle + phase)
    force, state, friction_dissipation = (
        np.zeros_like(shift),
        np.zeros((len(time), 1), dtype=np.int8),
        np.zeros(len(time)),
    )
    slider = shift[0, 0, 1:].copy()
    for i, u in enumerate(shift[:, 0]):
        pressure = max(0.0, preload + NORMAL_STIFFNESS * u[0])
        pull = STIFFNESS * (u[1:] - slider)
        size = np.linalg.norm(pull)
        state[i] = -1 if pressure == 0 else 1 if size <= FRICTION * pressure else 0
        if state[i] < 1:
            pull = pull * FRICTION * pressure / size if pressure else 0 * pull
            moved = u[1:] - pull / STIFFNESS - slider
            slider = slider + moved
            friction_dissipation[i] = (pull + force[i - 1, 0, 1:]) / 2 @ moved if i else 0.0
        force[i, 0] = [pressure, *pull]
    return motion(time, shift, force, state, friction_dissipation=np.cumsum(friction_dissipation))


def motion(
    time,
    displacement,
    force=None,
    state=None,
    friction_dissipation=None,
    period=PERIOD,
    point_friction_dissipation=None,
):
    """A motion with an energy ledger that adds up but for 1e-3 J at the end."""
    ns, _, d = displacement.shape
    friction_dissipation = np.zeros(ns) if friction_dissipation is None else friction_dissipation
    points = 0 if force is None else force.shape[1]
    return Motion(
        time=time,
        period=period,
        displacement=displacement,
        force=np.zeros((ns, 0, d)) if force is None else force,
        mean_force=np.zeros((ns, points, d)),
        gap=np.zeros((ns, points)),
        state=np.zeros((ns, 0), dtype=np.int8) if state is None else state,
        kinetic=2.0 * np.sin(2 * np.pi * time / PERIOD) ** 2,
        elastic=2.0 * np.cos(2 * np.pi * time / PERIOD) ** 2,
        contact_energy=np.zeros(ns),
        work=friction_dissipation + time,
        damping_dissipation=time - 1e-3 * (time / time[-1]),
        friction_dissipation=friction_dissipation,
        point_friction_dissipation=np.tile(friction_dissipation[:, None] / max(points, 1), points)
        if point_friction_dissipation is None
        else point_friction_dissipation,
        steady=True,
        periods=round(time[-1] / PERIOD),
        steps=ns - 1,
        rejected=2,
        newton_iterations=3 * ns,
        seconds=0.1,
    )


# numbers


def test_amplitudes_are_half_of_peak_to_peak_over_the_last_period():
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


def test_fractions_weigh_instants_by_time_not_by_count():
    """Open for 30 % of the period, slip for 50 %, stick for 20 %, with ten times as many steps in
    the stick."""
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


def test_fractions_average_over_points():
    u = np.zeros((101, 2, 2))
    state = np.tile(np.array([1, -1], dtype=np.int8), (101, 1))
    got = measures.contact_fractions(motion(np.linspace(0, PERIOD, 101), u, u, state))
    assert got == pytest.approx({"open": 0.5, "slip": 0.0, "stick": 0.5})


@pytest.mark.parametrize("uneven", [False, True])
def test_the_jenkins_loop_dissipates_its_area(uneven):
    """4 mu N (X - mu N / k_t) at a constant normal force, and the slip lasts as long as the loop
    says."""
    case = jenkins(normal=0.0, steps=4000, uneven=uneven)
    limit = FRICTION * 30.0
    area = 4 * limit * (8e-3 - limit / STIFFNESS)
    assert measures.dissipated_per_period(case) == pytest.approx(area, rel=1e-4)
    part = case.last_period()
    assert np.trapezoid(case.force[part, 0, 1], case.displacement[part, 0, 1]) == pytest.approx(
        area, rel=1e-4
    )
    stick = np.arccos(1 - 2 * limit / STIFFNESS / 8e-3) / np.pi
    if not uneven:
        assert measures.contact_fractions(case)["stick"] == pytest.approx(stick, abs=2e-3)
    assert measures.peak_normal_force(case) == pytest.approx(30.0)


def test_lift_off_shows_in_fractions_and_peak_force():
    """N = 30 - 50 cos 2wt opens where cos 2wt > 0.6."""
    case = jenkins(normal=5e-3, uneven=False, steps=4000)
    assert measures.contact_fractions(case)["open"] == pytest.approx(
        np.arccos(0.6) / np.pi, abs=1e-3
    )
    assert measures.peak_normal_force(case) == pytest.approx(80.0, rel=1e-4)


def test_without_contact_everything_is_open_and_nothing_rubs():
    time = np.linspace(0, 2 * PERIOD, 401)
    u = np.stack(
        [0.001 * np.sin(4 * np.pi * time / PERIOD), 0.2 * np.sin(2 * np.pi * time / PERIOD)], axis=1
    )
    summary = measures.response_summary(motion(time, u[:, None]))
    assert summary["amplitude_m"]["normal"] == pytest.approx(0.001, rel=1e-3)
    assert summary["amplitude_m"]["tangential"] == pytest.approx([0.2], rel=1e-3)
    assert summary["fraction"] == {"open": 1.0, "slip": 0.0, "stick": 0.0}
    assert summary["peak_normal_force_N"] == summary["dissipated_per_period_J"] == 0.0


def test_without_a_period_the_whole_motion_counts():
    case = jenkins(normal=0.0)
    free = motion(
        case.time, case.displacement, case.force, case.state, case.friction_dissipation, period=None
    )
    assert measures.dissipated_per_period(free) == pytest.approx(case.friction_dissipation[-1])


def test_the_summary_of_a_response_has_the_promised_keys():
    summary = measures.response_summary(jenkins(3, phase=1.0))
    assert list(summary) == [
        "amplitude_m",
        "fraction",
        "peak_normal_force_N",
        "peak_total_normal_force_N",
        "dissipated_per_period_J",
        "energy_imbalance",
        "steady",
        "periods",
        "steps",
        "newton_iterations",
    ]
    assert (
        list(summary["amplitude_m"]) == ["normal", "tangential"]
        and len(summary["amplitude_m"]["tangential"]) == 2
    )
    assert list(summary["fraction"]) == ["open", "slip", "stick"]
    assert summary["energy_imbalance"] == pytest.approx(1e-3 / 2.0, rel=1e-6)
    assert summary["steady"] is True and summary["periods"] == 4 and summary["steps"] == 1600
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def side_by_side(*cases):
    """Motions of one contact point each as the points of one motion."""
    joined = [
        np.concatenate([getattr(case, name) for case in cases], axis=1)
        for name in ("displacement", "force", "state")
    ]
    friction_dissipation = np.array([case.friction_dissipation for case in cases])
    return motion(
        cases[0].time,
        *joined,
        friction_dissipation=friction_dissipation.sum(axis=0),
        point_friction_dissipation=friction_dissipation.T,
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_each_point_has_its_peak_its_states_and_its_share_of_the_friction(dimension):
    """A Jenkins loop, one that lifts off, and a point that only sticks: each as it is alone."""
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
        assert point["dissipated_per_period_J"] == pytest.approx(
            measures.dissipated_per_period(case), rel=1e-6, abs=1e-9
        )
    limit = FRICTION * 30.0
    if dimension == 2:
        area = 4 * limit * (8e-3 - limit / STIFFNESS)
        assert points[0]["dissipated_per_period_J"] == pytest.approx(area, rel=2e-3)
    assert points[2]["dissipated_per_period_J"] == pytest.approx(0.0, abs=1e-12)
    assert sum(point["dissipated_per_period_J"] for point in points) == pytest.approx(
        measures.dissipated_per_period(together)
    )


def test_the_total_force_is_that_of_one_instant():
    """Two points pressed in turn: together never as hard as their two peaks."""
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


def test_errors_are_percent_of_the_reference():
    exact, close = jenkins(normal=1e-3, tangential=8e-3), jenkins(normal=1.1e-3, tangential=7.96e-3)
    errors = measures.errors_percent(close, exact)
    assert list(errors) == [
        "amplitude_tangential",
        "amplitude_normal",
        "peak_normal_force",
        "dissipated_per_period",
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
    assert errors["dissipated_per_period"] == pytest.approx(abs(more)) and abs(more) > 0.1
    assert set(measures.errors_percent(exact, exact).values()) == {0.0}
    assert measures.errors_percent(close, jenkins(normal=0.0))["amplitude_normal"] is None
    free = motion(exact.time, exact.displacement)
    assert measures.errors_percent(exact, free)["peak_normal_force"] is None
    assert measures.errors_percent(exact, free)["dissipated_per_period"] is None


def test_errors_in_three_dimensions_compare_the_tangential_amplitudes_as_a_vector():
    plane, space = jenkins(2), jenkins(3, phase=np.pi / 2)
    assert measures.errors_percent(plane, space)["amplitude_tangential"] == pytest.approx(
        100 * 0.5 / 1.25**0.5, rel=1e-3
    )


# figures


def texts(figure):
    return " | ".join(
        t.get_text()
        for axis in figure.axes
        for t in [
            axis.xaxis.label,
            axis.yaxis.label,
            axis.title,
            *(axis.get_xticklabels() + axis.get_yticklabels()),
        ]
    )


def illegible(figure):
    """The titles, labels and legends of a figure that are cut off, and the pairs of them that lie
    on one another."""
    from matplotlib.figure import FigureBase
    from matplotlib.legend import Legend

    figure.draw_without_rendering()
    whole = figure.bbox.padded(1.0)
    found = [
        text
        for axis in figure.axes
        for text in (axis.xaxis.label, axis.yaxis.label, axis.title, axis._left_title)
    ]
    found = [text for text in found if text.get_text()]
    found += figure.findobj(Legend) + [
        part._suptitle for part in figure.findobj(FigureBase) if part._suptitle
    ]
    boxes = [item.get_window_extent() for item in found]
    cut = [
        str(item)
        for item, box in zip(found, boxes, strict=True)
        if min(*box.min - whole.min, *whole.max - box.max) < 0.0
    ]
    pairs = itertools.combinations(zip(found, boxes, strict=True), 2)
    return cut + [
        f"{a} on {b}"
        for (a, one), (b, other) in pairs
        if one.padded(-1.0).overlaps(other.padded(-1.0))
    ]


def drawn(figure, tmp_path):
    """Draw a figure and return the picture."""
    from matplotlib.image import imread

    figure.savefig(tmp_path / "figure.png")
    assert not illegible(figure)
    picture = imread(tmp_path / "figure.png")
    assert picture.shape[1] > 900 and picture[..., :3].std() > 0.02
    return picture


def test_motion_is_drawn_over_its_last_two_periods_in_mm(tmp_path):
    cases = {"full": jenkins(), "reduced": jenkins(periods=6), "beam": jenkins()}
    figure = report.plot_motion(cases)
    assert len(figure.axes) == 2
    for axis, k in zip(figure.axes, range(2), strict=True):
        assert [line.get_label() for line in axis.lines] == list(cases)
        curves = [line.get_xydata() for line in axis.lines]
        for x, y in (curve.T for curve in curves):
            assert x[0] == pytest.approx(0) and x[-1] == pytest.approx(2)
            assert np.ptp(y) / 2 == pytest.approx([1.0, 8.0][k], rel=1e-3)
        np.testing.assert_allclose(
            curves[0], curves[1], atol=1e-9
        )  # phases agree though the runs differ in length
    assert "time / period" in texts(figure) and "mm" in texts(figure)
    drawn(figure, tmp_path)
    solid = report.plot_motion({"full": jenkins(3), "beam": jenkins(2)})
    assert len(solid.axes) == 3
    drawn(solid, tmp_path)


def test_contact_is_drawn_as_states_and_loops(tmp_path):
    cases = {"full": jenkins(normal=5e-3), "reduced": jenkins(normal=5e-3)}
    figure = report.plot_contact(cases)
    states, tangential, normal, orbit = figure.axes
    np.testing.assert_allclose(orbit.lines[0].get_xdata(), tangential.lines[0].get_xdata())
    np.testing.assert_allclose(orbit.lines[0].get_ydata(), normal.lines[0].get_xdata())
    case = cases["full"]
    part = case.last_period()
    np.testing.assert_allclose(
        tangential.lines[0].get_xydata(),
        np.stack([1e3 * case.displacement[part, 0, 1], case.force[part, 0, 1]], axis=1),
    )
    assert normal.lines[0].get_ydata().max() == pytest.approx(80, rel=1e-3)
    bars = [bar for bar in states.patches if bar.get_y() < 0.5]
    assert sum(bar.get_width() for bar in bars) == pytest.approx(1)
    ends = [bar.get_x() + bar.get_width() for bar in bars]
    np.testing.assert_allclose([bar.get_x() for bar in bars][1:], ends[:-1])
    share = {name: 0.0 for name in ("open", "slip", "stick")}
    names = {report.STATES[k][1].upper(): report.STATES[k][0] for k in report.STATES}
    from matplotlib.colors import to_hex

    for bar in bars:
        share[names[to_hex(bar.get_facecolor()).upper()]] += bar.get_width()
    assert share == pytest.approx(measures.contact_fractions(case), abs=1e-9)
    assert "N" in texts(figure) and "mm" in texts(figure)
    drawn(figure, tmp_path)


def test_contact_in_three_dimensions_has_a_loop_per_direction_and_an_orbit(tmp_path):
    figure = report.plot_contact({"full": jenkins(3, phase=1.0), "beam": jenkins(2)})
    assert len(figure.axes) == 5
    orbit = figure.axes[-1]
    assert orbit.get_title(loc="left") == "orbit" and len(orbit.lines) == 1
    assert np.ptp(orbit.lines[0].get_ydata()) == pytest.approx(8.0, rel=1e-3)
    drawn(figure, tmp_path)


@pytest.mark.parametrize("dimension", [2, 3])
def test_many_points_share_a_picture_with_the_loops_of_the_one_pressed_hardest(tmp_path, dimension):
    cases = [jenkins(dimension, normal=normal) for normal in (0.0, 1e-3, 5e-3, 2e-3, 1e-3, 0.0)]
    motions = {
        "reduced": side_by_side(*cases),
        "full": side_by_side(*cases),
        "beam": jenkins(dimension),
    }
    points = {name: measures.point_summaries(case) for name, case in motions.items()}
    figure = report.plot_points(motions, points)
    peak, share, friction_dissipation, *loops = figure.axes
    np.testing.assert_allclose(
        peak.lines[0].get_xydata(), np.transpose([range(1, 7), [30, 40, 80, 50, 40, 30]]), rtol=1e-3
    )
    np.testing.assert_allclose(
        share.lines[1].get_ydata()[[0, 2]], [100.0, 100 - 100 * np.arccos(0.6) / np.pi], rtol=5e-3
    )
    assert friction_dissipation.lines[0].get_ydata().sum() == pytest.approx(
        measures.dissipated_per_period(motions["reduced"])
    )
    assert [len(axis.lines) for axis in (peak, share, friction_dissipation)] == [3, 3, 3]
    hardest = cases[2]
    np.testing.assert_allclose(
        loops[0].lines[0].get_ydata(), hardest.force[hardest.last_period(), 0, 1]
    )
    assert len(loops) == dimension + 1 and loops[-1].get_title(loc="left") == "orbit"
    assert [len(axis.lines) for axis in loops] == [2] * len(loops)  # the beam has no third point
    drawn(figure, tmp_path)


def test_a_film_shows_each_picture_with_its_time():
    images = [np.full((100, 300, 3), shade, dtype=np.uint8) for shade in (0, 200, 200)]
    frames = report.film(images, [0.1, 0.2, 0.3], "displacements to scale", 0.02, True)
    assert len({frame.shape for frame in frames}) == 1 and frames[0].dtype == np.uint8
    assert frames[0].shape[1] == 720
    shades = zip(frames, (0, 200, 200), strict=True)
    dark, light, later = (np.count_nonzero((frame == shade).all(axis=2)) for frame, shade in shades)
    assert dark > 0.3 * 720 * 240 and light == later > 0.3 * 720 * 240
    changed = np.flatnonzero((frames[1] != frames[2]).any(axis=(1, 2)))
    assert changed.size and np.ptp(changed) < 30  # the line of the time, and nothing else


def test_modes_are_drawn_by_kind_with_a_line_a_label(tmp_path):
    x = np.linspace(0, 2.54, 61)
    s = x / x[-1]
    labels = ["1V", "2V", "1S", "1V1V", "1V1S", "2V1S"]
    shapes = np.array([[k * s**2, -3 * (1 + k) * s**k] for k in range(len(labels))]).transpose(
        0, 2, 1
    )
    figure = report.plot_modes(labels, x, shapes)
    axial, transverse = np.array(figure.axes).reshape(3, 2).T
    assert [[line.get_label() for line in axis.lines] for axis in axial] == [
        labels[:2],
        labels[2:3],
        labels[3:],
    ]
    assert [axis.get_ylabel().split("\n")[0] for axis in axial] == [
        "normal modes",
        "static modes",
        "derivatives",
    ]
    for axis in transverse:
        for line in axis.lines:
            assert np.abs(line.get_ydata()).max() == pytest.approx(1)
    assert axial[2].lines[0].get_ydata()[-1] == pytest.approx(3 / 12)
    drawn(figure, tmp_path)
    solid = report.plot_modes(labels, x, np.dstack([shapes, shapes[:, :, :1]]))
    assert len(solid.axes) == 9
    drawn(solid, tmp_path)


def test_a_mode_that_does_not_move_is_drawn_as_zero():
    figure = report.plot_modes(["1V"], np.linspace(0, 1, 5), np.zeros((1, 5, 2)))
    assert not figure.axes[0].lines[0].get_ydata().any()


def test_the_ledger_shows_every_account_and_the_imbalance(tmp_path):
    figure = report.ledger_plot(jenkins())
    above, below = figure.axes
    assert len(above.lines) == 4
    assert below.lines[0].get_ydata()[-1] == pytest.approx(-1e-3)
    drawn(figure, tmp_path)


def test_line_styles_keep_models_apart():
    styles = report.line_styles(["full", "reduced", "beam", *(f"{i}V" for i in range(16))])
    assert (
        len({(style["color"], str(style.get("linestyle", "-"))) for style in styles.values()}) == 19
    )
    assert styles["reduced"] == report.line_styles(["reduced"])["reduced"]


# tables, report


def test_the_terminal_table_is_aligned():
    rows = [
        ["model", "amplitude, mm", "steady"],
        ["full", 157.60321, True],
        ["reduced", 9, False],
        ["beam", None, True],
    ]
    lines = report.text_table(rows).split("\n")
    assert lines == [
        "model    amplitude, mm  steady",
        "───────  ─────────────  ──────",
        "full             157.6  yes",
        "reduced              9  no",
        "beam                 –  yes",
    ]


def test_the_report_is_one_well_formed_file(tmp_path):
    figure = report.plot_motion({"full": jenkins()})
    figure.savefig(tmp_path / "a.png")
    (tmp_path / "a.gif").write_bytes(b"GIF89a")
    page = report.html_report(
        "slip & lift-off",
        [
            ("Motion", ["a < b", figure, tmp_path / "a.png", tmp_path / "a.gif"]),
            ("Table", [[["model", "amplitude, mm"], ["full <1>", 157.6]]]),
        ],
    )
    assert (
        page.startswith("<!doctype html>")
        and "slip &amp; lift-off" in page
        and "<p>a &lt; b</p>" in page
    )
    assert (
        page.count("data:image/png;base64,iVBOR") == 2
        and page.count("data:image/gif;base64,R0lG") == 1
    )
    assert "<td>full &lt;1&gt;</td><td class=n>157.6</td>" in page
    assert (
        not re.search(r"(src|href)=(?!\"data:)", page)
        and "@import" not in page
        and "{{" not in page
    )
    body = page[page.index("<body>") : page.index("</html>")]
    ElementTree.fromstring(
        re.sub(r"class=(\w+)", r'class="\1"', re.sub(r"(<img [^>]*)>", r"\1/>", body))
    )


def test_the_summary_keeps_its_order_and_refuses_nan(tmp_path):
    path = tmp_path / "summary.json"
    report.write_summary(
        path,
        {"b": np.float64(1.5), "a": {"z": np.arange(2), "y": (np.bool_(True), None)}, "p": path},
    )
    assert list(json.loads(path.read_text())) == ["b", "a", "p"]
    assert json.loads(path.read_text())["a"] == {"z": [0, 1], "y": [True, None]}
    before = path.read_bytes()
    with pytest.raises(AccuracyError, match=r"response\.full\.tangential\[1\] is nan"):
        report.write_summary(path, {"response": {"full": {"tangential": [1.0, np.nan]}}})
    with pytest.raises(AccuracyError, match="x is inf"):
        report.write_summary(path, {"x": np.float32("inf")})
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["summary.json"]


# files


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit, ValueError, OSError])
def test_a_file_appears_whole_or_not_at_all(tmp_path, stop):
    path = tmp_path / "new" / "history.npz"
    with pytest.raises(stop), atomic_write(path) as temporary:
        temporary.write_text("half")
        assert temporary.suffix == ".npz" and temporary.parent == path.parent
        raise stop
    assert list(path.parent.iterdir()) == []
    with atomic_write(path) as temporary:
        np.savez(temporary, a=1)
        assert not path.exists()
    with pytest.raises(stop), atomic_write(path) as temporary:
        temporary.write_text("half")
        raise stop
    assert np.load(path)["a"] == 1 and list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit, ValueError, OSError])
def test_a_folder_appears_whole_or_not_at_all(tmp_path, stop):
    path = tmp_path / "motion"
    with pytest.raises(stop), atomic_folder(path) as temporary:
        (temporary / "a.vtu").write_text("half")
        raise stop
    assert list(tmp_path.iterdir()) == []
    with atomic_folder(path) as temporary:
        (temporary / "a.vtu").write_text("first")
        assert not path.exists()
    with pytest.raises(stop), atomic_folder(path) as temporary:
        (temporary / "a.vtu").write_text("half")
        raise stop
    assert (path / "a.vtu").read_text() == "first"
    with atomic_folder(path) as temporary:
        (temporary / "b.vtu").write_text("second")
    assert list(tmp_path.iterdir()) == [path] and [p.name for p in path.iterdir()] == ["b.vtu"]


def test_a_full_disk_leaves_no_file_and_is_named(tmp_path):
    """A limit on the size of files stands for the full disk."""
    path = tmp_path / "summary.json"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
        with pytest.raises(OSError, match=r"summary\.json"):
            report.write_summary(path, {"x": list(range(100_000))})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []


def test_the_older_folder_comes_back_if_the_swap_fails(tmp_path, monkeypatch):
    import os

    path = tmp_path / "motion"
    path.mkdir()
    (path / "old").write_text("old")
    rename, calls = os.rename, []

    def failing(a, b):
        calls.append((a, b))
        if len(calls) == 2:
            raise OSError(28, "No space left on device", str(a))
        rename(a, b)

    monkeypatch.setattr(os, "rename", failing)
    with pytest.raises(OSError, match="motion"), atomic_folder(path) as temporary:
        (temporary / "new").write_text("new")
    assert [p.name for p in tmp_path.iterdir()] == ["motion"] and (path / "old").exists()
    assert len(calls) == 3
