"""Damaged files: a damaged model or mesh gives a result or one sentence, and nothing hangs.

A separate process reads the meshes, so that the tests can tell a crash of gmsh from a refusal.
"""

import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import beam_scene, random_model

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.store.archive import FORMAT, StoredModel, load_model, save_model
from fenicsrom.scene.reading.reading import shared_meshes

LONG = (pytest.mark.slow, pytest.mark.long)

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


def test_damaged_model_is_refused_or_unchanged(stored: Path) -> None:
    path, content, rng = (
        stored.with_name("damaged.npz"),
        stored.read_bytes(),
        np.random.default_rng(1),
    )
    for kind in 20 * ("cut", "flip", "zero"):
        place = int(rng.integers(len(content)))
        middle = {
            "cut": b"",
            "flip": bytes([content[place] ^ 1 << int(rng.integers(8))]) + content[place + 1 :],
            "zero": bytes(40) + content[place + 40 :],
        }
        path.write_bytes(content[:place] + middle[kind])
        if sentence(path) is None:
            assert kind != "cut" and same(path, stored)
    for name in ("header", "model.mass"):
        np.savez(path, **{key: value for key, value in arrays(stored).items() if key != name})
        assert sentence(path) is not None


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
    ("section", "outcome"), [(1, "mesh 4 0"), (3, "refused ")], ids=["names", "elements"]
)
def test_mesh_without_section_is_refused_or_has_no_names(
    reader: Reader, tmp_path: Path, section: int, outcome: str
) -> None:
    sections = square()
    del sections[section]
    answer = refused(reader, tmp_path / "part.msh", text(sections))
    assert answer.startswith(outcome)


@pytest.mark.slow
def test_mesh_cut_short_is_refused(reader: Reader, tmp_path: Path) -> None:
    content = text(square())
    for cut in np.linspace(0, content.index("$EndElements") - 2, 12, dtype=int):
        answer = refused(reader, tmp_path / "cut.msh", content[:cut])
        assert answer.startswith("refused "), f"cut at {cut}: {answer}"


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


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("sheet", "1e300"),
        ("block", "-1e300"),
        ("beam2d", "nan"),
        ("beam3d", "1e-300"),
        ("blade", "1e16"),
    ],
)
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
def test_full_disk_leaves_only_complete_files(
    stored: Path, finished: dict[str, bytes], tmp_path: Path
) -> None:
    """A limit on the file size stands for a full disk: the second run fails at the first larger
    file."""
    put(finished, tmp_path / "out")
    room = 3000
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
@pytest.mark.parametrize("delay", [0.0, 1.0])
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
