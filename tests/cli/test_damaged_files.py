"""Hostile files: a damaged model or mesh gives a result or one sentence, and nothing hangs.

The quick part has several hundred inputs, the slow part several thousand. A separate process reads
the meshes, so that the tests can tell a crash of gmsh from a refusal.
"""

import dataclasses
import inspect
import io
import json
import os
import re
import select
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import beam_scene, random_model

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.store.archive import FORMAT, StoredModel, load_model, save_model
from fenicsrom.scene.reading.reading import shared_meshes

LONG = (pytest.mark.slow, pytest.mark.long)


def drawn(
    few: int, many: int, **inputs: st.SearchStrategy[Any]
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A test of `few` random inputs, equal in each session, and of `many` in the slow part;
    fixtures are passed on."""

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @pytest.mark.parametrize("count", [few, pytest.param(many, marks=LONG)])
        def run(count: int, **fixtures: Any) -> None:
            @settings(
                max_examples=count,
                deadline=None,
                derandomize=True,
                database=None,
                suppress_health_check=[
                    HealthCheck.too_slow,
                    HealthCheck.data_too_large,
                    HealthCheck.large_base_example,
                ],
            )
            @given(**inputs)
            def each(**values: Any) -> None:
                test(**fixtures, **values)

            each()

        names = [
            "count",
            *(name for name in inspect.signature(test).parameters if name not in inputs),
        ]
        run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY) for name in names]
        )
        run.__doc__ = test.__doc__
        return run

    return decorate


# ------------------------------------------------------------------ stored models


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small model as the program writes it."""
    path = tmp_path_factory.mktemp("stored") / "reduced_model.npz"
    model = random_model(3, masters=2, force=1.0)
    scene = beam_scene(2, ("time.periods=2", "time.steps_per_period=20"))
    save_model(
        path, StoredModel(model, scene, "rubin", ("1S", "2S", "1V"), 40, np.array([3.2]), {})
    )
    return path


def sentence(path: Path) -> str | None:
    """The one line by which a file is refused; None if it is a model."""
    try:
        load_model(path)
    except SceneError as error:
        assert str(error).startswith(f"{path}: ") and str(error).isprintable()
        return str(error)
    return None


def arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def same(path: Path, other: Path) -> bool:
    """Whether two stored models are the same to the bit."""
    a, b = load_model(path), load_model(other)
    names = ("mass", "damping", "loads", "contact_offset", "probe", "probe_offset")
    numbers = [(getattr(a.model, name), getattr(b.model, name)) for name in names]
    numbers += [
        *zip(a.model.elastic, b.model.elastic, strict=True),
        (a.frequencies_hz, b.frequencies_hz),
    ]
    header = (a.scene, a.method, a.labels, a.dofs) == (b.scene, b.method, b.labels, b.dofs)
    return header and all(np.array_equal(x, y) for x, y in numbers)


@dataclasses.dataclass(frozen=True)
class Damage:
    """A change of a file at a position; a negative position counts from the end."""

    kind: str
    place: int
    length: int
    bit: int
    noise: bytes

    def done_to(self, content: bytes) -> bytes:
        place = self.place % len(content)
        if self.kind == "cut":
            return content[:place]
        if self.kind == "flip":
            return content[:place] + bytes([content[place] ^ 1 << self.bit]) + content[place + 1 :]
        stop = min(len(content), place + self.length)
        middle = {
            "noise": self.noise,
            "double": 2 * content[place:stop],
            "remove": b"",
            "zero": bytes(stop - place),
        }
        return content[:place] + middle[self.kind] + content[stop:]


DAMAGE = st.lists(
    st.builds(
        Damage,
        st.sampled_from(["cut", "flip", "flip", "flip", "noise", "double", "remove", "zero"]),
        st.integers(0, 10**6) | st.integers(-1500, -1),  # the end of a zip file says what is in it
        st.integers(1, 40),
        st.integers(0, 7),
        st.binary(max_size=40),
    ),
    min_size=1,
    max_size=2,
)


def damage(content: bytes, done: list[Damage]) -> bytes:
    for item in done:
        content = item.done_to(content) if content else content
    return content


@drawn(150, 1500, done=DAMAGE)
@pytest.mark.slow
def test_damaged_model_is_refused_or_unchanged(stored: Path, done: list[Damage]) -> None:
    path = stored.with_name("damaged.npz")
    path.write_bytes(damage(stored.read_bytes(), done))
    if sentence(path) is None:
        assert same(path, stored)


@drawn(50, 1000, data=st.binary(max_size=300))
def test_random_bytes_are_refused(stored: Path, data: bytes) -> None:
    path = stored.with_name("noise.npz")
    path.write_bytes(data)
    assert sentence(path) is not None


ODD = st.sampled_from(
    [
        np.zeros(0),
        np.zeros((2, 2)),
        np.zeros((3, 3), dtype=np.float32),
        np.full((3, 3), np.nan),
        np.array(np.inf),
        np.array([None, {"a": 1}], dtype=object),
        np.array("text"),
        np.zeros((3, 3), dtype=complex),
        -np.eye(3),
        np.zeros((3, 3)),
        np.eye(3) + np.eye(3, k=1),
        np.zeros((3, 1)),
        np.array(-1.0),
        np.zeros((10, 10)),
        np.arange(3),
        np.ones((1, 3, 3)),
        np.array(True),
    ]
)


@drawn(80, 1000, data=st.data())
def test_model_with_odd_or_missing_array_is_refused(stored: Path, data: st.DataObject) -> None:
    found = arrays(stored)
    name = data.draw(st.sampled_from(sorted(found)))
    if data.draw(st.booleans()):
        odd = data.draw(ODD)
        same = odd.dtype == found[name].dtype and odd.shape == found[name].shape
        if same and odd.tobytes() == found[name].tobytes():
            return
        found[name] = odd
    else:
        del found[name]
    path = stored.with_name("odd.npz")
    np.savez(path, **found)
    assert sentence(path) is not None


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=5,
)


