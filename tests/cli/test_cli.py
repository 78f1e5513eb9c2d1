"""The commands: exit codes, messages and files."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from motions import RESPONSE_KEYS
from support import fresh_python

from fenicsrom.cli import main
from fenicsrom.cli.commands import make_parser
from fenicsrom.post.base.origin import checksum

DEMOS = Path(__file__).parents[2] / "demos"
SCENE = DEMOS / "slip_liftoff_2d.toml"
BEAM = DEMOS.parent / "meshes" / "beam2d.geo"
QUICK = ["--set", "time.periods=2", "--set", "basis.modes=1", "--set", "reference.full=false"]
NO_PICTURES = ["--set", "output.pictures=false"]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    motion = ["--set", "output.motion=true", "--set", "reference.full=true"]
    assert main(["run", str(SCENE), "--output", str(folder), *QUICK, *motion]) == 0
    return folder


def test_summary_of_run_has_documented_keys(results):
    found = json.loads((results / "summary.json").read_text())
    for key in "scene dofs frequencies_Hz basis seconds left_out response error_percent".split():
        assert key in found
    assert found["dofs"] == 240
    assert found["basis"]["method"] == "rubin"
    assert found["basis"]["size"] == len(found["basis"]["labels"])
    assert set(found["response"]) == {"reduced", "full", "beam"}
    for response in found["response"].values():
        assert list(response) == RESPONSE_KEYS
        assert response["steady"] is False and response["periods"] == 2
        assert sum(response["fraction"].values()) == pytest.approx(1.0)
    errors = found["error_percent"]
    assert list(errors) == [
        "amplitude_tangential",
        "amplitude_normal",
        "peak_normal_force",
        "friction_dissipation_per_period",
    ]
    reduced, full = (found["response"][name]["peak_normal_force_N"] for name in ("reduced", "full"))
    assert errors["peak_normal_force"] == pytest.approx(100 * abs(reduced - full) / full)


def test_files_of_run_can_be_opened(results):
    import pyvista

    modes = pyvista.read(results / "normal_modes.vtu")
    (first,) = [name for name in modes.point_data if name.startswith("1V_")]
    assert modes[first].shape == (modes.n_points, 3)
    static = pyvista.read(results / "static_modes.vtu").point_data
    assert set(static) >= {"1S_m_per_N", "2S_m_per_N"}
    assert "1V1V" in pyvista.read(results / "derivatives.vtu").point_data
    motion = pyvista.get_reader(results / "motion" / "motion.pvd")
    assert len(motion.time_values) > 10
    for name in ("motion.png", "contact.png", "energy.png", "modes.png"):
        assert (results / name).read_bytes().startswith(b"\x89PNG")
    page = (results / "report.html").read_text()
    outer = re.sub(r'srcdoc="[^"]*"', "", page)  # test_turning_view looks at the view to turn
    assert len(outer) < len(page) and "src=" in outer
    assert "http" not in outer.replace("http-equiv", "")
    with np.load(results / "history.npz") as history:
        steps = history["reduced_time"].size
        assert history["reduced_displacement"].shape == (steps, 1, 2)


def test_contact_points_file_agrees_with_body_and_contact_law(results):
    """The point sets and the grids have the same instants; the files agree with the displacement of
    the tip node and with the contact law."""
    import pyvista

    grids = pyvista.get_reader(results / "motion" / "motion.pvd")
    points = pyvista.get_reader(results / "contact_points" / "contact_points.pvd")
    assert points.time_values == grids.time_values and len(points.time_values) > 25
    tip, pressed = [2.54, 0.0, 0.0], 0
    for instant in points.time_values[::7]:
        for reader in (grids, points):
            reader.set_active_time_value(instant)
        grid, found = grids.read()[0], points.read()[0]
        node = int(np.argmin(np.linalg.norm(grid.points - tip, axis=1)))
        displacement = found["displacement_m"][0]
        np.testing.assert_allclose(found.points[0], tip, atol=1e-9)
        np.testing.assert_allclose(displacement, grid["displacement_m"][node], atol=1e-9)
        np.testing.assert_allclose(found["position_m"][0], found.points[0] + displacement)
        assert found["gap_m"][0] == pytest.approx(
            -displacement[0]
        )  # the wall is at the tip, preloaded
        normal = max(0.0, 40.0 + 1e4 * displacement[0])
        assert found["normal_force_N"][0] == pytest.approx(normal, abs=1e-6)
        np.testing.assert_allclose(
            found["normal_force_vector_N"][0], [-normal, 0.0, 0.0], atol=1e-6
        )
        friction, state = (found["friction_force_vector_N"][0], found["contact_state"][0])
        assert friction[0] == friction[2] == 0.0 and (state == -1) == (normal == 0.0)
        if state == 0:
            assert abs(friction[1]) == pytest.approx(0.5 * normal, abs=1e-6)
            pressed += 1
    assert pressed > 2


def test_friction_force_file_takes_energy_from_motion(results):
    """Over the frames of a period the friction force on the body takes energy out of it."""
    import pyvista

    reader = pyvista.get_reader(results / "contact_points" / "contact_points.pvd")
    frames = []
    for instant in reader.time_values:
        reader.set_active_time_value(instant)
        frames.append(reader.read()[0])
    way, force = (
        np.array([frame[name][0] for frame in frames])
        for name in ("displacement_m", "friction_force_vector_N")
    )
    work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(way, axis=0))
    assert work < -0.1


BLOCKED = (
    *("dolfinx", "ufl", "basix", "mpi4py", "petsc4py", "slepc4py", "gmsh"),
    *("pyvista", "vtk", "vtkmodules", "meshio", "matplotlib", "fcntl"),
)
WITHOUT = f"""
import os, signal, sys

