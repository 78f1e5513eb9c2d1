"""The reports of all commands in a headless browser: small variants of the gallery."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import browser, changed, choose_shape, picture, severe, turn

pytest.importorskip("dolfinx")
pytest.importorskip("pyvista")
pytest.importorskip("k3d")

from fenicsrom.cli import main

DEMOS = Path(__file__).parents[2] / "demos"
PAGES: dict[str, tuple[str, ...]] = {
    "run_2d": ("run", "slip_liftoff_2d.toml", "time.periods=6"),
    "run_blade": tuple(
        """
        run blade_rub.toml time.periods=1 geometry.parameters.elements_along=4
        geometry.parameters.elements_across=3 basis.accuracy=1.0
    """.split()
    ),
    "modes": ("modes", "blade_modes.toml", "geometry.parameters.elements_along=6"),
    "statics": ("statics", "arch_snap.toml"),
    "campbell": ("campbell", "blade_campbell.toml", "campbell.speeds_rpm=[0,3000]"),
    "response": ("response", "response_2d.toml", "response.points=12"),
    "backbone": ("backbone", "backbone_2d.toml", "backbone.last=2e-3"),
    "sweep": ("sweep", "open_2d.toml", "--over", "loads.0.force=[10,20]", "time.periods=6"),
}
"""Name of a page -> command, scene and overrides."""

TITLES = """
const models = Bokeh.documents.flatMap((one) => [...one._all_models.values()]);
const tap = models.find((model) => model instanceof Bokeh.TapTool);
if (arguments[0]) tap.renderers[0].data_source.selected.indices = [1];
return models.map((model) => model.title ? model.title.text : "").join();
"""
"""The titles of all plots; it may select the second ringed point, as a click does."""

__all__ = ["browser"]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The reports, made on first use by `made`."""
    return {"": tmp_path_factory.mktemp("gallery")}


def made(pages: dict[str, Path], name: str) -> Path:
    """The report of this name."""
    if name not in pages:
        folder = pages[""] / name
        if name == "comparison":
            outputs = [str(made(pages, one).parent) for one in ("run_2d", "response", "backbone")]
            words = ["report", *outputs, "--output", str(folder)]
        else:
            command, scene, *rest = PAGES[name]
            words = [command, str(DEMOS / scene), "--output", str(folder)]
            for word in rest:
                words += [word] if word.startswith("--") else []
                if "=" in word:
                    words += [word] if words[-1] == "--over" else ["--set", word]
        assert main(words) in (0, 1), name  # 1: some checks fail in so short a computation
        pages[name] = folder / "report.html"
    return pages[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PAGES, "comparison"])
def test_report_has_no_error_in_a_browser_and_its_body_turns(
    name: str, pages: dict[str, Path], browser: Any
) -> None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    browser.get(made(pages, name).as_uri())
    wait = WebDriverWait(browser, 120)
    charts = browser.find_elements(By.CSS_SELECTOR, "[id^=chart-]")
    wait.until(lambda found: not [c for c in charts if c.find_elements(By.TAG_NAME, "img")])
    frames = browser.find_elements(By.ID, "body")
    assert charts or frames
    assert bool(frames) == (name in ("run_2d", "run_blade", "modes"))
    folder = os.environ.get("FENICSROM_SCREENSHOTS")  # to look at them
    if folder:
        browser.save_screenshot(f"{folder}/{name}.png")
    if frames:
        browser.execute_script("arguments[0].scrollIntoView()", frames[0])
        browser.switch_to.frame(frames[0])
        shown = [choose_shape(browser, wait, k) for k in (0, 1)]
        assert changed(*shown) > 1000
        assert changed(shown[1], turn(browser, wait, shown[1])) > 1000
        if folder:
            browser.save_screenshot(f"{folder}/{name}_turned.png")
        browser.switch_to.default_content()
    if name == "response":
        before = browser.execute_script(TITLES, False)
        assert before.count("The motion at") == 1
        browser.execute_script(TITLES, True)
        wait.until(lambda found: found.execute_script(TITLES, False) != before)
    loaded = browser.execute_script("return performance.getEntriesByType('resource')")
    assert not [entry["name"] for entry in loaded if entry["name"].startswith("http")]
    wide = "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert picture(browser).size and not severe(browser) and not browser.execute_script(wide)


@pytest.mark.slow
def test_page_of_inspected_mesh_has_no_error_in_a_browser_and_turns(
    tmp_path: Path, browser: Any
) -> None:
    from selenium.webdriver.support.ui import WebDriverWait

    assert main(["inspect", str(DEMOS.parent / "meshes/blade.geo"), "--output", str(tmp_path)]) == 0
    browser.get((tmp_path / "mesh.html").as_uri())
    wait = WebDriverWait(browser, 60)
    wait.until(lambda found: np.std(picture(found)[:, :, 0]) > 5.0)
    before = picture(browser)
    assert changed(before, turn(browser, wait, before)) > 1000
    if folder := os.environ.get("FENICSROM_SCREENSHOTS"):
        browser.save_screenshot(f"{folder}/inspect.png")
    assert not severe(browser)
