"""The examples in the docstrings of the public interface are executed."""

from __future__ import annotations

import doctest
from pathlib import Path

import pytest

import fenicsrom
from fenicsrom.cli import main

ROOT = Path(fenicsrom.__file__).parents[1]
LEAST = 10  # docstrings with examples


@pytest.fixture
def folder_of_examples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with the demos, the model `out/beam.npz` and its run `out/beam`."""
    for name in ("demos", "meshes"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    scene = "demos/superelement/rub.toml"
    model = ["--output", "out/beam.npz"]
    assert main(["import", "demos/superelement/beam.op4", "--scene", scene, *model]) == 0
    run = ["run", "--from", "out/beam.npz", "--output", "out/beam"]
    assert main([*run, "--set", "output.pictures=false"]) == 0


def test_examples_of_public_docstrings_give_what_they_print(
    folder_of_examples: None, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("dolfinx")
    finder = doctest.DocTestFinder(exclude_empty=True)
    found = {
        test.name: test
        for name in fenicsrom.__all__
        for test in finder.find(getattr(fenicsrom, name), name, module=False)
        if test.examples
    }
    capsys.readouterr()
    runner = doctest.DocTestRunner(verbose=False)
    failed = [name for name, test in found.items() if runner.run(test).failed]
    assert not failed, capsys.readouterr().out
    assert len(found) >= LEAST
