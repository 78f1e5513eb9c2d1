"""What was run: `scene.toml` and `provenance.json` of an output folder, and the names of results.

Both files are written before the computation. `scene.toml` holds the scene with all defaults and
overrides, and `fenicsrom run scene.toml` repeats the run. The mesh file, or a stored model that is
not large, is copied beside it. `provenance.json` names the results of the run.
"""

import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from itertools import chain, count
from pathlib import Path
from typing import Any

from fenicsrom.errors import refuse
from fenicsrom.files import atomic_write, reads_other_files
from fenicsrom.online.store.store import provenance
from fenicsrom.post.base.picture import NAMES
from fenicsrom.post.base.tables import write_summary, write_text
from fenicsrom.scene import Scene, scene_table, toml_text
from fenicsrom.scene.keys.unit_system import Units
from fenicsrom.scene.reading.overrides import units_sentence

SCENE_FILE = "scene.toml"
RECORD = "provenance.json"
LARGEST_COPY = 100 * 2**20  # bytes of the largest mesh file that is copied
LARGEST_MODEL = 20 * 2**20  # bytes of the largest stored model that is copied: each run has its own
MODEL = "reduced_model.npz"
SHAPES = ("normal_modes", "static_modes", "derivatives", "equilibrium")
TABLES = (
    *("response", "backbone", "equilibria", "campbell", "modes", "sweep", "comparison"),
    *("stability", "disk", "map", "ringdown"),
)
COMMIT = "FENICSROM_COMMIT"  # variable that names the commit where the checkout has no history
RESULTS = (
    # numbers
    *("report.html", "summary.json", "history.npz", "checkpoint.npz", MODEL, f"*stored_{MODEL}"),
    *("stresses.csv", "modal_stresses.csv", "reactions.csv"),
    # pictures
    *(f"{name}.png" for name in NAMES),
    "motion.gif",
    # ParaView; the shapes are folders if several ranks wrote them
    *("results.pvd", "look.py", "results", "groups.vtu", "disk.vtu", "surface_[1-9]*"),
    *("contact_points", "motion"),
    *(f"{name}{suffix}" for name in SHAPES for suffix in ("", ".vtu")),
    # curves and studies
    *(f"{name}.{suffix}" for name in TABLES for suffix in ("csv", "json")),
    *("response_full.csv", "response_peaks.csv", "response_state", "motions", "motions.npz"),
    *("run_up.csv", "wear.csv", "joints.csv", "diameters.csv", "contacts.csv", "runs", "models"),
    *("map.h5", "map_lines", "map_wear.csv", "ringdown_decays"),
)
"""Patterns of all names that the program gives to results, beside the copy of the mesh file."""

TEMPORARY = re.compile(r"\.(.+)\.[0-9a-f]{12}(\.\w+)?")  # of a killed run (`files.atomic_write`)


@dataclass(frozen=True)
class Origin:
    """How a computation was started.

    Attributes:
        command: the words of the command.
        task: the name of the command, and the options that vary the scene.
        overrides: the values of `--set`.
        model: the stored model, or None.
        resume: the checkpoint or state that the run continues, or None.
        in_place: whether the command continues what its own folder has under the same scene.
    """

    command: Sequence[str]
    task: Sequence[str] = ("run",)
    overrides: Sequence[str] = ()
    model: Path | None = None
    resume: Path | None = None
    in_place: bool = False


def python_origin() -> Origin:
    """The origin of a run that a Python program started."""
    return Origin(("python3", *sys.argv))


def is_result(name: str) -> bool:
    """Whether the program gives this name to a file or folder of results."""
    name = TEMPORARY.sub(r"\1\2", name)
    return any(fnmatchcase(name, pattern) for pattern in RESULTS)