sys.modules.update(dict.fromkeys({BLOCKED!r}))  # what is None cannot be imported
del os.fork, signal.pthread_sigmask, signal.setitimer, signal.SIGALRM
from fenicsrom.cli.supervision import run
sys.exit(run())
"""


def run_without_modules(model, folder, *overrides):
    """Run a stored model in a Python that has none of the `BLOCKED` modules.

    It also lacks what Windows lacks, and its terminal has the characters of Windows.
    """
    arguments = ["run", "--from", str(model), "--output", str(folder)]
    sets = [part for override in overrides for part in ("--set", override)]
    command = [sys.executable, "-c", WITHOUT, *arguments, *sets]
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    return subprocess.run(
        command, check=True, capture_output=True, text=True, encoding="cp1252", env=environment
    )


@pytest.mark.slow
def test_stored_model_without_other_modules_writes_numbers(results, tmp_path):
    done = run_without_modules(results / "reduced_model.npz", tmp_path)
    names = """
        checkpoint.npz history.npz provenance.json reduced_model.npz report.html scene.toml
        summary.json
    """.split()
    assert {path.name for path in tmp_path.iterdir()} == set(names)
    sentence = "motion.png, contact.png and energy.png were not drawn: matplotlib is not installed"
    assert done.stdout.count(sentence) == 1
    same = json.loads((tmp_path / "summary.json").read_text())["response"]["reduced"]
    first = json.loads((results / "summary.json").read_text())["response"]["reduced"]
    assert same == first
    with np.load(results / "history.npz") as one, np.load(tmp_path / "history.npz") as other:
        for name in other.files:
            np.testing.assert_array_equal(other[name], one[name])


@pytest.mark.slow
def test_stored_model_with_changed_loads_follows_them(results, tmp_path):
    changes = ["loads.0.force=0", "loads.0.frequency=3.0", "contacts.0.friction=0.0"]
    run_without_modules(results / "reduced_model.npz", tmp_path, *changes)
    found = json.loads((tmp_path / "summary.json").read_text())["response"]["reduced"]
    first = json.loads((results / "summary.json").read_text())["response"]["reduced"]
    energy = "friction_dissipation_per_period_J"
    assert found[energy] == 0.0 < first[energy]
    with np.load(tmp_path / "history.npz") as history:
        assert not history["reduced_work"].any()
        # the model stays in the equilibrium of the preload
        assert np.ptp(history["reduced_displacement"], axis=0).max() < 1e-12
        assert history["reduced_time"][-1] == pytest.approx(2 / 3.0)


def test_folder_of_a_stored_model_alone_repeats_its_run(results, tmp_path, monkeypatch):
    """The folder is moved away from its model and mesh; the command of its report is run there."""
    model = tmp_path / "models" / "blade.npz"
    model.parent.mkdir()
    shutil.copyfile(results / "reduced_model.npz", model)
    first, moved = tmp_path / "first", tmp_path / "far" / "moved"
    call = ["run", "--from", str(model), *NO_PICTURES, "--set", "loads.0.force=90"]
    assert main([*call, "--output", str(first)]) == 0
    record = json.loads((first / "provenance.json").read_text())
    copied = {"file": str(model), "sha256": checksum(model), "copy": "reduced_model.npz"}
    assert record["model"] == copied and copied["copy"] in record["results"]
    assert record["overrides"] == ["output.pictures=false", "loads.0.force=90"]
    scene = (first / "scene.toml").read_text()
    (first / "scene.toml").write_text(scene.replace("/beam2d.geo", "/gone/beam2d.geo"))
    shutil.rmtree(model.parent)
    shutil.copytree(first, moved)
    shutil.rmtree(first)
    monkeypatch.chdir(moved)
    assert main(shlex.split(record["repeat"])[1:]) == 0
    again = moved / "out" / "moved"  # named after the folder of the scene
    with np.load(moved / "history.npz") as one, np.load(again / "history.npz") as two:
        assert set(one.files) == set(two.files)
        for name in one.files:
            np.testing.assert_array_equal(two[name], one[name])


def test_results_of_another_scene_are_replaced_by_force_only(results, tmp_path, capsys):
    model, folder = str(results / "reduced_model.npz"), tmp_path / "out"
    call = ["run", "--from", model, "--output", str(folder), *NO_PICTURES]
    assert main(call) == 0 and main(call) == 0
    before = (folder / "summary.json").read_bytes()
    other = [*call, "--set", "loads.0.force=90"]
    assert main(other) == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.startswith(f"fenicsrom: --output {folder}: ") and "--force" in message
    assert (folder / "summary.json").read_bytes() == before
    assert main([*other, "--force"]) == 0
    assert (folder / "summary.json").read_bytes() != before


@pytest.mark.parametrize("command", ["response", "backbone", "statics", "campbell", "map"])
def test_scene_is_refused_before_the_output_folder_is_opened(command, monkeypatch, tmp_path):
    def opened(*args, **settings):
        raise AssertionError("with --force, opening removes the results of another scene")

    monkeypatch.setattr("fenicsrom.study.output_folder", opened)
    assert main([command, str(SCENE), "--output", str(tmp_path), "--force"]) == 2


def test_output_that_vanishes_with_the_container_is_refused(tmp_path, capsys, monkeypatch):
    from fenicsrom.cli import output

    mounts = tmp_path / "mounts"
    mounts.write_text("1 0 8:1 / / rw - overlay x rw\n2 1 8:1 /a /src rw - ext4 y rw\n")
    monkeypatch.setattr(output, "MOUNTS", mounts)
    monkeypatch.setenv(output.CONTAINER, "give a mounted folder")
    assert main(["run", str(SCENE), "--output", str(tmp_path / "out"), *QUICK]) == 2
    assert "give a mounted folder" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    for command in (["inspect", str(BEAM)], ["plan", str(SCENE)], ["schema"]):
        option = "--picture" if command[0] == "plan" else "--output"
        assert main([*command, option, str(tmp_path / "out")]) == 2
        assert f"{option} {tmp_path / 'out'}: " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    mounts.write_text(f"{mounts.read_text()}3 1 8:1 /b {tmp_path} rw - ext4 y rw\n")
    monkeypatch.setattr("fenicsrom.study.stored.run", interrupted)
    assert main(["run", str(SCENE), "--output", str(tmp_path / "out")]) == 130


def test_plan_draws_the_setup_without_an_equilibrium(tmp_path, capsys, monkeypatch):
    from matplotlib.image import imread

    from fenicsrom.fem.solid.solid import Solid

    monkeypatch.setattr(Solid, "_find_equilibrium", None)
    path = tmp_path / "plan.png"
    assert main(["plan", str(SCENE), "--picture", str(path)]) == 0
    said = capsys.readouterr()
    assert "full motion" in said.out and said.out.splitlines()[-1].strip() == str(path)
    assert said.err.splitlines() == ["mesh ..", "supports, loads and contacts .."]
    assert list(tmp_path.iterdir()) == [path] and (imread(path)[..., :3] < 0.9).any()
    assert main(["plan", str(SCENE), "--picture", str(tmp_path)]) != 0


def test_folder_of_a_run_stands_for_the_model_in_it(tmp_path):
    options = make_parser().parse_args(["run", "--from", str(tmp_path)])
    assert options.stored == tmp_path / "reduced_model.npz"
    named = make_parser().parse_args(["run", "--from", str(tmp_path / "a.npz")])
    assert named.stored == tmp_path / "a.npz"


def test_plan_says_the_unit_of_a_region_and_refuses_what_a_run_refuses(capsys):
    region = ["--set", "contacts.0.at='nodes'"]
    assert main(["plan", str(SCENE), *region]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "contacts[0].normal_stiffness = 10000 N/m per m² of facets" in lines
    assert "unknowns: 240, 3 contact points" in lines
    assert main(["plan", str(SCENE), "--set", "supports.0.group='nowhere'"]) == 2
    said = capsys.readouterr()
    assert "nowhere" in said.err and "reduced motion" in said.out and "unknowns" not in said.out


def test_run_of_stored_model_warns_of_given_keys_only(results, tmp_path, capsys):
    """The stored scene has reference.full, reference.beam and output.motion."""
    call = ["run", "--from", str(results / "reduced_model.npz"), *NO_PICTURES]
    assert main([*call, "--output", str(tmp_path / "one")]) == 0
    assert "no effect" not in capsys.readouterr().out
    given = [*call, "--set", "reference.full=true", "--set", "output.motion=false"]
    assert main([*given, "--output", str(tmp_path / "two")]) == 0
    (warning,) = [line for line in capsys.readouterr().out.splitlines() if "no effect" in line]
    assert "reference.full has no effect" in warning


@pytest.mark.parametrize(
    "command",
    [
        ["plan", "{scene}", "--picture", "{scene}"],
        ["export", "{scene}", "--format", "inp", "--output", "{scene}"],
        ["export", "{model}", "--format", "mat", "--output", "{model}"],
        ["export", "{model}", "--format", "mat", "--output", "{folder}/scene.mat"],
    ],
)
def test_command_does_not_replace_files_that_it_reads_or_others(results, tmp_path, capsys, command):
    names = {"scene": tmp_path / "scene.toml", "model": tmp_path / "model.npz", "folder": tmp_path}
    names["scene"].write_bytes(SCENE.read_bytes())
    names["model"].write_bytes((results / "reduced_model.npz").read_bytes())
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert main([word.format(**names) for word in command]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_number_that_the_curves_vary_is_refused_as_an_override(tmp_path, capsys):
    call = ["response", str(DEMOS / "response_2d.toml"), "--output", str(tmp_path / "out")]
    assert main([*call, "--set", "loads[0].force=3"]) == 2  # response.families.key
    assert "loads.0.force: --set has no effect" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run", "modes", "response", "map", "statics", "sweep"])
def test_command_without_dolfinx_says_so(tmp_path, capsys, monkeypatch, command):
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    varied = ["--over", "loads.0.force=[100,110]"] if command == "sweep" else []
    assert main([command, str(SCENE), "--output", str(tmp_path / "out"), *varied]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "needs dolfinx" in line and "--from" in line


def interrupted(*_, folder=None, **__):
    """A run that is interrupted; the name of the folder says what it has kept."""
    kept = {"kept": "checkpoint.npz", "model": "reduced_model.npz"}
    if folder.name in kept:
        (folder / kept[folder.name]).write_text("")
    raise KeyboardInterrupt


def test_interrupted_run_says_how_to_continue(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("fenicsrom.study.stored.run", interrupted)
    call = ["run", str(SCENE), "--set", "basis.modes=1", "--output"]
    assert main([*call, str(tmp_path / "kept")]) == 130
    words = f"fenicsrom {' '.join(call)} {tmp_path / 'kept'} --resume {tmp_path / 'kept'}"
    assert f"to continue: {words}/checkpoint.npz" in capsys.readouterr().err
    assert main([*call, str(tmp_path / "model")]) == 130
    words = f"--from {tmp_path / 'model'}/reduced_model.npz --output {tmp_path / 'model'}_reduced"
    assert f"to run this model: fenicsrom run {words};" in capsys.readouterr().err
    assert main([*call, str(tmp_path / "nothing")]) == 130
    assert "run the command again" in capsys.readouterr().err
    assert not (tmp_path / "nothing").exists()


@pytest.mark.slow
def test_picture_that_fails_becomes_a_warning(results, tmp_path, capsys, monkeypatch):
    from fenicsrom.post.run import motion_figures

    def broken(*_, **__):
        raise ValueError("no axes")

    monkeypatch.setattr(motion_figures.figures, "plot_motion", broken)
    model = str(results / "reduced_model.npz")
    assert main(["run", "--from", model, "--output", str(tmp_path)]) == 0
    sentence = "motion.png was not drawn: ValueError: no axes"
    assert f"warning: {sentence}" in capsys.readouterr().out
    assert sentence in (tmp_path / "report.html").read_text()
    assert not (tmp_path / "motion.png").exists() and (tmp_path / "energy.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["pictures", "report"])
def test_run_that_fails_at_pictures_keeps_numbers(tmp_path, monkeypatch, stage):
    """The numbers are complete before the first picture is drawn."""
    from fenicsrom.post.run import pictures, report

    def full(*_):
        raise OSError(28, "No space left on device", "a picture")

    if stage == "pictures":
        monkeypatch.setattr(pictures, "write_pictures", full)
    else:
        monkeypatch.setattr(report, "write_run_report", full)
    on = ["--set", f"output.pictures={str(stage == 'pictures').lower()}"]
    assert main(["run", str(SCENE), "--output", str(tmp_path), *QUICK, *on]) == 1
    assert json.loads((tmp_path / "summary.json").read_text())["response"]["reduced"]
    for name in ("history.npz", "checkpoint.npz", "reduced_model.npz"):
        with np.load(tmp_path / name) as file:
            assert file.files


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("material.young=1e9", "material.young"),
        ("contacts.0.normal=[0.0, 1.0]", "contacts[0].normal"),
        ("basis.modes=2", "basis.modes"),
        ("loads.0.colour=1", "loads[0].colour"),
    ],
)
def test_stored_model_with_changed_structure_is_refused(results, tmp_path, capsys, override, key):
    model = str(results / "reduced_model.npz")
    assert main(["run", "--from", model, "--output", str(tmp_path), "--set", override]) == 2
    assert capsys.readouterr().err.startswith(f"fenicsrom: {model}: {key}")


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["material.yung=1"], ["material.yung", "young"]),
        (["material.poisson=0.5"], ["material.poisson", "0.5"]),
        (["geometry.mesh='nothing.geo'"], ["geometry.mesh", "nothing.geo"]),
        (["contacts.0.group='tap'"], ["tap", "tip"]),
        (["contacts.0.group='root'"], ["contacts[0]", "clamped"]),
    ],
)
def test_wrong_value_is_refused_in_one_sentence(tmp_path, capsys, overrides, words):
    arguments = [part for override in overrides for part in ("--set", override)]
    assert main(["run", str(SCENE), "--output", str(tmp_path), *QUICK, *arguments]) == 2
    message = capsys.readouterr().err
    sentences = [line for line in message.splitlines() if line.startswith("fenicsrom: ")]
    assert len(sentences) == 1 and "Traceback" not in message
    for word in words:
        assert word in sentences[0]
    assert not list(tmp_path.iterdir())


def test_failed_integration_keeps_motion_and_exits_1(tmp_path, capsys, monkeypatch):
    """Exit code 1, a sentence that says when and where, and the history up to there."""
    from fenicsrom.online.model.matrices import DenseModel

    def lose_mass(model, begin, end):
        model.mass.fill(np.nan)

    # of the beam only: a changed constant would stay in the kernels that are compiled here
    monkeypatch.setattr(DenseModel, "set_interval", lose_mass)
    arguments = ["--set", "reference.beam=true", "--output", str(tmp_path), *QUICK, *NO_PICTURES]
    assert main(["run", str(SCENE), *arguments]) == 1
    assert "time integration stopped at t = " in capsys.readouterr().err
    found = json.loads((tmp_path / "summary.json").read_text())
    assert found["unfinished"]["model"] == "beam"
    assert "reduced" in found["response"]
    with np.load(tmp_path / "history.npz") as history:
        assert "beam_time" in history


@pytest.mark.parametrize("below", [(), ("folder",)])
def test_output_folder_that_is_a_file_or_in_one_is_refused(tmp_path, capsys, below):
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert main(["run", str(SCENE), "--output", str(blocked.joinpath(*below)), *QUICK]) == 2
    printed = capsys.readouterr().err
    assert str(blocked) in printed and len(printed.splitlines()) == 1


def test_interrupt_during_the_imports_ends_with_a_sentence():
    """The commands are imported when the program starts, which takes a fifth of a second."""
    program = (
        "import sys\n"
        "class Interrupting:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'fenicsrom.cli.commands':\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupting())\n"
        "from fenicsrom.cli import main\n"
        "sys.exit(main(['plan', sys.argv[1]]))\n"
    )
    done = fresh_python(program, str(SCENE), code=130)
    assert done.stderr == "fenicsrom: interrupted\n"


@pytest.mark.slow
def test_run_of_stored_model_imports_no_slow_module(results, tmp_path):
    program = (
        "import sys\n"
        "from fenicsrom.cli import main\n"
        "code = main(sys.argv[1:])\n"
        "slow = 'scipy.signal', 'scipy.stats', 'xml.sax', 'matplotlib', 'mpi4py'\n"
        "print([name for name in slow if name in sys.modules])\n"
        "sys.exit(code)\n"
    )
    model = str(results / "reduced_model.npz")
    arguments = ["run", "--from", model, "--output", str(tmp_path), *NO_PICTURES]
    done = fresh_python(program, *arguments)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("command", [["--help"], ["schema"]])
def test_light_command_imports_no_heavy_module(command):
    program = (
        "import sys, contextlib\n"
        "from fenicsrom.cli import main\n"
        "with contextlib.suppress(SystemExit):\n"
        "    main(sys.argv[1:])\n"
        "heavy = {'numpy', 'scipy', 'numba', 'dolfinx', 'mpi4py', 'matplotlib', 'pyvista'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    done = fresh_python(program, *command)
    assert done.stdout.splitlines()[-1] == "[]"
    assert len(done.stdout.splitlines()) > 1


@pytest.mark.slow
def test_linear_scene_without_contact_skips_everything_else(tmp_path):
    """A linear scene without contact: no static modes, derivatives, polynomial, pictures, ParaView
    files or heavy imports."""
    program = (
        "import sys\n"
        "from fenicsrom.cli import main\n"
        "code = main(sys.argv[1:])\n"
        "heavy = {'pyvista', 'matplotlib', 'meshio'} & set(sys.modules)\n"
        "print(sorted(heavy), file=sys.stderr)\n"
        "sys.exit(code)\n"
    )
    off = """
        geometrically_nonlinear=false contacts=[] probe={group='tip'} reference.beam=false
        output.pictures=false output.paraview=false
    """.split()
    sets = [p for o in off for p in ("--set", o)]
    arguments = ["run", str(SCENE), "--output", str(tmp_path), *QUICK, *sets]
    done = fresh_python(program, *arguments)
    assert done.stderr.splitlines()[-1] == "[]"
    found = json.loads((tmp_path / "summary.json").read_text())
    assert found["basis"]["labels"] == ["1V", "1L"]  # the mode lacks a part of the static response
    assert (
        found["response"]["reduced"]["newton_iterations"] == found["response"]["reduced"]["steps"]
    )
    assert not {"contact.png", "normal_modes.vtu"} & {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_readme_table_matches_run(tmp_path, capsys):
    """Every column but the last, whose rounding errors differ from machine to machine."""
    arguments = ["--output", str(tmp_path), *NO_PICTURES, "--set", "output.paraview=false"]
    assert main(["run", str(SCENE), *arguments]) == 0
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    readme = [
        line.split()
        for line in (DEMOS.parent / "README.md").read_text().splitlines()
        if line.startswith("    ")
    ]

    def table(lines):
        return {
            line[0]: line[1:11]
            for line in lines
            if line and line[0] in ("reduced", "full", "beam") and len(line) == 12
        }

    assert table(readme) == table(printed) and len(table(readme)) == 3
    errors = json.loads((tmp_path / "summary.json").read_text())["estimated_error_percent"]
    assert 1e-3 < errors["time step"] < 1.0 and errors["basis"] < 0.01


def test_modes_command_prints_frequencies_and_writes_shapes(tmp_path, capsys):
    assert main(["modes", str(SCENE), "--output", str(tmp_path), *NO_PICTURES]) == 0
    assert "1V 3.28" in " ".join(capsys.readouterr().out.split())
    assert (tmp_path / "derivatives.vtu").exists() and not (tmp_path / "history.npz").exists()


@pytest.mark.slow
def test_interrupted_run_leaves_only_complete_files(tmp_path):
    """SIGINT during a long run gives exit code 130, and every file can be read."""
    arguments = ["-m", "fenicsrom", "run", str(SCENE), "--output", str(tmp_path)]
    arguments += ["--set", "time.steps_per_period=2000"]
    process = subprocess.Popen(
        [sys.executable, *arguments], stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    )
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("full motion"):
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors
    # the model is written before the motion
    record = {"scene.toml", "provenance.json", "beam2d.geo"}
    left = {path.name for path in tmp_path.iterdir()}
    kept = {"reduced_model.npz", "checkpoint.npz", "history.npz", "summary.json"}
    assert left - record == kept and record <= left
    assert json.loads((tmp_path / "provenance.json").read_text())["state"] == "interrupted"
    assert "not checked" in errors and f"--resume {tmp_path / 'checkpoint.npz'}" in errors


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.long)],
)
def test_signal_ends_a_long_call_of_gmsh(number, code, tmp_path):
    """The folder is as after a killed run: the next run takes it."""
    out = ["run", str(SCENE), "--output", str(tmp_path), *QUICK]
    command = [sys.executable, "-m", "fenicsrom", *out]
    long = ["--set", "geometry.parameters.elements_along=2e7"]
    with subprocess.Popen([*command, *long], stderr=subprocess.PIPE, text=True) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")

        def spent() -> int:
            """CPU time of the process that computes, in ticks."""
            stat = Path("/proc", children.read_text().split()[0], "stat").read_text()
            return sum(map(int, stat.rsplit(")")[-1].split()[11:13]))

        while process.poll() is None and not (tmp_path / "provenance.json").exists():
            time.sleep(0.1)
        begun, second = spent(), os.sysconf("SC_CLK_TCK")  # in which gmsh begins
        while process.poll() is None and spent() < begun + 2 * second:
            time.sleep(0.1)
        process.send_signal(number)
        try:
            _, errors = process.communicate(timeout=10)
        finally:
            process.kill()
    assert process.returncode == code
    assert errors.splitlines()[-1].startswith("fenicsrom: ") and "Traceback" not in errors
    assert json.loads((tmp_path / "provenance.json").read_text())["state"] == "running"
    assert not (tmp_path / "summary.json").exists()
    assert main([*out, "--set", "geometry.parameters.elements_along=4", "--force"]) == 0


def test_plan_names_its_command_and_those_of_the_other_tables(capsys):
    command = ["plan", str(SCENE), "--set", "statics.last=2.0"]
    assert main(command) == 0
    first, *others = capsys.readouterr().out.splitlines()
    assert first == f"fenicsrom run {SCENE}:"
    compare, statics, refused, *cost = [
        line for line in others if not line.startswith(("runs ", "left out "))
    ]
    assert f"fenicsrom compare {SCENE}" in compare and f"fenicsrom statics {SCENE}" in statics
    assert "loads: a static load of a size other than 0 is needed" in refused
    assert cost[0] == "unknowns: 240, 1 contact point" and len(cost) == 3
    least, most = (int(word.rstrip(":")) for word in cost[1].split()[2:5:2])
    assert least <= 10 <= most  # that of the README


def test_plan_warns_of_what_a_run_warns(capsys):
    assert main(["plan", str(SCENE), "--set", "geometry.degree=1"]) == 0
    assert "warning: linear elements lock" in capsys.readouterr().out
