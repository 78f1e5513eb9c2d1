"""Damaged files: a damaged model or mesh gives a result or one sentence, and nothing hangs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from support import beam_scene, random_model, step_file

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.store.archive import FORMAT, StoredModel, load_model, save_model
from fenicsrom.scene import Geometry
from fenicsrom.scene.reading.reading import shared_meshes

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

SQUARE = b"""$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
2 3 "body"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
1
1 3 2 3 3 1 2 3 4
$EndElements
"""


def refused(path: Path, dimension: int = 2, **geometry: Any) -> str:
    """The sentence by which a mesh is refused."""
    build_mesh = pytest.importorskip("fenicsrom.fem.mesh.mesh").build_mesh
    with pytest.raises(SceneError) as caught:
        build_mesh(
            Geometry(mesh=path, dimension=dimension, thickness=1.0, **geometry), MPI.COMM_SELF
        )
    said = str(caught.value)
    assert said.startswith(f"{path}: ") and said.isprintable()
    return said


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"4 0 1 0", b"0 0 1 0", ""),  # gmsh 4.13 crashes on node number 0
        (b"body", b"b\xf3dy", "UTF-8"),
        (SQUARE[SQUARE.index(b"$Elem") :], b"", ""),
        (b"1 2 3 4\n$EndElements\n", b"", ""),
    ],
)
def test_damaged_mesh_is_refused(tmp_path: Path, old: bytes, new: bytes, words: str) -> None:
    path = tmp_path / "square.msh"
    path.write_bytes(SQUARE.replace(old, new))
    assert words in refused(path)


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
def test_geometry_of_absurd_size_is_refused(tmp_path: Path, name: str, size: str) -> None:
    """Without a check some of these crash gmsh, and some make it fill all memory."""
    path, parameter = shared_meshes() / f"{name}.geo", "span" if name == "blade" else "length"
    if name in ("sheet", "block"):
        path, parameter = tmp_path / f"{name}.geo", "size"
        path.write_text({"sheet": SHEET, "block": BLOCK}[name])
    dimension = 2 if name in ("sheet", "beam2d") else 3
    said = refused(path, dimension, parameters={parameter: float(size)})
    if size == "1e300" and name != "block":
        assert said.endswith("coordinates must be at most 1e+15")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "sentence"),
    [
        ("1.E300", "no body with an extent"),
        ("1.E19", "at most 1e+15"),
        ("1.E16", "size = 0.001: must be at least 5e+09 for a body of 1e+13 m"),
    ],
)
def test_step_file_of_absurd_size_is_refused(tmp_path: Path, size: str, sentence: str) -> None:
    pytest.importorskip("gmsh")
    path = step_file(tmp_path / "block.step", lambda occ: occ.addBox(0, 0, 0, 7, 1, 1))
    content = path.read_text()
    assert "(7.," in content
    path.write_text(content.replace("(7.,", f"({size},"))
    assert sentence in refused(path, 3, size=1e-3)


# ------------------------------------------------------------------ ends that come too early


def rerun(stored: Path, folder: Path, prelude: str = "") -> list[str]:
    """The command that integrates a stored model again."""
    program = f"import sys\n{prelude}\nfrom fenicsrom.cli import main\nsys.exit(main(sys.argv[1:]))"
    call = ["run", "--from", str(stored), "--output", str(folder)]
    return [sys.executable, "-c", program, *call, "--set", "time.steady_tolerance=0.0"]


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