def write_origin(
    folder: Path, scene: Scene, origin: Origin, ranks: int, own: Sequence[str]
) -> dict[str, Any]:
    """Write `scene.toml`, `provenance.json` and the copy of the mesh; give the record.

    Args:
        folder: the folder.
        scene: the scene.
        origin: how the computation was started.
        ranks: number of MPI ranks.
        own: names in the folder that belong to the run already.

    Raises:
        OSError: a file cannot be written.
    """
    before = {path.name for path in folder.iterdir()} - set(own)
    stored = origin.model is not None
    mesh, *also = [None if stored else _keep_mesh(file, folder) for file in scene.geometry.files]
    model = _keep_model(origin.model, folder)
    inputs = _input_words(origin, model, folder)
    record: dict[str, Any] = {
        "state": "running",
        "command": shlex.join(origin.command),
        "working_folder": str(Path.cwd()),
        "began": _now(),
        "ended": None,
        "ranks": ranks,
        "versions": provenance(),
        "commit": commit(),
        "scene": scene.source,
        "units": units_sentence(scene) or None,
        "overrides": list(origin.overrides),
        "mesh": mesh,
        "also": also,
        "model": model,
        "resumed_from": _named(origin.resume),
        "repeat": shlex.join(["fenicsrom", origin.task[0], SCENE_FILE, *origin.task[1:], *inputs]),
        "task": list(origin.task),
        "results": [name for name in _copies(mesh, model, *also) if name not in before],
    }
    table = scene_table(scene)
    if mesh is not None and mesh["copy"]:
        table["geometry"]["mesh"] = mesh["copy"]
    if also:
        pairs = zip(also, scene.geometry.also, strict=True)
        table["geometry"]["also"] = [  # the name of a file begins those of its groups
            one.name if kept and kept["copy"] == one.name else str(one) for kept, one in pairs
        ]
    write_summary(folder / RECORD, record)
    write_text(folder / SCENE_FILE, _comments(record, scene.units) + toml_text(table))
    return record


def read_record(folder: Path) -> dict[str, Any] | None:
    """Read `provenance.json`; None if the folder has none.

    Raises:
        SceneError: the file is damaged.
    """
    path = folder / RECORD
    if not path.exists():
        return None
    try:
        record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        reason = "is damaged; remove this file, or choose another folder"
        raise refuse(path, reason) from None
    return record


def _copies(*inputs: Mapping[str, Any] | None) -> list[Any]:
    """The names of the copies of input files."""
    return [found["copy"] for found in inputs if found and found.get("copy") is not None]


def end_record(folder: Path, record: Mapping[str, Any], state: str, results: Sequence[str]) -> None:
    """Write `provenance.json` of a run that ended, with the names of what it wrote.

    Raises:
        OSError: the file cannot be written.
    """
    ended = {"state": state, "ended": _now(), "results": list(results)}
    write_summary(folder / RECORD, {**record, **ended})


def origin_table(folder: Path) -> list[list[Any]]:
    """The table of the report that says what was run; empty without a record.

    Raises:
        SceneError: the record is damaged.
    """
    record = read_record(folder)
    if record is None:
        return []
    return [["item", "value"], *_items(record)]


def _items(record: Mapping[str, Any]) -> list[list[str]]:
    """What was run: names and values."""
    return [
        ["command", record["command"]],
        ["in the folder", record["working_folder"]],
        ["began", record["began"]],
        ["program", _program(record)],
        ["MPI ranks", str(record["ranks"])],
        ["scene", record["scene"]],
        *([["units", record["units"].removeprefix("units: ")]] if record.get("units") else []),
        *[["override", override] for override in record["overrides"]],
        *[[name, _file_words(record[key])] for name, key in _INPUTS if record[key]],
        *[["mesh", _file_words(one)] for one in record.get("also") or () if one],
        ["to repeat", f"{record['repeat']} (in this folder)"],
    ]


_INPUTS = (("mesh", "mesh"), ("stored model", "model"), ("resumed from", "resumed_from"))


