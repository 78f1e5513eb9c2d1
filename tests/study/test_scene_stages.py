"""The plan of a scene: what it says is needed, and what is done."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest
from support import heard

from fenicsrom import study
from fenicsrom.scene import read_scene

DEMOS = Path(__file__).parents[2] / "demos"
SCENE = DEMOS / "slip_liftoff_2d.toml"

LINEAR = ["geometrically_nonlinear=false"]
NO_CONTACT = ["contacts=[]", "probe={group='tip'}"]


def test_plan_says_how_accurate_the_basis_becomes() -> None:
    scene = read_scene(SCENE, ["basis.derivatives='principal'", "basis.accuracy=0.02"])
    (size,) = [item for item in study.plan(scene) if item.name == "size"]
    assert size.needed and "0.02" in size.reason
    (size,) = [item for item in study.plan(read_scene(SCENE)) if item.name == "size"]
    assert not size.needed  # the scene names a selection of the paper


# Function that does the work of a stage -> name of the stage.
WORK = {
    "fenicsrom.fem.mesh.mesh.build_mesh": "mesh",
    "fenicsrom.fem.solid.solid.Solid": "solid",
    "fenicsrom.reduction.modes.component_modes": "modes",
    "fenicsrom.reduction.modes.contact_frequencies": "contact frequencies",
    "fenicsrom.reduction.snapshots.linear_snapshots": "linear transient",
    "fenicsrom.reduction.snapshots.static_snapshots": "nonlinear statics",
    "fenicsrom.reduction.stages.choose": "selection",
    "fenicsrom.reduction.stages.differentiate": "derivatives",
    "fenicsrom.reduction.stages.enrich": "basis",
    "fenicsrom.reduction.candidates.extended_basis": "candidates",
    "fenicsrom.reduction.basis.project": "reduction",
    "fenicsrom.fem.solid.finer.FinerSolid": "finer elements",
    "fenicsrom.assess.errors.judge.judge_with_residual": "residual",
    "fenicsrom.assess.errors.sizing.fitted": "size",
    "fenicsrom.fem.solid.reaction_rows.reaction_table": "stress points",
    "fenicsrom.assess.errors.comparisons.mode_agreement": "mode comparison",
    "fenicsrom.study.motions.integrate": "motion",
    "fenicsrom.study.motions.check": "checks",
    "fenicsrom.study.motions.check_beam": "beam check",
    "fenicsrom.online.stress.reactions.find_stresses": "stresses",
    "fenicsrom.post.run.summary.write_numbers": "numbers",
    "fenicsrom.post.paraview.paraview.write_shapes": "ParaView modes",
    "fenicsrom.post.paraview.paraview.write_last_period": "ParaView motion",
    "fenicsrom.post.paraview.paraview.write_groups": "ParaView scene",
    "fenicsrom.post.run.pictures.write_pictures": "pictures",
    "fenicsrom.post.run.pictures.write_stress_picture": "stress picture",
    "fenicsrom.post.run.pictures.write_animation": "animation",
    "fenicsrom.post.run.report.write_run_report": "report",
}
SHORT = ["time.periods=2", "output.pictures=false"]
STATIC = ["time={}", *NO_CONTACT, "reference.beam=false"]


@pytest.mark.parametrize(
    ("overrides", "modes_only"),
    [
        pytest.param(["time.periods=2", "output.motion=true"], False, marks=pytest.mark.slow),
        ([*SHORT, *LINEAR, *NO_CONTACT, "reference={full=true, beam=false}"], False),
        ([*SHORT, *LINEAR, *NO_CONTACT, "reference.beam=false", "output.stresses='cauchy'"], False),
        (["output.pictures=false", "output.stresses='cauchy'"], True),
        ([*SHORT, "basis.derivatives=['1V1V']", "reference.beam=false"], False),
        ([*SHORT, "basis.derivatives='mmi-nls'", "output.motion=true"], False),
        ([*SHORT, "basis.derivatives='mmi'", "output.paraview=false"], False),
        (["output.pictures=false"], True),
        ([*STATIC, "loads=[{group='tip', direction=[0.0, 1.0], force=1.0}]"], False),
        ([*STATIC, "loads=[{group='tip', direction=[0.0, 1.0], force=0.0}]"], False),
        ([*SHORT, *NO_CONTACT, "basis.derivatives=[]", "reference.beam=false"], False),
    ],
)
@pytest.mark.slow
def test_executed_stages_are_the_planned_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, overrides: list[str], modes_only: bool
) -> None:
    """The plan, the announced stages and the stages that do work are the same list."""
    worked: list[str] = []
    announced: list[str] = []

    def recorded(function: Any, name: str) -> Any:
        def record(*args: Any, **kwargs: Any) -> Any:
            stage = f"{args[1]} motion" if name == "motion" else name
            if announced[-1] == stage:
                worked.append(stage)
            else:  # more modes and derivatives of the same solid, and modes of the finer one
                where = announced[-1]
                assert where in ("candidates", "finer elements"), f"{stage} runs inside {where}"
            return function(*args, **kwargs)

        return record

    # a module that is first imported below would keep the recording functions for the next tests
    importlib.import_module("fenicsrom.assess.errors.estimates")
    importlib.import_module("fenicsrom.reduction.candidates")
    places = {path: importlib.import_module(path.rpartition(".")[0]) for path in WORK}
    for path, name in WORK.items():
        place, function = places[path], path.rpartition(".")[2]
        monkeypatch.setattr(place, function, recorded(getattr(place, function), name))

    def say(line: str) -> None:
        if line.endswith(" .."):
            announced.append(line.removesuffix(" .."))

    scene = read_scene(SCENE, ["basis.modes=1", "reference.full=false", *overrides])
    planned = [
        item.name
        for item in study.plan(scene, modes_only)
        if isinstance(item, study.Stage) and item.needed
    ]
    with heard(say):
        study.run(scene, folder=tmp_path, modes_only=modes_only)
    assert announced == planned
    assert worked == planned
