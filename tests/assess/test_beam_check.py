"""The beam that stands for a solid is refused where it is another structure."""

from __future__ import annotations

from typing import Any

import pytest
from support import beam_scene, make_solid, refusal

pytest.importorskip("dolfinx")

from fenicsrom.assess.errors.comparisons import check_beam
from fenicsrom.errors import ErrorKind
from fenicsrom.scene import Scene

SECTION = {"length": 2.54, "height": 0.0254, "width": 0.0254, "elements": 20, "load_at": 0.7}


def scene_with(*overrides: str, **section: float) -> Scene:
    return beam_scene(2, overrides, reference={"beam": True, "beam_section": SECTION | section})


def test_beam_of_the_paper_stands_for_its_solid(beam2d: Any) -> None:
    check_beam(beam2d, scene_with())


@pytest.mark.parametrize(
    ("section", "name"),
    [
        ({"length": 2.0}, "frequency"),
        ({"height": 0.03}, "frequency"),
        ({"width": 0.03}, "flexibility"),
        ({"load_at": 0.5}, "flexibility"),
    ],
)
def test_beam_of_another_section_is_refused(
    beam2d: Any, section: dict[str, float], name: str
) -> None:
    with refusal(ErrorKind.MISMATCH, "reference.beam_section", names=name):
        check_beam(beam2d, scene_with(**section))


def test_beam_of_another_observed_place_is_refused() -> None:
    scene = beam_scene(
        2, contacts=None, probe={"group": "load"}, reference={"beam": True, "beam_section": SECTION}
    )
    with refusal(ErrorKind.MISMATCH, "reference.beam_section", names="observed place"):
        check_beam(make_solid(scene), scene)