@drawn(60, 1000, data=st.data())
def test_model_with_changed_header_is_refused(stored: Path, data: st.DataObject) -> None:
    found = arrays(stored)
    header = json.loads(str(found["header"]))
    branch, depth = header, data.draw(st.integers(0, 3))
    for _ in range(depth):
        inner = [key for key, value in branch.items() if isinstance(value, dict) and value]
        if not inner:
            break
        branch = branch[data.draw(st.sampled_from(inner))]
    key = data.draw(st.sampled_from(sorted(branch)))
    if data.draw(st.booleans()):
        branch[key] = data.draw(JSON)
    else:
        del branch[key]
    text = data.draw(st.sampled_from([json.dumps(header)] * 9 + [json.dumps(header)[:-5]]))
    path = stored.with_name("header.npz")
    np.savez(path, **{**found, "header": np.array(text)})
    assert (sentence(path) is None) == (text == str(found["header"]))


def test_model_with_other_version_or_pickle_is_refused(stored: Path, tmp_path: Path) -> None:
    found = arrays(stored)
    header = json.loads(str(found["header"])) | {"format": "fenicsrom reduced model 8"}
    np.savez(tmp_path / "version.npz", **{**found, "header": np.array(json.dumps(header))})
    with pytest.raises(SceneError) as refusal:
        load_model(tmp_path / "version.npz")
    assert refusal.value.kind is ErrorKind.FORMAT
    assert refusal.value.source == str(tmp_path / "version.npz")
    named = re.findall(r"fenicsrom reduced model \d+", str(refusal.value))
    assert named == ["fenicsrom reduced model 8", FORMAT]  # found, readable

    class Attack:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "ran"),)

    np.savez(tmp_path / "pickle.npz", **{**found, "model.mass": np.array([Attack()], dtype=object)})
    assert sentence(tmp_path / "pickle.npz") is not None
    (tmp_path / "bare.npz").write_bytes(
        b"\x80\x04cos\nmkdir\n(V" + str(tmp_path / "ran").encode() + b"\ntR."
    )
    assert sentence(tmp_path / "bare.npz") is not None
    assert not (tmp_path / "ran").exists()


