"""The page on which a body turns: its data, and what a browser shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import browser, changed, picture
from test_body_surface import beam_surface

pytest.importorskip("pyvista")
pytest.importorskip("k3d")

from fenicsrom.cli import main
from fenicsrom.post.body.body_view import view_of
from fenicsrom.post.body.group_drawing import group_page
from fenicsrom.post.body.turning_view import (
    MOST_TRIANGLES,
    UNPAINTED,
    Shown,
    loaded,
    running,
    simplified,
    swinging,
    turning_plot,
)

LENGTH = 2.0
__all__ = ["browser"]


def bent(surface: Any, size: float) -> Any:
    moved = np.zeros((surface.n_points, 3))
    moved[:, 1] = size * (surface.points[:, 0] / LENGTH) ** 2
    return moved


def test_shapes_swing_to_both_sides_and_loads_start_at_rest() -> None:
    surface = beam_surface("hexahedron", LENGTH)
    shape = swinging("1V", bent(surface, 7.0), LENGTH)
    assert np.abs(shape.moved).max() == pytest.approx(0.15 * LENGTH)
    np.testing.assert_allclose(shape.moved[0], -shape.moved[1])
    state = loaded("equilibrium", bent(surface, 1e-4 * LENGTH), LENGTH)
    assert np.abs(state.moved[0]).max() == pytest.approx(0.1 * LENGTH) and "× 1000" in state.note
    assert not np.any(state.moved[1]) and "0.2 mm" in state.note
    rest, moved = bent(surface, 0.05), np.array([bent(surface, 0.1), bent(surface, -0.1)])
    motion = running("motion", rest, moved, LENGTH)
    np.testing.assert_allclose(motion.moved, rest + moved)
    assert motion.loops and motion.colours.max() == pytest.approx(1.0)


def test_fine_surface_has_fewer_triangles_and_keeps_its_fields() -> None:
    surface = beam_surface("hexahedron", LENGTH, along=600)
    surface.point_data["x"] = surface.points[:, 0]
    coarse = simplified(surface)
    assert surface.n_cells > 1.5 * MOST_TRIANGLES > coarse.n_cells
    np.testing.assert_allclose(coarse["x"], coarse.points[:, 0], atol=1e-9)
    assert np.ptp(coarse.points[:, 0]) == pytest.approx(LENGTH)


def test_first_view_shows_all_of_a_tall_body() -> None:
    surface = beam_surface("hexahedron", LENGTH)
    surface.points = surface.points[:, [1, 2, 0]]
    view, still = view_of(surface), np.zeros((1, surface.n_points, 3))
    setup = Shown("set-up", "", still, np.full(surface.n_points, UNPAINTED))
    plot, _ = turning_plot(surface, [setup], [], view)
    seen = surface.points - plot.camera[:3]
    slope = seen @ view.up / -(seen @ view.towards)
    assert np.abs(slope).max() < np.tan(np.radians(0.5 * plot.camera_fov)) < 1.5 * np.ptp(slope)


@pytest.mark.slow
def test_page_of_groups_names_the_face_under_the_pointer(tmp_path: Path, browser: Any) -> None:
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    surface = beam_surface("hexahedron", LENGTH)
    faces = surface.regular_faces.astype(int)
    near = (surface.points[faces, 0] < 0.5 * LENGTH + 1e-9).all(axis=1)
    groups = {"7": faces[near], "8": faces[~near], "held": np.unique(faces[near])}
    page = tmp_path / "mesh.html"
    page.write_text(group_page(surface.points, faces, groups))
    browser.get(page.as_uri())
    wait = WebDriverWait(browser, 60)
    wait.until(lambda found: np.std(picture(found)[:, :, 0]) > 5.0)
    seen = picture(browser)
    body = np.argwhere(np.ptp(seen[:600], axis=2) > 40)  # above the axes x, y, z
    ends = body[body[:, 1].argmin()], body[body[:, 1].argmax()]
    middle = body.mean(axis=0)
    canvas = browser.find_element(By.ID, "canvasTarget")
    centre = np.array([canvas.size["height"], canvas.size["width"]]) / 2.0

    def name_at(place: Any) -> str:
        down, right = (place - centre).astype(int).tolist()
        ActionChains(browser).move_to_element_with_offset(canvas, right, down).perform()
        return str(browser.find_element(By.ID, "name").text)

    names = {name_at(0.8 * end + 0.2 * middle) for end in ends}
    assert names == {"held, 7", "8"} or names == {"7, held", "8"}
    assert name_at(np.array([3.0, 3.0])) == ""
    drag = ActionChains(browser).move_to_element_with_offset(canvas, 100, 100).click_and_hold()
    drag.move_by_offset(120, 80).release().perform()
    wait.until(lambda found: changed(seen, picture(found)) > 1000)  # the body turns


def test_view_opens_the_report_or_names_its_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "report.html"
    report.touch()
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address: bool(opened.append(address)))
    assert main(["view", str(report.parent)]) == 0
    assert opened == [f"{report.as_uri()}#body"] and capsys.readouterr().out.split() == opened
    assert main(["view", str(report.parent / "nothing")]) == 2
    assert "report.html" in capsys.readouterr().err
