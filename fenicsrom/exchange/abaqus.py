"""Matrices of Abaqus (.mtx), as `*MATRIX GENERATE` and `*MATRIX OUTPUT` write them, read.

Each matrix has a file of its own, such as JOB_STIF1.mtx, JOB_MASS1.mtx and JOB_DMPV1.mtx (viscous
damping), with a line for each entry:

    node, direction, node, direction, value        format "matrix input"
    row column value                               format "coordinate"

The file may hold one triangle of a symmetric matrix. A clamped unknown has a diagonal value of 1e36
in place of its row; such unknowns are left out.
"""

import re
from pathlib import Path

from fenicsrom.errors import refuse
from fenicsrom.exchange.matrix_set import Label, MatrixSet, check_size, dense, matrix_set
from fenicsrom.formats.collector import content_of

PARTS = {"stiffness": "STIF", "mass": "MASS", "damping": "DMPV"}
"""The word in the name of the file of each matrix."""

CLAMPED = 1e36
"""Diagonal value that stands for a clamped unknown."""

SEPARATOR = re.compile(r"[\s,]+")
Entries = dict[tuple[Label, Label], float]


def read_mtx(path: Path) -> MatrixSet:
    """Read the matrices of a superelement from the file of its stiffness.

    The files of mass and damping are expected in the same folder.

    Raises:
        SceneError: a file cannot be read, or is of another kind.
    """
    word = PARTS["stiffness"]
    if word not in path.name.upper():
        raise refuse(path, f"must be the file of the stiffness, with {word} in its name")
    entries: dict[str, Entries] = {}
    for part, other in PARTS.items():
        file = path.with_name(re.sub(word, other, path.name, count=1, flags=re.IGNORECASE))
        if part != "damping" or file.exists():
            entries[part] = _read_entries(file)
    stiffness = entries["stiffness"]
    clamped = {row for (row, column), v in stiffness.items() if row == column and v >= CLAMPED}
    labels = tuple(sorted({label for pair in stiffness for label in pair} - clamped))
    check_size(path, len(labels))
    matrices = {part: dense(found, labels, True) for part, found in entries.items()}
    return matrix_set(path, matrices, labels)


def _read_entries(path: Path) -> Entries:
    """Read the entries of one matrix.

    Raises:
        SceneError: the file cannot be read, or a line is not an entry.
    """
    found: Entries = {}
    for line in content_of(path).decode("latin-1").splitlines():
        if not line.strip() or line.startswith("**"):
            continue
        words = [word for word in SEPARATOR.split(line.strip()) if word]
        numbers, value = [int(word) for word in words[:-1]], float(words[-1])
        if len(numbers) == 4:
            found[(numbers[0], numbers[1]), (numbers[2], numbers[3])] = value
        elif len(numbers) == 2:
            found[(numbers[0], 0), (numbers[1], 0)] = value
        else:
            reason = f"{line.strip()[:60]!r} is not an entry of a matrix"
            raise refuse(path, f"{reason}; write it with *MATRIX OUTPUT")
    return found
