"""The comparison with CalculiX: the script, with a program in place of CalculiX and with itself."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import calculix
import pytest
from support import beam_scene

pytest.importorskip("dolfinx")

SIZES = tuple(
    f"geometry.parameters.{size}" for size in ("length=0.5", "elements_along=4", "load_at=0.5")
)
OUTPUT = """
 displacements (vx,vy,vz) for set PROBE and time  0.1000000E+01

         7  1.000000E-03 -2.000000E-03  3.000000E-03

     E I G E N V A L U E   O U T P U T

 MODE NO    EIGENVALUE                       FREQUENCY
                                     REAL PART            IMAGINARY PART

{rows}

     P A R T I C I P A T I O N   F A C T O R S

MODE NO.   X-COMPONENT     Y-COMPONENT

      1   0.2200000E-00   0.9999999E+00   0.1000000E+01   0.1000000E+01   0.1000000E+01
"""


def one_case(folder: Path) -> Iterator[tuple[str, str, Any]]:
    """A beam that turns, under a static load."""
    scene = beam_scene(
        3,
        ("geometry.cells='simplex'", *SIZES),
        contacts=None,
        loads=[{"group": "load", "direction": [0.0, 1.0, 0.0], "force": 3000.0}],
        rotation={"speed_rpm": 2000.0, "axis": [0.0, 1.0, 0.0]},
        probe={"nearest": [0.5, 0.0, 0.0]},
    )
    yield "beam", "a beam", scene


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The command on this beam, with a program instead of ccx."""
    monkeypatch.setattr(calculix, "cases", one_case)
    monkeypatch.setattr(sys, "argv", ["calculix.py", "--output", str(tmp_path / "out")])

    def called(program: str | None) -> int:
        monkeypatch.setattr(calculix.shutil, "which", lambda name: program)
        return calculix.main()

    return called


def stand_in(tmp_path: Path, output: str) -> str:
    """A program that writes this output, as CalculiX does."""
    program = tmp_path / "ccx"
    (tmp_path / "output").write_text(output)
    program.write_text(
        f'#!/bin/sh\n[ "$1" = -v ] && echo "This is Version 0.0" && exit\n'
        f'cp "{tmp_path / "output"}" "$1.dat"; echo Job finished\n'
    )
    program.chmod(0o755)
    return str(program)


def test_script_without_calculix_writes_decks_and_says_so(
    call: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(None) == 2
    assert "ccx is not installed" in capsys.readouterr().err.splitlines()[-1]
    assert (tmp_path / "out" / "beam.inp").is_file()


def test_script_compares_the_numbers_of_calculix(
    call: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "\n".join(f"  {k}  0.1E+1  0.2E+1  {10.0 * k}  0.0E+0" for k in range(1, 7))
    assert call(stand_in(tmp_path, OUTPUT.format(rows=rows))) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("CalculiX 0.0")
    values = [line.split(" | ")[2:4] for line in lines[4:]]
    assert [float(value) for _, value in values] == [10, 20, 30, 40, 50, 60, 1, -2, 3]
    assert (tmp_path / "out" / "comparison.md").read_text().splitlines() == lines
    assert call(stand_in(tmp_path, "nothing")) == 1
    assert "did not finish" in capsys.readouterr().err


def test_motions_are_compared_by_their_root_mean_square_difference(tmp_path: Path) -> None:
    ours = {"seconds": 0.5, "displacement": [[3.0, 0.0, 0.0], [0.0, 4.03, 0.04]]}
    case = {"what": "a beam", "mesh": "4 C3D10", "ours": {}, "motions": {"full model": ours}}
    content = {"version": "1", "cases": {"beam": case}}
    (tmp_path / calculix.NUMBERS).write_text(json.dumps(content))
    moved = "\n".join(f" 7 {x} {y} 0.0E+0" for x, y in ((3.0, 0.0), (0.0, 4.0)))
    output = f"{OUTPUT.format(rows='')}\n{moved}\n"
    program = stand_in(tmp_path, output)
    row = calculix.compare(program, tmp_path)[-1].split(" | ")
    assert row[2] == "motion of the probe (rms) and seconds, full model"
    assert row[4:6] == ["0.5 s", "1.0e-02"]  # of (0.03, 0.04) to (3, 4)
    (tmp_path / "output").write_text(OUTPUT.format(rows=""))
    with pytest.raises(RuntimeError, match="2 steps, and one of 0"):
        calculix.compare(program, tmp_path)


@pytest.mark.skipif(
    shutil.which("ccx") is None,
    reason="calculix-ccx is not installed; the header of tests/evidence/calculix.py says how to "
    "compare with it on another computer",
)
def test_turning_beam_is_that_of_calculix(
    call: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(shutil.which("ccx")) == 0
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines()[4:]]
    assert len(rows) == 9
    for row in rows[:8]:  # the last one, z of the probe, comes from the mesh alone
        assert abs(float(row[5])) < 1e-2, row[2]  # four cells along the beam
        assert abs(float(row[7].rstrip(" |"))) < 1e-6, row[2]
