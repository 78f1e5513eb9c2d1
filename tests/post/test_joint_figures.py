"""What is told of contacts between bodies."""

from pathlib import Path

import motions
import numpy as np
import pytest
from test_figures import drawn, texts

from fenicsrom.online.contact.points import points_on
from fenicsrom.online.motion.joints import Joint, contact_maps, joints_of
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.run.joint_figures import (
    joint_rows,
    joint_table,
    plot_joint_force,
    plot_joint_map,
)
from fenicsrom.scene import make_scene

pytestmark = pytest.mark.slow

AREA = 2e-4


def joint(d: int) -> tuple[Motion, Joint]:
    """Four points of 2 cm² along x; the first two slip for half of the motion."""
    places = np.zeros((4, d))
    places[:, 0] = [0.1, 0.2, 0.3, 0.4]
    frame = np.eye(d)
    frame[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]  # the normal points down, the first tangent along x
    points = points_on(0, np.full(4, AREA), places, np.tile(frame, (4, 1, 1)))
    time = np.linspace(0.0, 1.0, 101)
    force = np.zeros((time.size, 4, d))
    force[:, :, 0], force[:, :, 1] = [10.0, 20.0, 30.0, 40.0], time[:, None]
    state = np.ones((time.size, 4), dtype=np.int8)
    state[time > 0.5, :2] = 0
    spent = np.zeros((time.size, 4))
    spent[:, :2] = time[:, None] * [1e-3, 3e-3]
    given = time, 0.0 * force, force, state, spent.sum(axis=1), None, spent
    motion = motions.motion(*given)
    contact = {"group": "a", "against": "b", "friction": 0.3}
    contact |= {"normal_stiffness": 1e12, "tangential_stiffness": 1e12}
    scene = make_scene(
        geometry={"mesh": "lap2d.geo", "dimension": d} | ({"thickness": 0.02} if d == 2 else {}),
        material={"young": 1.0, "poisson": 0.3, "density": 1.0},
        supports=[{"group": "root"}],
        contacts=[contact],
        loads=[{"group": "a", "pressure": 1.0}],
        time={"duration": 1.0, "step": 0.1},
    )
    rest = np.zeros(4 * d)
    rest[::d] = [1e-6, 2e-6, -1e-6, 0.0]
    maps = contact_maps(motion, points)
    np.testing.assert_allclose(maps["friction_J_per_m2"], [5.0, 15.0, 0.0, 0.0])
    return motion, joints_of(motion, scene, points, rest)[0]


@pytest.mark.parametrize("d", [2, 3])
def test_force_and_moment_of_a_joint_are_those_of_its_points(d: int) -> None:
    motion, found = joint(d)
    np.testing.assert_allclose(found.pressure, [1e6, 2e6, 0.0, 0.0])
    np.testing.assert_allclose(found.shares["slip"], [0.5, 0.5, 0.0, 0.0], atol=0.01)
    last = {name: column[-1] for name, column in found.columns.items()}
    assert last["force_y_N"] == pytest.approx(100.0)  # the lower side presses upwards
    assert last["force_x_N"] == pytest.approx(-4.0)
    by_hand = -0.15 * 10.0 - 0.05 * 20.0 + 0.05 * 30.0 + 0.15 * 40.0
    assert last["moment_z_Nm"] == pytest.approx(by_hand)
    row = joint_rows([found], motion.time)[-1]
    assert row["contact_1_friction_dissipation_J"] == pytest.approx(4e-3)
    table = joint_table([found])[0]
    assert table["friction_dissipation_per_period_J"] == pytest.approx(4e-3)
    assert table["largest"]["force_y_N"] == pytest.approx(100.0)


@pytest.mark.parametrize("d", [2, 3])
def test_pictures_of_a_joint_name_what_they_show(d: int, tmp_path: Path) -> None:
    motion, found = joint(d)
    maps, forces = map(
        figure_of,
        (plot_joint_map(found), plot_joint_force({"reduced": found}, {"reduced": motion})),
    )
    words = texts(maps)
    assert all(word in words for word in ("pressure at rest, MPa", "friction, J/m²", "x, mm"))
    words = texts(forces)
    assert all(word in words for word in ("force y, N", "moment z, N m", "time, s"))
    drawn(maps, tmp_path)
    drawn(forces, tmp_path)