def commit() -> str | None:
    """The commit of the program, with "-dirty" after changes; None where it is not known."""
    if given := os.environ.get(COMMIT):
        return given
    checkout = Path(__file__).resolve().parents[3]
    if not (checkout / ".git").exists():
        return None
    words = ["git", "-c", "safe.directory=*", "-C", str(checkout), "describe", "--always"]
    words += ["--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=10.0, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None


def checksum(path: Path) -> str:
    """The SHA-256 of a file, or of the files of a folder with their names."""
    digest = hashlib.sha256()
    if path.is_dir():
        for file in sorted(file for file in path.rglob("*") if file.is_file()):
            digest.update(f"{file.relative_to(path)} {checksum(file)}\n".encode())
        return digest.hexdigest()
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _named(path: Path | None) -> dict[str, Any] | None:
    """The absolute path of an input and its checksum; None for an input that does not exist."""
    if path is None or not path.exists():
        return None
    return {"file": str(path.absolute()), "sha256": checksum(path)}


def _keep_mesh(mesh: Path, folder: Path) -> dict[str, Any] | None:
    """Copy the mesh file into the folder, or say why it is not there."""
    if not mesh.is_file():
        return None
    found: dict[str, Any] = {"file": str(mesh.absolute()), "sha256": checksum(mesh)}
    found |= {"bytes": mesh.stat().st_size, "copy": None, "missing": None}
    if found["bytes"] > LARGEST_COPY:
        found["missing"] = f"the mesh file is larger than {LARGEST_COPY // 2**20} MB: not copied"
        return found
    if mesh.suffix == ".geo" and reads_other_files(mesh.read_bytes()):
        found["missing"] = "the mesh file reads other files or the environment: not copied"
        return found
    name = f"mesh_{mesh.name}" if is_result(mesh.name) else mesh.name
    return found | {"copy": _copied(mesh, folder, name, f"mesh_{mesh.name}")}


def _keep_model(model: Path | None, folder: Path) -> dict[str, Any] | None:
    """Copy the stored model into the folder, unless it is there or large."""
    found = _named(model)
    if model is None or found is None:
        return None
    inside = model.resolve().parent == folder.resolve()
    if inside or model.stat().st_size > LARGEST_MODEL:
        return found | {"copy": None}
    return found | {"copy": _copied(model, folder, MODEL, f"stored_{MODEL}")}


def _copied(file: Path, folder: Path, name: str, other: str) -> str:
    """Copy a file into the folder, unless it is there; no file with other content is replaced."""
    for free in chain([name, other], (f"{number}_{other}" for number in count(2))):
        copy = folder / free
        if copy.exists() and checksum(copy) == checksum(file):
            return free
        if not copy.exists() and not copy.is_symlink():
            break
    with atomic_write(copy) as temporary:
        shutil.copyfile(file, temporary)
    return copy.name


def _input_words(origin: Origin, model: Mapping[str, Any] | None, folder: Path) -> list[str]:
    """The options that name the stored model and the checkpoint when a run is repeated."""

    def word(path: Path) -> str:
        inside = path.resolve().is_relative_to(folder.resolve())
        return str(path.resolve().relative_to(folder.resolve()) if inside else path.absolute())

    words: list[str] = []
    if origin.model is not None:
        words += ["--from", (model and model["copy"]) or word(origin.model)]
    if origin.resume is not None and not origin.in_place:
        words += ["--resume", word(origin.resume)]
    return words


def _comments(record: Mapping[str, Any], units: Units) -> str:
    """The first lines of `scene.toml`, whose scene was written in these units."""
    lines = ["The scene of this folder, with all defaults and overrides."]
    if not units.is_si:
        lines += [
            "Numbers are in SI units; those of regions are per area, N/m² and N/m³: a curve counts "
            f"as 1 {units.length} wide, and a node of a node set as 1 {units.length}²."
        ]
    lines += [f"{name + ':':14} {value}" for name, value in _items(record)]
    return "".join(f"# {line}\n" for text in lines for line in text.splitlines()) + "\n"


def _program(record: Mapping[str, Any]) -> str:
    """The versions and the commit."""
    from fenicsrom import __version__

    versions = {"fenicsrom": __version__, **record["versions"]}
    words = ", ".join(f"{name} {number}" for name, number in versions.items())
    return f"{words}, commit {record['commit']}" if record["commit"] else words


def _file_words(named: Mapping[str, Any]) -> str:
    """Name an input file with its checksum, and say whether the folder has a copy of the file."""
    words = f"{named['file']}, SHA-256 {named['sha256']}"
    if named.get("copy"):
        return f"{words}; copied to {named['copy']}"
    return f"{words}; {named['missing']}" if named.get("missing") else words


def _now() -> str:
    """The date and time in UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")
