"""Hostile inputs: damaged scenes, meshes, stored models and checkpoints, through the command line.

    python3 tests/evidence/hostile_inputs.py --output DIR [--scenes 1000] [--meshes 500]
                                             [--archives 500] [--seed 1]

Each input is one command in a process of its own. It must end within `LIMIT` of CPU time with exit
code 0, 1 or 2 and readable sentences, and must not change the files that it reads. Every input that
fails is kept in the folder, and is one line of `defects.jsonl`; the output counts the outcomes.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import random
import re
import resource
import signal
import sys
import time as clock
import tomllib
import traceback
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.cli import main as command_line
from fenicsrom.scene.base.tables import toml_text

DEMOS = Path(__file__).parents[2] / "demos"
LIMIT = 60  # s of CPU time
PATIENCE = 900.0  # s; a longer command waits for something
SHORT = (
    "time.periods=2",
    "time.steps_per_period=20",
    "geometry.parameters.elements_along=4",
    "reference={}",
    "output={pictures=false, paraview=false}",
)
NUMBERS = (0, -1, 1, 0.0, -0.5, 1e-300, 1e300, -1e300, 5e-324, 10**19, -(10**30), 1e-9, 1e9, 7.3)
TEXTS = ("", " ", "é", "\u202e", "\x07\x1b[31m", "a" * 5000, "../..", "nan", "0", "\ud7ff", "auto")
ENDLESS = (float("nan"), float("inf"), -float("inf"))
LISTS: tuple[Any, ...] = ([], {}, [[]], [1.0, 0.0, 0.0], [0.0, 0.0], [None], {"a": {}}, [[0, 1]])
PIECES = (b"", b"9", b"-", b"e", b",", b"\n", b"\x00", b"\xff\xfe", b"nan", b"1e999", b"=[", b'"')


def values(chance: random.Random) -> Any:
    """A value of any kind."""
    found = chance.choice((NUMBERS, NUMBERS, TEXTS, ENDLESS, LISTS, (True, False)))
    value = copy.deepcopy(chance.choice(found))
    if value == [None]:  # a deep list
        value = []
        for _ in range(chance.choice((30, 300))):
            value = [value]
    return value


def branches(node: Any) -> Iterator[Any]:
    """All tables and lists of a table."""
    yield node
    for entry in node.values() if isinstance(node, dict) else node:
        if isinstance(entry, (dict, list)):
            yield from branches(entry)


def mutated(table: dict[str, Any], chance: random.Random) -> dict[str, Any]:
    """A table with one to three entries replaced, removed or added."""
    table = copy.deepcopy(table)
    for _ in range(chance.choice((1, 1, 2, 3))):
        branch = chance.choice(list(branches(table)))
        keys = list(branch) if isinstance(branch, dict) else list(range(len(branch)))
        action = chance.choice(("replace", "replace", "replace", "remove", "add"))
        if action == "add" or not keys:
            if isinstance(branch, dict):
                branch[chance.choice(("force", "gap", "step", "pulse", "é", "x" * 300))] = values(
                    chance
                )
            else:
                branch.append(values(chance))
            continue
        key = chance.choice(keys)
        if action == "remove":
            del branch[key]
        elif isinstance(branch[key], float) and chance.random() < 0.4:
            branch[key] *= chance.choice((-1.0, 0.0, 1e-12, 1e-3, 1e3, 1e12))
        else:
            branch[key] = values(chance)
    return table


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Bytes of which pieces are removed, replaced, repeated, flipped or cut off."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        start = chance.randrange(len(content) or 1)
        end = start + chance.choice((1, 3, 20, 200))
        middle = chance.choice((*PIECES, 3 * content[start:end], bytes(end - start)))
        tail = content[end:] if chance.random() < 0.9 else b""
        content = content[:start] + middle + tail
    return content


def scenes(folder: Path, count: int, chance: random.Random) -> Iterator[tuple[Path, list[str]]]:
    """Scene files and the commands that read them: one in four runs, the others are planned."""
    paths = sorted(DEMOS.glob("*.toml"))
    for number in range(count):
        path = folder / f"scene_{number}.toml"
        runs = number % 4 == 0
        source = DEMOS / chance.choice(("open_2d.toml", "slip_liftoff_2d.toml"))
        source = source if runs else chance.choice(paths)
        if chance.random() < 0.2:
            path.write_bytes(damaged(source.read_bytes(), chance))
        else:
            table = tomllib.loads(source.read_text(encoding="utf-8"))
            path.write_text(toml_text(mutated(table, chance)), "utf-8", "surrogatepass")
        words = ["plan", str(path)]
        if runs:
            words = ["run", str(path), "--output", str(folder / "run"), "--force"]
            for change in SHORT:
                words += ["--set", change]
        yield path, words


def meshes(folder: Path, count: int, chance: random.Random) -> Iterator[tuple[Path, list[str]]]:
    """Mesh files of several formats, and the commands that describe them."""
    import meshio

    points = np.array([[i / 4.0, j / 2.0, 0.0] for j in range(3) for i in range(5)])
    cells = np.array(
        [
            [5 * j + i, 5 * j + i + 1, 5 * j + i + 6, 5 * j + i + 5]
            for j in range(2)
            for i in range(4)
        ]
    )
    mesh = meshio.Mesh(points, [("quad", cells)])
    formats = {".inp": "abaqus", ".bdf": "nastran", ".msh": "gmsh22", ".vtu": "vtu", ".vtk": "vtk"}
    for suffix, name in formats.items():
        meshio.write(folder / f"whole{suffix}", mesh, file_format=name)
    for number in range(count):
        suffix = chance.choice(list(formats))
        path = folder / f"mesh_{number}{suffix}"
        path.write_bytes(damaged((folder / f"whole{suffix}").read_bytes(), chance))
        yield path, ["inspect", str(path), "--output", str(folder / "described")]


def archives(folder: Path, count: int, chance: random.Random) -> Iterator[tuple[Path, list[str]]]:
    """Stored models and checkpoints, and the commands that continue them."""
    made = folder / "slip_liftoff_2d"
    model = made / "reduced_model.npz"
    for number in range(count):
        name = chance.choice(("reduced_model.npz", "reduced_model.npz", "checkpoint.npz"))
        path = folder / f"archive_{number}.npz"
        path.write_bytes(damaged((made / name).read_bytes(), chance))
        source = path if name == model.name else model
        words = ["run", "--from", str(source), "--output", str(folder / "again"), "--force"]
        yield path, words if source == path else [*words, "--resume", str(path)]


def in_process(words: list[str], output: Path) -> int | str:
    """The exit code of a command in a child process, or what ended it."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            file = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, 1)
            os.dup2(file, 2)
            resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))
            code = command_line(words)
        except SystemExit as leaving:
            code = leaving.code if isinstance(leaving.code, int) else 98
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    begin = clock.monotonic()
    while clock.monotonic() - begin < PATIENCE:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else f"ended by {signal.Signals(-code).name}"
        clock.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "waits"


