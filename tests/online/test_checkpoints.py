"""Checkpoints: a resumed run equals the uninterrupted run bit for bit, and files of another run are
refused."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from contact_cases import casing
from support import beam_scene, linear_model, one_contact, random_model, refusal

from fenicsrom.cli import main
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.contact.state import OPEN, SLIP, STICK
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run import simulate
from fenicsrom.online.run.march import integrate
from fenicsrom.online.step.state import Checkpoint
from fenicsrom.online.store.scene_changes import changed_run_key
from fenicsrom.online.store.store import fingerprint, load_start, save_checkpoint
from fenicsrom.post.run.summary import write_checkpoint
from fenicsrom.scene import Scene, Time

DEMOS = Path(__file__).parents[2] / "demos"
SCENE = DEMOS / "slip_liftoff_2d.toml"
PERIOD = 2 * np.pi / 1.1
FIELDS = """
    time displacement force mean_force gap state kinetic elastic contact_energy work
    damping_dissipation friction_dissipation point_friction_dissipation
""".split()


def rubbing(surface: str) -> tuple[ReducedModel, Contacts]:
    """A nonlinear model that sticks, slips and lifts off: at a plane, or in a casing that closes in
    and turns."""
    model = random_model(3, seed=5, masters=2, damping=0.2, force=2.0, omega=1.1)
    if surface == "plane":
        return model, one_contact(
            preload=0.3, normal_stiffness=5.0, tangential_stiffness=8.0, friction=0.6
        )
    one, count = np.ones(1), PERIOD * 6.0
    curved = casing(2, spin=0.3)._replace(
        preload=0.0 * one,
        normal_stiffness=5.0 * one,
        tangential_stiffness=8.0 * one,
        friction=0.6 * one,
        centre=np.array([[-1.5, 0.0]]),
        radius=1.7 * one,
        times=np.array([0.0, count]),
        approach=np.array([[0.0, 0.15]]),
    )
    return model, curved


def scene_of(settings: Time) -> Scene:
    """A scene with these settings and the period of the model, for the file."""
    return replace(beam_scene(2, (f"loads.0.frequency={1.0 / PERIOD!r}",)), time=settings)


class Stop(Exception):
    """Stops the run."""


def stopped(
    model: Any, contacts: Contacts, settings: Time, period: float | None, after: int, keep: Any
) -> None:
    """Run until the checkpoint of this number, counted from one, and return this checkpoint."""
    count = 0

    def checkpoint(here: Checkpoint) -> None:
        nonlocal count
        count += 1
        if count == after:
            keep(here)
            raise Stop

    with pytest.raises(Stop):
        integrate(Problem(model, contacts, settings, period), checkpoint=checkpoint)


def assert_continued(motion: Motion, whole: Motion) -> None:
    """A resumed motion equals the end of the uninterrupted motion, bit for bit."""
    rows = motion.time.size
    assert 10 < rows < whole.time.size
    for name in FIELDS:
        np.testing.assert_array_equal(
            getattr(motion, name), getattr(whole, name)[-rows:], err_msg=name
        )
    for name in ("steady", "periods", "steps", "rejected", "newton_iterations", "buckled"):
        assert getattr(motion, name) == getattr(whole, name), name
    for one, two in zip(_state(motion), _state(whole), strict=True):
        np.testing.assert_array_equal(one, two)


def _state(motion: Motion) -> list[Any]:
    state = motion.end.state
    return [*state._replace(contact=0.0, trial=0.0), *state.contact]


@pytest.mark.parametrize(
    ("scheme", "surface", "settings"),
    [
        ("average-acceleration", "plane", {"tolerance": 1e-3}),
        ("generalised-alpha", "casing", {"steps_per_period": 50}),
        ("discrete-gradient", "casing", {"tolerance": 1e-3}),
    ],
)
def test_run_resumed_after_three_periods_equals_the_whole_run_bit_for_bit(
    scheme: str, settings: dict[str, Any], surface: str, tmp_path: Path
) -> None:
    model, contacts = rubbing(surface)
    radius = 0.8 if scheme == "generalised-alpha" else None
    wanted = Time.of(
        scheme=scheme, periods=7, steady_tolerance=0.0, spectral_radius=radius, **settings
    )
    path = tmp_path / "checkpoint.npz"
    scene = scene_of(wanted)
    whole = integrate(Problem(model, contacts, wanted, PERIOD))
    assert {OPEN, SLIP} <= set(whole.state[whole.time > 3 * PERIOD].ravel())
    assert surface == "casing" or STICK in whole.state
    stopped(
        model, contacts, wanted, PERIOD, 3, lambda here: save_checkpoint(path, model, scene, here)
    )
    motion = integrate(
        Problem(model, contacts, wanted, PERIOD), resume=load_start(path, model, scene)
    )
    assert_continued(motion, whole)
    assert motion.time[0] == pytest.approx(2 * PERIOD, rel=0.05)
    # more periods than were asked for at first; and that the checkpoint was of use: from rest it is
    # another motion
    first = wanted.changed(periods=3)
    short = integrate(Problem(model, contacts, first, PERIOD))
    assert write_checkpoint(tmp_path, model, scene_of(first), short) == [path]
    longer = integrate(
        Problem(model, contacts, wanted, PERIOD), resume=load_start(path, model, scene)
    )
    assert_continued(longer, whole)


@pytest.mark.parametrize(
    "settings", [{"step": 0.01}, {"tolerance": 1e-5}], ids=["fixed", "adaptive"]
)
def test_resumed_run_of_a_duration_equals_the_whole_run_bit_for_bit(
    settings: dict[str, Any], tmp_path: Path
) -> None:
    model, contacts = rubbing("casing")
    wanted = Time.of(scheme="discrete-gradient", duration=60.0, **settings)
    scene = replace(scene_of(wanted), loads=())
    whole = integrate(Problem(model, contacts, wanted, None))
    path = tmp_path / "checkpoint.npz"
    stopped(
        model, contacts, wanted, None, 1, lambda here: save_checkpoint(path, model, scene, here)
    )
    motion = integrate(
        Problem(model, contacts, wanted, None), resume=load_start(path, model, scene)
    )
    assert 0.0 < motion.time[0] < motion.time[-1] == 60.0
    assert_continued(motion, whole)


@pytest.mark.slow
def test_resumed_run_of_the_full_model_equals_the_whole_run_bit_for_bit() -> None:
    pytest.importorskip("dolfinx")
    from support import make_solid

    from fenicsrom.fem.full.full import FullModel

    scene = beam_scene(
        2,
        (
            "time.periods=4",
            "time.steps_per_period=40",
            "time.steady_tolerance=0",
            "geometry.parameters.elements_along=6",
        ),
    )
    model, kept = FullModel(make_solid(scene)), []
    whole = simulate.simulate(model, scene)
    simulate.simulate(model, scene, checkpoint=lambda here: kept.append(copy.deepcopy(here)))
    motion = simulate.simulate(model, scene, resume=kept[1])
    assert_continued(motion, whole)


# ------------------------------------------------------------------ the file


@pytest.fixture
def stored(tmp_path: Path) -> tuple[Path, ReducedModel, Scene]:
    """A checkpoint after two of three periods."""
    model, contacts = rubbing("plane")
    settings = Time.of(periods=3, steady_tolerance=0.0, steps_per_period=20)
    scene, path = scene_of(settings), tmp_path / "checkpoint.npz"
    stopped(
        model, contacts, settings, PERIOD, 2, lambda here: save_checkpoint(path, model, scene, here)
    )
    return path, model, scene


def test_fingerprint_depends_on_every_array_of_the_model() -> None:
    model, _ = rubbing("plane")
    model = model._replace(velocity_matrix=np.zeros_like(model.mass))
    known = {fingerprint(model)}
    for name in ("mass", "loads", "contact_rows", "contact_offset", "probe", "probe_offset"):
        known.add(fingerprint(model._replace(**{name: getattr(model, name) + 1.0})))
    known.add(fingerprint(model._replace(velocity_matrix=model.velocity_matrix + 1.0)))
    for field in ("elastic", "points"):
        part = getattr(model, field)
        for name, array in part._asdict().items():
            changed = part._replace(**{name: np.append(array, np.ones_like(array[:1]), axis=0)})
            known.add(fingerprint(model._replace(**{field: changed})))
    assert len(known) == 1 + 7 + len(model.elastic) + len(model.points)


def test_checkpoint_of_another_model_or_scene_is_refused(
    stored: tuple[Path, ReducedModel, Scene],
) -> None:
    path, model, scene = stored
    load_start(path, model, scene)
    load_start(
        path, model._replace(load_histories=linear_model(1.0, 1.0).load_histories), scene
    )  # those are the scene's
    for name in ("mass", "loads", "contact_rows", "probe"):
        other = model._replace(**{name: np.nextafter(getattr(model, name), 9.0)})
        with refusal(ErrorKind.MISMATCH, ""):
            load_start(path, other, scene)
    changes = {
        "friction=0.4": "contacts",
        "force=100": "loads",
        "frequency=3.3": "loads",
        "scheme='average-acceleration'": "time.scheme",
        "steps_per_period=21": "time.steps_per_period",
        "mass_damping=4": "material",
    }
    tables = {"contacts": "contacts.0.", "loads": "loads.0.", "material": "material."}
    for change, key in changes.items():
        changed = tables.get(key, "time.") + change
        other = beam_scene(2, (f"loads.0.frequency={1.0 / PERIOD!r}", changed))
        if not key.startswith("time"):
            other = replace(other, time=scene.time)
        else:
            name = key.split(".")[1]
            other = replace(other, time=scene.time.changed(**{name: getattr(other.time, name)}))
        with refusal(ErrorKind.MISMATCH, key):
            load_start(path, model, other)
    damped = {"scheme": "generalised-alpha", "spectral_radius": 0.8}
    made = replace(scene, time=scene.time.changed(**damped))
    assert changed_run_key(made, made) is None
    other = replace(made, time=made.time.changed(spectral_radius=0.7))
    assert changed_run_key(made, other) == "time.spectral_radius"
    for ends in ({"periods": 9}, {"steady_tolerance": 0.1}):
        load_start(path, model, replace(scene, time=scene.time.changed(**ends)))
    with refusal(ErrorKind.RANGE, "time.periods"):
        load_start(path, model, replace(scene, time=scene.time.changed(periods=2)))


# ------------------------------------------------------------------ the command


QUICK = """
    --set time.steady_tolerance=0 --set basis.modes=1 --set reference.full=false --set
    reference.beam=false --set output.pictures=false --set output.paraview=false
