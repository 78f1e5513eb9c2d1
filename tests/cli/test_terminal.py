"""What a command prints of the user's texts and on which rank; arguments that no file can have."""

from __future__ import annotations

from pathlib import Path

import pytest

from fenicsrom.cli import main
from fenicsrom.cli.printing import print_results
from fenicsrom.scene import read_scene

DEMO = str(Path(__file__).parents[2] / "demos" / "open_2d.toml")


def test_control_characters_of_texts_do_not_reach_the_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    scene = read_scene(DEMO, r'title="red \u001b[31m\u0007"')
    print_results(scene, "a\nb", ["w \x1b"], ["s \x1b"], [Path("f\x1b")])
    said = capsys.readouterr().out
    assert r"red \x1b[31m\x07" in said and "\x1b" not in said and "a\nb" in said
    assert said.count(r"\x1b") == 4


@pytest.mark.parametrize("command", ["run", "response", "backbone"])
def test_stored_model_runs_on_the_first_rank_only(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    for rank, code in (("0", 2), ("1", 0)):
        monkeypatch.setenv("OMPI_COMM_WORLD_RANK", rank)
        assert main([command, "--from", "no_such_model.npz"]) == code
        assert bool(capsys.readouterr().err) is (rank == "0")