def outcome(path: Path, words: list[str], output: Path) -> str:
    """The exit code of a command that takes an input well, otherwise what is wrong with it."""
    before = path.read_bytes()
    code = in_process(words, output)
    said = output.read_text(encoding="utf-8", errors="replace")
    if code not in (0, 1, 2):
        return str(code)
    if "Traceback (most recent" in said:
        return "traceback"
    if re.search(r"[^\S \n\r\t]|[\x00-\x08\x0e-\x1f\x7f]", said):
        return "control character"
    if code and not said.strip():
        return "no sentence"
    return f"exit {code}" if path.read_bytes() == before else "the input was changed"


def main() -> None:
    """Try all inputs, and keep those that fail."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True)
    for name, number in (("scenes", 1000), ("meshes", 500), ("archives", 500), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=number)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    for geometry in (DEMOS.parent / "meshes").glob("*.geo"):
        (options.output / geometry.name).write_bytes(geometry.read_bytes())
    for demo in ("open_2d", "slip_liftoff_2d"):  # the children inherit what was loaded and compiled
        words = ["run", str(DEMOS / f"{demo}.toml"), "--output", str(options.output / demo)]
        for change in SHORT:
            words += ["--set", change]
        command_line([*words, "--force"])
    for make in (scenes, meshes, archives):
        kind = make.__name__
        chance = random.Random(f"{kind} {options.seed}")
        output = options.output / f"{kind}.txt"
        found: Counter[str] = Counter()
        for path, words in make(options.output, getattr(options, kind), chance):
            what = outcome(path, words, output)
            found[what] += 1
            if what.startswith("exit"):
                path.unlink()
                continue
            entry = {"file": path.name, "words": words, "outcome": what}
            entry["end"] = output.read_text(encoding="utf-8", errors="replace")[-600:]
            with (options.output / "defects.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry) + "\n")
            print(path.name, what, flush=True)
        print(f"{kind}: {dict(sorted(found.items()))}", flush=True)


if __name__ == "__main__":
    main()
