"""Files with random damage are read or refused in one sentence."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import test_abaqus_files as abaqus
import test_ansys_files as ansys
import test_nastran_files as nastran

from fenicsrom.errors import SceneError
from fenicsrom.formats import read

SYSTEMS = nastran.CYLINDER + nastran.SPHERE + nastran.SHIFTED + nastran.BY_GRIDS
FILES = {
    ".inp": abaqus.PARTS + "*SURFACE, NAME=s\nBeam-1.Body, S3\n",
    ".bdf": f"BEGIN BULK\n{SYSTEMS}{nastran.GRIDS}{nastran.HEXA}"
    + nastran.small("SPC1", 5, 123, 1, "THRU", 4)
    + nastran.small("CQUAD4", 11, 3, 1, 2, 3, 4)
    + "ENDDATA\n",
    ".cdb": ansys.archive(
        [(1, ansys.CUBE), (1, ansys.TETRA), (4, [1, 2, 3, 4])],
        "CMBLOCK,ROOT,NODE,       3\n(8i10)\n         1        -4         8\n",
    ),
}
PIECES = ["9", "-", "*", ",", "\n", "nan", "1e999", '"', "=", "\x00", "é", "9" * 20, "0", "$"]


def damaged(text: str, chance: random.Random) -> str:
    """A text of which a piece is deleted, replaced, repeated, or cut off."""
    start = chance.randrange(len(text))
    end = start + chance.choice([1, 3, 20])
    middle = chance.choice(["", chance.choice(PIECES), 3 * text[start:end]])
    return text[:start] + middle + (text[end:] if chance.random() < 0.9 else "")


@pytest.mark.parametrize("suffix", FILES)
def test_damaged_file_is_read_or_refused(tmp_path: Path, suffix: str) -> None:
    chance, refused = random.Random(suffix), 0
    path = tmp_path / f"a{suffix}"
    for _ in range(50):
        text = FILES[suffix]
        for _ in range(chance.choice([1, 1, 3])):
            text = damaged(text, chance)
        path.write_text(text)
        try:
            read(path)
        except SceneError as error:
            refused += 1
            assert str(path) in str(error) and "\n" not in str(error)
    assert 10 < refused < 50
