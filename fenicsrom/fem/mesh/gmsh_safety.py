"""Checks of a data file before gmsh, which runs scripts and may crash, reads the file.

gmsh runs a script under any file name, and a script that lies beside a file.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fenicsrom.errors import refuse

HEADERS = {
    ".msh": rb"\$(MeshFormat|NOD|Comments)\b",
    ".unv": rb"\s*-1\s",
    ".step": rb"\s*(/\*.*?\*/\s*)*ISO-10303-21\s*;",
    ".stp": rb"\s*(/\*.*?\*/\s*)*ISO-10303-21\s*;",
}
"""Beginning of a data file that gmsh reads, by its suffix."""

_READ = """
import sys, gmsh
gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gmsh.option.setNumber("General.AbortOnError", 0)
try:
    gmsh.model.add("file")
    gmsh.merge(sys.argv[1])
    gmsh.model.mesh.getNodes()
    for d, tag in gmsh.model.getEntities():
        for kind in gmsh.model.mesh.getElements(d, tag)[0]:
            gmsh.model.mesh.getElementProperties(kind)
    for d, tag in gmsh.model.getPhysicalGroups():
        gmsh.model.getEntitiesForPhysicalGroup(d, tag)
except Exception:
    pass
gmsh.finalize()
"""
"""A script that reads a file as this program does; it only shows whether gmsh crashes."""


def check_header(path: Path) -> None:
    """Check that a data file begins as its format does; gmsh would run a script.

    Raises:
        SceneError: the file begins otherwise.
    """
    with path.open("rb") as file:
        head = file.read(10_000)
    if not re.match(HEADERS[path.suffix.lower()], head, flags=re.DOTALL):
        reason = f"the file does not begin as a {path.suffix} file does; it may be damaged, or it "
        raise refuse(path, f"{reason}has the wrong suffix")


@contextmanager
def linked_alone(path: Path) -> Iterator[str]:
    """Give a link to a file in a folder of its own, because gmsh runs a script beside a file.

    The script that gmsh looks for has the name of the file and the suffix .opt.
    """
    with tempfile.TemporaryDirectory(prefix="fenicsrom-") as folder:
        link = Path(folder) / f"mesh{path.suffix}"
        try:
            link.symlink_to(path.resolve())
        except OSError:  # a system without links
            shutil.copyfile(path, link)
        yield str(link)


def check_survival(source: str, link: str) -> None:
    """Read a data file in another process first.

    A damaged file can crash gmsh, or gmsh may never finish reading it.

    Args:
        source: the file, for messages.
        link: the file that gmsh reads.

    Raises:
        SceneError: gmsh crashed or did not finish.
    """
    seconds = 60.0 + 1e-6 * Path(link).stat().st_size
    try:
        code = subprocess.run(
            [sys.executable, "-c", _READ, link],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=seconds,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        reason = f"gmsh did not finish reading the file within {seconds:.0f} s; it may be damaged"
        raise refuse(source, reason) from None
    if code:
        raise refuse(source, "gmsh crashed while reading the file; it is damaged")
