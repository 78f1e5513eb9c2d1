"""Models and runs that the program refuses before the offline stages."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import beam_scene, refusal, touching

from fenicsrom import study
from fenicsrom.errors import ErrorKind

PROJECTED = ("basis.elastic_force='projection'", "reference.beam=false")


@pytest.fixture(autouse=True)
def no_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail where a mesh is made."""
    from fenicsrom.fem.mesh import mesh

    monkeypatch.setattr(mesh, "build_mesh", lambda *_: pytest.fail("a mesh is made"))


def test_model_with_projected_force_is_not_built() -> None:
    with refusal(ErrorKind.CONFLICT, key="basis.elastic_force"):
        study.build_model(beam_scene(2, PROJECTED))


@pytest.mark.parametrize(("masters", "size"), [("'all'", 4), ("'normal'", 2), ("3", 3)])
def test_size_without_room_for_the_contact_is_refused_before_the_mesh_is_made(
    masters: str, size: int
) -> None:
    at_points = [touching(group=group, at="centre", normal=[1.0, 0.0]) for group in ("tip", "load")]
    overrides = (f"basis.masters={masters}", f"basis.size={size}")
    with refusal(ErrorKind.RANGE, key="basis.size"):
        study.build_model(beam_scene(2, overrides, contacts=at_points))


def test_missing_checkpoint_is_refused_before_the_mesh_is_made(tmp_path: Path) -> None:
    missing = tmp_path / "checkpoint.npz"
    with refusal(ErrorKind.FILE, file=missing.name):
        study.run(beam_scene(2), resume=missing)
    with refusal(ErrorKind.CONFLICT, key="basis.elastic_force"):
        study.run(beam_scene(2, PROJECTED), resume=missing)