def test_model_saved_again_is_unchanged_and_runs(stored: Path, tmp_path: Path) -> None:
    first = load_model(stored)
    save_model(tmp_path / "again.npz", first)
    assert same(stored, tmp_path / "again.npz")
    assert first.with_overrides(["loads.0.force=0.1"]).simulate().periods == 2


def test_model_with_huge_array_header_is_refused(stored: Path, tmp_path: Path) -> None:
    """A header declares an array of 1e15 entries; it is refused before memory is allocated."""
    found = arrays(stored)
    np.savez(tmp_path / "bomb.npz", **found)
    raw = io.BytesIO()
    with zipfile.ZipFile(tmp_path / "bomb.npz") as old, zipfile.ZipFile(raw, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "model.mass.npy":
                said = b"(3, 3), }" + b" " * 20
                data = data.replace(
                    said[: len(b"(1" + b"0" * 15 + b",), }")], b"(1" + b"0" * 15 + b",), }"
                )
                assert b"000000" in data
            new.writestr(name, data)
    (tmp_path / "bomb.npz").write_bytes(raw.getvalue())
    assert sentence(tmp_path / "bomb.npz") is not None


# ------------------------------------------------------------------ meshes

# the output of libraries goes to stderr, so that stdout holds answers only
READER = """
import json, os, resource, sys
from pathlib import Path
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)
from mpi4py import MPI
from fenicsrom.errors import SceneError
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.scene import Geometry
resource.setrlimit(resource.RLIMIT_AS, (2**33, resource.RLIM_INFINITY))
for line in sys.stdin:
    given = json.loads(line)
    try:
        geometry = Geometry(mesh=Path(given.pop("mesh")), thickness=1.0, **given)
        mesh = build_mesh(geometry, MPI.COMM_SELF)
        d = mesh.domain.topology.dim
        cells = mesh.domain.topology.index_map(d).size_local
        print("mesh", cells, len(mesh.warnings), file=answers, flush=True)
    except SceneError as error:
        print("refused", str(error).replace("\\n", "|"), file=answers, flush=True)
    except BaseException as error:
        text = str(error).replace("\\n", "|")
        print("raised", type(error).__name__, text, file=answers, flush=True)
"""


class Reader:
    """A process that reads meshes."""

    def __init__(self) -> None:
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", READER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def read(self, path: Path, dimension: int = 2, seconds: float = 60.0, **geometry: Any) -> str:
        """The outcome of a mesh: `mesh CELLS WARNINGS`, `refused SENTENCE`, `raised ..`, `crashed`
        or `hangs`."""
        if self.process.poll() is not None:
            self.start()
        assert self.process.stdin is not None and self.process.stdout is not None
        given = {"mesh": str(path), "dimension": dimension, **geometry}
        print(json.dumps(given), file=self.process.stdin, flush=True)
        ready, _, _ = select.select([self.process.stdout], [], [], seconds)
        if not ready:
            self.stop()
            return "hangs"
        line = self.process.stdout.readline().strip()
        if not line:
            code = self.process.wait()
            self.stop()
            return f"crashed {code}"
        return line

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            with suppress(BrokenPipeError):
                stream.close()  # type: ignore[union-attr]


@pytest.fixture(scope="module")
def reader():  # type: ignore[no-untyped-def]
    pytest.importorskip("dolfinx")
    reader = Reader()
    yield reader
    reader.stop()


def square(cells: int = 2) -> list[list[str]]:
    """A square of quadrilaterals as the sections of a .msh file of version 2.2."""
    n = cells + 1
    nodes = [f"{j * n + i + 1} {i / cells!r} {j / cells!r} 0" for j in range(n) for i in range(n)]
    left = [f"1 2 1 1 {j * n + 1} {(j + 1) * n + 1}" for j in range(cells)]
    right = [f"1 2 2 2 {(j + 1) * n} {(j + 2) * n}" for j in range(cells)]
    quads = [
        f"3 2 3 3 {j * n + i + 1} {j * n + i + 2} {(j + 1) * n + i + 2} {(j + 1) * n + i + 1}"
        for j in range(cells)
        for i in range(cells)
    ]
    elements = [f"{k + 1} {line}" for k, line in enumerate([*left, *right, *quads])]
    return [
        ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"],
        ["$PhysicalNames", "3", '1 1 "root"', '1 2 "tip"', '2 3 "body"', "$EndPhysicalNames"],
        ["$Nodes", str(len(nodes)), *nodes, "$EndNodes"],
        ["$Elements", str(len(elements)), *elements, "$EndElements"],
    ]


def text(sections: list[list[str]]) -> str:
    return "\n".join(line for section in sections for line in section) + "\n"


def refused(reader: Reader, path: Path, content: str) -> str:
    path.write_text(content)
    answer = reader.read(path)
    assert answer.startswith(("refused ", "mesh ")), answer
    if answer.startswith("refused "):
        assert answer.isprintable()
    return answer


@pytest.mark.slow
def test_intact_square_is_read(reader: Reader, tmp_path: Path) -> None:
    assert refused(reader, tmp_path / "square.msh", text(square())) == "mesh 4 0"


def test_mesh_with_node_zero_is_refused(reader: Reader, tmp_path: Path) -> None:
    """gmsh 4.13 crashes on node number 0."""
    sections = square()
    sections[2][10] = "0 1.0 1.0 9"
    assert refused(reader, tmp_path / "crash.msh", text(sections)).startswith("refused ")


def test_mesh_with_name_not_in_utf8_is_refused(reader: Reader, tmp_path: Path) -> None:
    path = tmp_path / "name.msh"
    path.write_bytes(text(square()).encode().replace(b"root", b"r\xf3ot"))
    assert "UTF-8" in reader.read(path)


@pytest.mark.parametrize(
    ("section", "outcome"),
    [(0, "refused "), (1, "mesh 4 0"), (2, "refused "), (3, "refused ")],
    ids=["format", "names", "nodes", "elements"],
)
def test_mesh_without_section_is_refused_or_has_no_names(
    reader: Reader, tmp_path: Path, section: int, outcome: str
) -> None:
    sections = square()
    del sections[section]
    answer = refused(reader, tmp_path / "part.msh", text(sections))
    assert answer.startswith(outcome)


@drawn(6, 200, data=st.data())
@pytest.mark.slow
def test_mesh_cut_short_is_refused(
    reader: Reader, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = text(square())
    end = content.index("$EndElements") - 2
    cut = data.draw(st.integers(0, end))
    answer = refused(reader, tmp_path_factory.getbasetemp() / "cut.msh", content[:cut])
    assert answer.startswith("refused "), f"cut at {cut}: {answer}"


@pytest.mark.slow
@drawn(8, 200, data=st.data())
def test_mesh_with_changed_line_is_refused_complete_or_warned_of(
    reader: Reader, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    sections = square()
    rows = sections[data.draw(st.sampled_from([2, 3]))]
    inner = list(range(2, len(rows) - 1))
    kind = data.draw(st.sampled_from(["swap", "remove", "double", "number", "word", "order"]))
    k = data.draw(st.sampled_from(inner))
    words = rows[k].split()
    if kind == "swap":
        other = data.draw(st.sampled_from(inner))
        rows[k], rows[other] = rows[other], rows[k]
    elif kind == "remove":
        del rows[k]
    elif kind == "double":
        rows.insert(k, rows[k])
    elif kind == "number":
        words[data.draw(st.integers(0, len(words) - 1))] = str(
            data.draw(st.integers(-5, 40) | st.integers())
        )
        rows[k] = " ".join(words)
    elif kind == "word":
        place = data.draw(st.integers(0, len(words) - 1))
        words[place] = data.draw(
            st.sampled_from(["nan", "inf", "x", "1e999", "", "-", '"', "$End"])
        )
        rows[k] = " ".join(words)
    else:
        order = data.draw(st.permutations(words))
        rows[k] = " ".join(order)
    answer = refused(reader, tmp_path_factory.getbasetemp() / "mixed.msh", text(sections))
    if answer.startswith("mesh "):
        _, cells, warnings = answer.split()
        assert cells == "4" or warnings != "0", f"{kind} {rows[k]}: {answer}"


@pytest.mark.slow
@drawn(8, 200, done=DAMAGE)
def test_damaged_mesh_is_refused_or_read(
    reader: Reader, tmp_path_factory: pytest.TempPathFactory, done: list[Damage]
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.msh"
    path.write_bytes(damage(text(square()).encode(), done))
    answer = reader.read(path)
    assert answer.startswith(("refused ", "mesh ")), answer


SIZES = ["1e300", "-1e300", "1e16", "1e-300", "0", "nan", "inf"]
SHEET = """
DefineConstant[ size = 1 ];
Point(1) = {0, 0, 0, 0.5}; Point(2) = {size, 0, 0, 0.5};
Point(3) = {size, 1, 0, 0.5}; Point(4) = {0, 1, 0, 0.5};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
"""
BLOCK = (
    'SetFactory("OpenCASCADE"); DefineConstant[ size = 1 ]; '
    "Box(1) = {0, 0, 0, size, 1, 1}; MeshSize{:} = 0.5;"
)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", ["sheet", "block", "beam2d", "beam3d", "blade"])
def test_geometry_of_absurd_size_is_refused(
    reader: Reader, tmp_path: Path, name: str, size: str
) -> None:
    """Without a check some of these crash gmsh, and some make it fill all memory."""
    path, parameter = shared_meshes() / f"{name}.geo", "span" if name == "blade" else "length"
    if name in ("sheet", "block"):
        path, parameter = tmp_path / f"{name}.geo", "size"
        path.write_text({"sheet": SHEET, "block": BLOCK}[name])
    answer = reader.read(
        path,
        2 if name in ("sheet", "beam2d") else 3,
        parameters={parameter: float(size)},
        seconds=20.0,
    )
    assert answer.startswith(f"refused {path}: ") and answer.isprintable(), answer
    if size == "1e300" and name != "block":
        assert answer.endswith("coordinates must be at most 1e+15")


@pytest.mark.parametrize(
    ("size", "sentence"),
    [
        ("1.E300", "no body with an extent"),
        ("1.E19", "at most 1e+15"),
        ("1.E-300", ""),
        ("0.", ""),
        ("1.E16", "size = 0.001: must be at least 5e+09 for a body of 1e+13 m"),
        pytest.param("1e300", "", marks=LONG),
    ],
)
def test_step_file_of_absurd_size_is_refused(
    reader: Reader, tmp_path: Path, size: str, sentence: str
) -> None:
    """The last text is not a number in a STEP file, and gmsh does not finish reading it."""
    gmsh = pytest.importorskip("gmsh")
    path = tmp_path / "block.step"
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.model.occ.addBox(0, 0, 0, 7, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    content = path.read_text()
    assert "(7.," in content
    path.write_text(content.replace("(7.,", f"({size},"))
    answer = reader.read(path, 3, size=1e-3, seconds=90.0)
    assert answer.startswith(f"refused {path}: ") and answer.isprintable() and sentence in answer, (
        answer
    )


# ------------------------------------------------------------------ ends that come too early

FILES = ("report.html", "summary.json", "history.npz", "motion.png")


PERIODS = 200  # long enough for a signal during the run; all runs of so many draw the same pictures


def rerun(stored: Path, folder: Path, prelude: str = "", periods: int = PERIODS) -> list[str]:
    """The command that integrates a stored model again."""
    program = f"import sys\n{prelude}\nfrom fenicsrom.cli import main\nsys.exit(main(sys.argv[1:]))"
    return [
        sys.executable,
        "-c",
        program,
        "run",
        "--from",
        str(stored),
        "--output",
        str(folder),
        "--set",
        f"time.periods={periods}",
        "--set",
        "time.steady_tolerance=0.0",
    ]


def whole_files(folder: Path) -> dict[str, bytes]:
    """The files of a run: each can be opened, and there is no other file."""
    found = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert not [name for name in found if name.startswith(".")], "a half-written file was left"
    json.loads(found["summary.json"])
    with np.load(folder / "history.npz") as history:
        assert history["reduced_time"].size
    assert found["report.html"].rstrip().endswith(b"</html>")
    assert found["motion.png"].rstrip().endswith(b"IEND\xaeB`\x82")
    return found


@pytest.fixture(scope="module")
def finished(stored: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of an undisturbed run."""
    folder = tmp_path_factory.mktemp("finished")
    subprocess.run(rerun(stored, folder), check=True, capture_output=True)
    return whole_files(folder)


def put(files: dict[str, bytes], folder: Path) -> None:
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)


@pytest.mark.slow
@pytest.mark.parametrize("room", [100, 3000, 60_000])
def test_full_disk_leaves_only_complete_files(
    stored: Path, finished: dict[str, bytes], tmp_path: Path, room: int
) -> None:
    """A limit on the file size stands for a full disk: the second run fails at the first larger
    file."""
    put(finished, tmp_path / "out")
    assert max(map(len, finished.values())) > room
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))"
    run = subprocess.run(
        rerun(stored, tmp_path / "out", limit), capture_output=True, text=True, check=False
    )
    assert run.returncode == 1
    error = run.stderr.splitlines()[-1]
    assert error.startswith("fenicsrom: ") and error.endswith("File too large")
    assert "Traceback" not in run.stderr
    left = whole_files(tmp_path / "out")
    assert left.keys() == finished.keys()


def catches_sigterm(process: subprocess.Popen[str]) -> bool:
    """Tell whether a running process has a handler for SIGTERM."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    caught = int(status.partition("SigCgt:")[2].split()[0], 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.4, 1.0, 2.0])
def test_terminated_rerun_leaves_only_complete_files(
    stored: Path, finished: dict[str, bytes], tmp_path: Path, delay: float
) -> None:
    """SIGTERM during the integration (twice, as from a process group) or while files are
    written."""
    periods = PERIODS if delay else 100_000
    text = finished["scene.toml"].decode()
    assert f"\nperiods = {PERIODS}\n" in text
    same = text.replace(f"\nperiods = {PERIODS}\n", f"\nperiods = {periods}\n").encode()
    put({**finished, "scene.toml": same}, tmp_path / "out")  # an earlier run of the same scene
    # outside of the command SIGTERM is ignored, and does not end Python while it starts or exits
    prelude = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)"
    command = rerun(stored, tmp_path / "out", prelude, periods)
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        while process.poll() is None and not catches_sigterm(process):
            time.sleep(0.01)
        time.sleep(delay)
        process.send_signal(signal.SIGTERM)
        if not delay:
            time.sleep(0.05)
            process.send_signal(signal.SIGTERM)
        error = process.stderr.read()
        code = process.wait(60)
    assert code in (0, 143) and (delay or code == 143)
    assert "Traceback" not in error
    assert error.splitlines()[-1].startswith("fenicsrom: terminated; ") == (code == 143)
    assert whole_files(tmp_path / "out").keys() == finished.keys()
