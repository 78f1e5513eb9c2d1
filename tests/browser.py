"""A headless Chromium for the tests of pages."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

FLAGS = (
    "--headless=new --no-sandbox --disable-dev-shm-usage --use-gl=angle --use-angle=swiftshader "
    "--enable-unsafe-swiftshader --ignore-gpu-blocklist --window-size=1000,900"
)


@pytest.fixture
def browser() -> Iterator[Any]:
    """A headless Chromium that draws by software."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    driver = shutil.which("chromedriver")
    if driver is None:
        pytest.skip("chromedriver is not installed")
    options = webdriver.ChromeOptions()
    for flag in FLAGS.split():
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    started = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield started
    started.quit()


def picture(browser: Any) -> Any:
    """What the browser shows, (height, width, 3)."""
    from PIL import Image

    with Image.open(io.BytesIO(browser.get_screenshot_as_png())) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def changed(one: Any, other: Any) -> int:
    """The number of pixels that differ."""
    return int(np.sum(np.abs(one - other).max(axis=2) > 40))


def severe(browser: Any) -> list[Any]:
    """The errors in the console."""
    return [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


def choose_shape(browser: Any, wait: Any, number: int) -> Any:
    """Choose a shape in the frame of the body, which stands still then; give the picture."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import Select

    wait.until(lambda found: found.find_elements(By.ID, "shape"))
    play = browser.find_element(By.ID, "play")
    if play.is_selected():
        play.click()
        wait.until(lambda found: np.std(picture(found)[300:, :, 0]) > 5.0)
    before = picture(browser)
    shapes = Select(browser.find_element(By.ID, "shape"))
    if shapes.first_selected_option != shapes.options[number]:
        shapes.select_by_index(number)
        wait.until(lambda found: changed(before, picture(found)) > 1000)
    return picture(browser)


def turn(browser: Any, wait: Any, before: Any) -> Any:
    """Turn the body in its frame with the mouse; give the picture."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By

    canvas = browser.find_element(By.ID, "canvasTarget")
    drag = ActionChains(browser).move_to_element_with_offset(canvas, 100, 100).click_and_hold()
    drag.move_by_offset(120, 80).release().perform()
    wait.until(lambda found: changed(before, picture(found)) > 1000)
    return picture(browser)
