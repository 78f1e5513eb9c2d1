"""All pictures of the body in one report have the same projection."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, make_solid

pytest.importorskip("dolfinx")

from fenicsrom.post.body.body_view import View
from fenicsrom.post.run import pictures as body_pictures
from fenicsrom.records import Study

SMALL = ("geometry.parameters.length=1.0", "geometry.parameters.elements_along=2")
LOWER_SIDE = {"point": [0.0, -0.0127, 0.0], "normal": [0.0, 1.0, 0.0]}


def test_pictures_of_a_study_have_the_projection_of_its_setup(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The viewer sees the loaded lower side, also of the shapes and of the equilibrium."""
    seen: dict[str, View] = {}
    for name in ("setup_figure", "shape_figure", "deflection_figure"):
        monkeypatch.setattr(
            body_pictures, name, lambda *given, name=name: seen.update({name: given[-1]})
        )
    loads: list[Any] = [{"plane": LOWER_SIDE, "pressure": 1e3}]
    scene = beam_scene(3, SMALL, contacts=None, probe={"group": "tip"}, loads=loads)
    solid = make_solid(scene)
    study = Study(scene, solid=solid)
    study.modes = SimpleNamespace(labels=["1V"], frequencies_hz=np.ones(1))  # type: ignore[assignment]
    fields = {"normal_modes": {"1V": solid.field(solid.equilibrium)}}
    monkeypatch.setattr(body_pictures, "shapes", lambda _: fields)
    for picture in body_pictures.body_pictures(study):
        picture.draw()
    (body,) = study.body
    assert len(seen) == 3 and all(view is body.view for view in seen.values())
    assert body.view.towards[1] < 0.0


def test_view_says_how_many_shapes_it_leaves_out(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = beam_scene(3, SMALL, contacts=None, probe={"group": "tip"}, loads=[])
    solid = make_solid(scene)
    study = Study(scene, solid=solid)
    fields = {label: solid.field(solid.equilibrium) for label in ("1V", "2V", "3V")}
    monkeypatch.setattr(body_pictures, "shapes", lambda _: {"normal_modes": fields})
    for most, said in ((3, ""), (2, "2 of 3 shapes")):
        monkeypatch.setattr(body_pictures.turning, "MOST_SHAPES", most)
        found = body_pictures._turning(study)
        assert found is not None
        setup, *shapes = found[1]
        assert (
            len(shapes) == most
            and setup["note"].startswith(said)
            and bool(setup["note"]) == bool(said)
        )