""".split()


def history(folder: Path) -> dict[str, Any]:
    with np.load(folder / "history.npz") as file:
        return {name: file[name] for name in file.files}


@pytest.mark.slow
def test_command_resumes_from_stored_model_and_from_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the stored model, and from the scene, whose model is built again."""
    pytest.importorskip("dolfinx")
    short, long = (["--set", f"time.periods={count}"] for count in (3, 7))
    for folder, periods in (("three", short), ("seven", long)):
        assert main(["run", str(SCENE), "--output", str(tmp_path / folder), *QUICK, *periods]) == 0
    assert "Resumed run" not in capsys.readouterr().out
    resume = ["--resume", str(tmp_path / "three" / "checkpoint.npz")]
    stored = ["--from", str(tmp_path / "three" / "reduced_model.npz")]
    whole = history(tmp_path / "seven")
    for call in ([*stored, *resume, *long], [str(SCENE), *resume, *QUICK, *long]):
        assert main(["run", *call, "--output", str(tmp_path / "on")]) == 0
        assert "Resumed run: the output starts at 0.62656" in capsys.readouterr().out
        found = history(tmp_path / "on")
        assert found["reduced_time"].size == 5 * 200
        for name, array in found.items():
            np.testing.assert_array_equal(array, whole[name][-len(array) :], err_msg=name)
    wrong = {
        "time.periods = 3: the run already reached period": [*stored, *resume],
        "contacts: differs from the scene of the run": [
            *stored,
            *resume,
            *long,
            "--set",
            "contacts.0.friction=0.1",
        ],
        "--resume also needs the scene file or --from MODEL": resume,
    }
    for sentence, call in wrong.items():
        assert main(["run", *call, "--output", str(tmp_path / "wrong")]) == 2
        assert sentence in capsys.readouterr().err


def test_truncated_checkpoint_is_refused(stored: tuple[Path, ReducedModel, Scene]) -> None:
    path, model, scene = stored
    sound = path.read_bytes()
    for cut in (0, len(sound) // 2, len(sound) - 1):
        path.write_bytes(sound[:cut])
        with pytest.raises(SceneError, match=r"^\S*checkpoint\.npz: [^\n]*$"):
            load_start(path, model, scene)
