"""Random variants of a scene: reproducible, and scenes that can be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import beam_scene, refusal

from fenicsrom.assess.studies import stability
from fenicsrom.assess.studies.axes import Scales
from fenicsrom.assess.studies.random_cases import KINDS, MOST_MODES, random_cases
from fenicsrom.cli.commands import make_parser
from fenicsrom.errors import ErrorKind
from fenicsrom.scene import Scene, override_table, parse_scene, scene_table

SCENE = Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"
SCALES = Scales((1e6,), (1e4,), None, 20.0)


def made(scene: Scene, count: int, seed: int) -> list[Scene]:
    """The scenes of random variants."""
    table = scene_table(scene)
    return [
        parse_scene(override_table(table, case.overrides, "random"), "random", None)
        for case in random_cases(scene, SCALES, count, seed)
    ]


def test_variants_follow_from_the_seed_and_the_number() -> None:
    scene = beam_scene(2)
    few, many, others = (
        random_cases(scene, SCALES, count, seed) for count, seed in ((3, 5), (6, 5), (6, 6))
    )
    assert few == many[:3]
    assert not {case.overrides for case in many} & {case.overrides for case in others}
    assert all(case.full and case.model == "reduced" for case in many)


@pytest.mark.parametrize("dimension", [2, 3])
def test_variants_are_scenes_of_every_kind(dimension: int) -> None:
    scenes = made(beam_scene(dimension), 80, 1)
    loads = [scene.loads[0] for scene in scenes]
    found = {kind: 0 for kind in KINDS}
    for case in random_cases(beam_scene(dimension), SCALES, 80, 1):
        found[case.value.rsplit(" ", 1)[1]] += 1
    assert min(found.values()) > 3 and found["periodic"] > 25
    assert any(not scene.contacts for scene in scenes) and any(scene.contacts for scene in scenes)
    assert {scene.basis.modes for scene in scenes} == set(range(1, MOST_MODES + 1))
    assert {scene.geometrically_nonlinear for scene in scenes} == {False, True}
    directions = np.array([load.direction for load in loads])
    assert np.any(np.abs(directions[:, 0]) > 0.99) and np.median(np.abs(directions[:, 0])) < 0.5


def test_open_scene_has_variants() -> None:
    scene = beam_scene(2, contacts=None, probe={"group": "tip"})
    assert all(not found.contacts and found.probe == scene.probe for found in made(scene, 5, 1))


def test_random_variants_on_an_axis_are_refused() -> None:
    with refusal(ErrorKind.CONFLICT, file="--random 2"):
        stability.stability(SCENE, (), ["load"], variants=2)
    with pytest.raises(SystemExit):
        make_parser().parse_args(["stability", str(SCENE), "--random", "-1"])


@pytest.mark.slow
def test_random_variant_is_compared_with_the_full_model() -> None:
    pytest.importorskip("dolfinx")
    changes = ["time.steps_per_period=40", "geometry.parameters.elements_along=6", "reference={}"]
    matrix = stability.stability(SCENE, changes, workers=1, variants=2, seed=1)
    assert len(matrix.findings) == 2 and not matrix.count(stability.Verdict.WRONG)
    for finding in matrix.findings:
        assert finding.basis_error is not None and finding.basis_estimate is not None
        assert finding.basis_error < 0.01
