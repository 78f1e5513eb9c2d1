"""One model for a range of speeds against beam theory, the solid at each speed, and its motion."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.linalg

pytest.importorskip("dolfinx")

from support import beam_scene, make_solid, refusal

import fenicsrom
from fenicsrom.arrays import Array
from fenicsrom.assess.curves.response_problem import family_of, start_motion
from fenicsrom.assess.errors.comparisons import of_model
from fenicsrom.assess.errors.estimates import distances
from fenicsrom.assess.errors.sizing import fitted
from fenicsrom.assess.rotation.rotating_modes import RangeBody, modes_at_speed
from fenicsrom.assess.rotation.run_up import run_up
from fenicsrom.cli import main
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.solid import finer
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.online.contact.surfaces import speed_history
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.model.subspace import shifted
from fenicsrom.online.model.turning import rest_row
from fenicsrom.online.motion.measures import amplitude, peak_normal_force, wear_of
from fenicsrom.online.periodic.shooting import periodic_motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import StoredModel, load_model, model_contents, save_model
from fenicsrom.online.store.store import VARIABLE
from fenicsrom.reduction import joined
from fenicsrom.reduction.basis import ReducedBasis, project
from fenicsrom.scene import Damping, Scene, read_scene
from fenicsrom.study import execution

pytestmark = pytest.mark.slow

DEMO = Path(__file__).parents[2] / "demos" / "blade_rub.toml"
RPM = 30.0 / np.pi
UNSTRESSED = ("output.stresses='none'", "output.motion=false", "output.animation=false")
UNDRAWN = ("--set", "output.pictures=false")
BLADE = (*UNSTRESSED, "rotation.speeds_rpm=[0.0, 3000.0, 6000.0]", "rotation.coriolis=true")
TINY = """
    geometry.parameters.elements_along=4 geometry.parameters.elements_across=1
    contacts.0.gap=0.9e-3 time.steps_per_period=100 time.periods=3 time.steady_tolerance=0.0
""".split()


def blade(*overrides: str) -> Scene:
    """The blade of the demo, rotating in a range of speeds."""
    return read_scene(DEMO, (*BLADE, *overrides))


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> tuple[StoredModel, Path]:
    """The model of a coarse blade for all speeds up to 6000 rpm, and its file."""
    stored = fenicsrom.build_model(blade(*TINY))
    path = tmp_path_factory.mktemp("range") / "reduced_model.npz"
    save_model(path, stored)
    return stored, path


@pytest.fixture
def unjudged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bodies count as too large for finer elements, which cost most of a model."""
    monkeypatch.setattr(finer, "LARGEST", 0)


def test_model_for_all_speeds_comes_from_the_cache_bit_for_bit(
    tiny: tuple[StoredModel, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """--fresh, another damping and several processes do not take the model of the cache."""
    built = []
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    monkeypatch.setattr(execution, "build_range", lambda *_: built.append(1) or tiny[0])
    scene = blade(*TINY)
    first, second = fenicsrom.build_model(scene), fenicsrom.build_model(scene)
    assert len(built) == 1
    assert second.scene is scene and second.file == ""
    (_, ours), (_, theirs) = model_contents(first), model_contents(second)
    assert ours.keys() == theirs.keys()
    for name, array in ours.items():
        np.testing.assert_array_equal(theirs[name], array, err_msg=name)
    motions = first.simulate(), second.simulate()
    np.testing.assert_array_equal(motions[1].displacement, motions[0].displacement)
    fenicsrom.build_model(scene, fresh=True)
    fenicsrom.build_model(blade(*TINY, "material.mass_damping=1.0"))
    fenicsrom.build_model(scene, comm=SimpleNamespace(size=2))  # which `build_range` refuses
    assert len(built) == 4


LENGTH = 2.54  # m
UNIT = float(np.sqrt(207e9 * 0.0254**2 / 12.0 / (7801.0 * LENGTH**4)))  # rad/s


def cantilever(etas: tuple[float, ...], hub: float = 0.0, modes: int = 4) -> Scene:
    """A slender beam that turns at speeds Omega = eta UNIT, with a hub of the radius hub LENGTH."""
    return beam_scene(
        3,
        ("geometry.parameters.elements_along=40", "material.poisson=0.0"),
        contacts=None,
        rotation={
            "speed_rpm": 0.5 * (etas[0] + etas[-1]) * UNIT * RPM,
            "axis": [0.0, 0.0, 1.0],
            "point": [-hub * LENGTH, 0.0, 0.0],
            "speeds_rpm": [eta * UNIT * RPM for eta in etas],
        },
        basis={"modes": modes},
    )


def at_one_speed(scene: Scene) -> Scene:
    """A scene at its `rotation.speed_rpm` only."""
    assert scene.rotation is not None
    return replace(scene, rotation=replace(scene.rotation, speeds_rpm=None))


def at_speed(stored: StoredModel, rpm: float, *more: str) -> StoredModel:
    """The model at another speed."""
    return stored.with_overrides([f"rotation.speed_rpm={rpm}", *more])


@pytest.mark.usefixtures("unjudged")
@pytest.mark.parametrize(
    ("hub", "flaps", "higher", "allowed"),
    [
        (
            0.0,
            (7.36037, 11.20233, 15.14936),
            ((26.80908, 66.68391), (33.64037, 74.64929), (41.78667, 85.06698)),
            1.5e-4,
        ),
        # the solid stretches by 1e-4 at eta = 14
        (
            1.0,
            (10.44387, 16.60636, 22.84529),
            ((32.02724, 72.98634), (44.36822, 89.15633), (57.95041, 108.40773)),
            4e-4,
        ),
    ],
)
def test_rotating_cantilever_between_two_speeds_matches_beam_theory(
    hub: float, flaps: tuple[float, ...], higher: Any, allowed: float
) -> None:
    """Flap of a uniform Euler-Bernoulli cantilever, by Rayleigh-Ritz with 24 polynomials: omega L^2
    sqrt(rho A / E I) at eta = Omega L^2 sqrt(rho A / E I) of 6, 10 and 14; lag^2 = flap^2 -
    eta^2. The speeds of the basis are eta = 0 and 12; the radius of the hub is 0 or L.

    Reference: flap of a rotating cantilever at η = 6, 10, 14, model joined at 0 and 12 |
    Rayleigh–Ritz | 7.36037, 11.20233, 15.14936 | 7e-5 | 1.5e-4
    """
    scene = cantilever((0.0, 12.0), hub, modes=6)
    stored = fenicsrom.build_model(scene)
    assert stored.whole is not None
    for eta, flap, others in zip((6.0, 10.0, 14.0), flaps, higher, strict=True):
        found = 2.0 * np.pi * stored.whole.at(eta * UNIT, False, True).frequencies_hz / UNIT
        np.testing.assert_allclose([found[1], np.hypot(found[0], eta)], flap, rtol=allowed)
        # shear and rotary inertia of the solid count more
        np.testing.assert_allclose(found[[3, 5]], others, rtol=5e-4)
    assert np.max(stored.whole.errors[1:3]) < 2e-4
    solid = make_solid(at_one_speed(scene))
    solid.spin(12.0 * UNIT)  # a speed of the basis: the joined basis holds its modes
    squares, _ = solid.eigenmodes(solid.factor, 6)
    found = stored.whole.at(12.0 * UNIT, False, True)
    np.testing.assert_allclose(2.0 * np.pi * found.frequencies_hz, np.sqrt(squares), rtol=1e-6)


def errors_at(etas: tuple[float, ...], solid: Solid, eta: float) -> tuple[float, float, Array]:
    """The largest error of a frequency, the error of the elongation, and lag and flap, of the
    cantilever's model joined at `etas`, against its solid at a speed."""
    whole = fenicsrom.build_model(cantilever(etas)).whole
    assert whole is not None
    omega = eta * UNIT
    solid.spin(omega)
    squares, _ = solid.eigenmodes(solid.factor, 4)
    found = 2.0 * np.pi * whole.at(omega, False, True).frequencies_hz
    stretched = (whole.model.probe @ whole.equilibrium(omega))[0]
    elongation = stretched / (solid.probe_rows @ solid.equilibrium)[0] - 1.0
    error = float(np.max(np.abs(found / np.sqrt(squares) - 1.0)))
    return error, abs(float(elongation)), found[:2] / UNIT


@pytest.mark.usefixtures("unjudged")
def test_joined_cantilever_matches_its_solid_between_and_beyond_its_speeds() -> None:
    """Lag and flap at eta = 6 of the solid are 4.2636 and 7.3604; one speed alone misses them.

    Reference: lag and flap of a rotating cantilever at η = 6, from such a model | joined model
    of another program | 4.2638, 7.3605 | 4.26360, 7.36050 | 1.5e-4
    """
    solid = make_solid(at_one_speed(cantilever((0.0, 12.0))))
    error, elongation, found = errors_at((0.0, 12.0), solid, 6.0)
    assert error < 2e-5 and elongation < 2e-6
    np.testing.assert_allclose(found, (4.2636, 7.3604), rtol=0, atol=1.5e-4)
    error, elongation, _ = errors_at((0.0, 12.0), solid, 14.0)
    assert error < 2e-5 and elongation < 2e-6
    single = (12.0, 12.0 * (1.0 + 1e-8))  # the second speed adds nothing
    error, _, found = errors_at(single, solid, 6.0)
    assert error > 2e-3 and found[1] == pytest.approx(7.3792, abs=1e-3)


def test_expansion_about_the_unloaded_shape_loses_no_digits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Against the expansion of the solid about its equilibrium, on the same basis. The eigenvalues
    are those of the inverse problem: the rounding of the direct one is 4e-10 of the lowest
    frequencies, because its largest eigenvalue is so much larger."""
    scene, bases = blade(*TINY), list[ReducedBasis]()

    def projected(structure: Any, basis: ReducedBasis) -> ReducedModel:
        bases.append(basis)
        return project(structure, basis)

    monkeypatch.setattr(joined, "project", projected)
    solid, omega = make_solid(at_one_speed(scene)), 6000.0 / RPM
    whole = joined.range_model(solid, scene.basis, np.array([0.0, omega]))
    solid.spin(omega)
    wanted = project(solid, bases[0]).elastic.stiffness
    found = whole.tangent(omega, whole.equilibrium(omega))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    lowest = [
        scipy.linalg.eigh(whole.model.mass, tangent, eigvals_only=True)[:-5:-1]
        for tangent in (found, wanted)
    ]
    np.testing.assert_allclose(np.sqrt(lowest[0]), np.sqrt(lowest[1]), rtol=1e-11)


def test_model_at_a_speed_matches_the_solid_there(tiny: Any) -> None:
    stored, _ = tiny
    solid = make_solid(at_one_speed(blade(*TINY)))
    for rpm in (1000.0, 4500.0):
        solid.spin(rpm / RPM)
        squares, _ = solid.eigenmodes(solid.factor, 4)
        model = at_speed(stored, rpm)
        np.testing.assert_allclose(
            model.frequencies_hz, np.sqrt(squares) / (2.0 * np.pi), rtol=3e-5
        )
        tip = solid.probe_rows @ solid.equilibrium
        np.testing.assert_allclose(model.model.probe_offset, tip, rtol=0, atol=1e-6 * abs(tip[2]))
        moved = solid.contact_rows @ solid.equilibrium
        np.testing.assert_allclose(model.model.contact_offset, moved, rtol=0, atol=1e-6)
        omega, body = rpm / RPM, RangeBody(stored.whole, rpm / RPM)
        whirling, _, _ = modes_at_speed(body, 4)
        wanted, _, _ = modes_at_speed(solid, 4)
        assert abs(np.sqrt(wanted / squares) - 1.0).max() > 1e-5 * omega / 100.0
        np.testing.assert_allclose(np.sqrt(whirling), np.sqrt(wanted), rtol=3e-5)


@pytest.mark.usefixtures("unjudged")
def test_errors_of_the_range_are_those_against_the_solid(tiny: Any) -> None:
    """At 1500 and 4500 rpm, the middles between the speeds of the basis."""
    stored, _ = tiny
    errors = stored.whole.errors
    np.testing.assert_allclose(RPM * errors.speeds, [1500.0, 4500.0])
    assert np.all(errors.displacement < 1e-4) and np.all(errors.displacement > 0.0)
    assert np.all(errors.frequency < 1e-4) and np.all(errors.flexibility < 1e-2)
    coarse = fenicsrom.build_model(blade(*TINY, "rotation.speeds_rpm=[0.0, 6000.0]"))
    assert coarse.whole.errors.displacement[0] > 10.0 * errors.displacement.max()
    for name in ("sines", "spans"):  # not those at the middle speed, 6000 rpm
        of_load = (getattr(one.model.load_histories, name) for one in (coarse, stored))
        np.testing.assert_array_equal(*of_load)
    rows = coarse.whole.at(3000.0 / RPM, True, True)
    exact = stored.whole.at(3000.0 / RPM, True, True)  # 3000 rpm belongs to its basis
    change = abs(rows.frequencies_hz / exact.frequencies_hz - 1.0).max()
    assert change == pytest.approx(coarse.whole.errors.frequency[0], rel=1e-2)


def test_error_due_to_the_mesh_is_that_of_the_modes_at_the_speed(tiny: Any) -> None:
    _, path = tiny
    for rpm in (500.0, 3000.0):
        scene = at_one_speed(blade(*TINY, f"rotation.speed_rpm={rpm}"))
        judged = fenicsrom.modes(scene).mesh_check
        found = of_model(at_speed(load_model(path), rpm)).frequencies
        assert len(found) == 4 and max(found) > 1e-3
        np.testing.assert_allclose(found, judged.frequencies, rtol=1e-3)


def test_file_of_the_range_gives_the_same_model_at_each_speed(tiny: Any) -> None:
    stored, path = tiny
    read = load_model(path)
    for rpm in (3000.0, 5000.0):
        one, other = at_speed(stored, rpm), at_speed(read, rpm)
        assert one.labels == other.labels and one.further == other.further
        for name in ("mass", "contact_rows", "contact_offset", "velocity_matrix"):
            np.testing.assert_array_equal(getattr(one.model, name), getattr(other.model, name))
        np.testing.assert_array_equal(one.model.elastic.cubic, other.model.elastic.cubic)
    larger = stored.resized(stored.size + 4)
    assert at_speed(larger, 5000.0).labels == larger.labels
    back = at_speed(at_speed(read, 5000.0), 3000.0)
    np.testing.assert_array_equal(back.model.elastic.cubic, read.model.elastic.cubic)


@pytest.mark.usefixtures("unjudged")
def test_motion_at_a_speed_matches_that_of_a_model_of_this_speed(tiny: Any) -> None:
    stored, _ = tiny
    changes = ("rotation.speed_rpm=2000.0", "contacts.0.gap=1.3e-3")
    found = stored.with_overrides(changes).simulate()
    scene = blade(*TINY, *changes)
    alone = at_one_speed(scene)
    wanted = simulate(
        fenicsrom.build_model(alone).candidates, alone
    )  # 38 coordinates instead of 24
    size = np.linalg.norm(amplitude(wanted))
    assert size > 1e-2 and peak_normal_force(wanted) > 100.0
    assert np.linalg.norm(amplitude(found) - amplitude(wanted)) < 2e-3 * size
    assert peak_normal_force(found) == pytest.approx(peak_normal_force(wanted), rel=2e-3)


def test_sweep_over_the_speed_takes_one_model(tiny: Any, tmp_path: Path) -> None:
    stored, _ = tiny
    found = fenicsrom.sweep(
        stored, {"rotation.speed_rpm": [2000.0, 4500.0, 7000.0]}, folder=tmp_path
    )
    assert found.models == 0
    assert "7000" in str(found.rows[2]) and found.rows[2].keys() != found.rows[0].keys()
    own = [at_speed(stored, rpm).simulate() for rpm in (2000.0, 4500.0)]
    peaks = [peak_normal_force(motion) for motion in own]
    assert abs(peaks[0] - peaks[1]) > 1.0
    told = [value for row in found.rows[:2] for value in row.values() if value in peaks]
    assert told == peaks


def test_commands_take_any_speed_from_the_file(tiny: Any, tmp_path: Path) -> None:
    stored, path = tiny
    out = tmp_path / "run"
    speed = "rotation.speed_rpm=2000.0"
    told = ["run", "--from", str(path), "--set", speed, "--output", str(out), *UNDRAWN]
    assert main(told) in (0, 1)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["range"]["speed_rpm"] == 2000.0
    assert summary["range"]["errors_between"]["speeds"] == pytest.approx([1500.0, 4500.0])
    np.testing.assert_allclose(
        summary["frequencies_Hz"], at_speed(stored, 2000.0).frequencies_hz, rtol=1e-12
    )
    out, speeds = tmp_path / "campbell", "campbell.speeds_rpm=[0.0, 2500.0, 5000.0]"
    told = ["campbell", "--from", str(path), "--set", speeds, "--output", str(out)]
    told += UNDRAWN
    assert main(told) == 0
    diagram = json.loads((out / "campbell.json").read_text())
    body = RangeBody(stored.whole, 5000.0 / RPM)
    modes = stored.whole.modes
    assert modes < 6 and not any("basis.modes" in text for text in diagram["warnings"])
    squares, _, _ = modes_at_speed(body, modes)
    found = np.sort(diagram["frequencies_Hz"][2])
    np.testing.assert_allclose(found, np.sqrt(squares) / (2.0 * np.pi), rtol=1e-9)
    asked = fenicsrom.campbell(stored.with_overrides([speeds, "campbell.modes=6"]))
    assert asked.squares.shape == (3, modes)
    assert sum("basis.modes" in text for text in asked.warnings) == 1


@pytest.mark.usefixtures("unjudged")
def test_damping_of_a_range_is_that_of_the_solid_at_the_speed_of_the_scene() -> None:
    """The range model damps its modes at this speed as the solid does; at other speeds C stays."""
    scene = cantilever((0.0, 4.0, 12.0), modes=2)
    scene = replace(scene, geometry=replace(scene.geometry, parameters={"elements_along": 6}))
    factor, ratios = 1e-4, np.array([0.01, 0.03])
    damping = Damping(stiffness=factor, ratios=tuple(map(float, ratios)))
    stored = fenicsrom.build_model(replace(scene, damping=damping))
    assert scene.rotation is not None
    speed = scene.rotation.speed_rpm
    body = make_solid(replace(scene, rotation=replace(scene.rotation, speeds_rpm=None)))
    shapes = body.eigenmodes(body.factor, 2)[1]
    strains = np.diag(body.inner(shapes, body.strain_stiffness_times(shapes)))
    for rpm in (speed, 2.0 * speed):
        model = at_speed(stored, rpm).model
        squares, modes = scipy.linalg.eigh(model.elastic.stiffness, model.mass)
        omega = np.sqrt(squares[:2])
        found = np.diag(modes.T @ model.velocity_matrix @ modes)[:2] / (2.0 * omega)
        if rpm == speed:
            assert np.all(strains < 0.98 * omega**2)  # the centrifugal tension dissipates nothing
            np.testing.assert_allclose(found, ratios + 0.5 * factor * strains / omega, rtol=1e-3)
        else:
            assert np.all(found < 0.9 * ratios)


@pytest.mark.parametrize(
    ("override", "kind", "key"),
    [
        ("rotation.speed_rpm=6001.0", ErrorKind.RANGE, "rotation.speed_rpm"),
        ("rotation.speeds_rpm=[3000.0]", ErrorKind.TYPE, "rotation.speeds_rpm"),
        ("basis.method='craig-bampton'", ErrorKind.CONFLICT, "basis.method"),
        ("basis.derivatives='none'", ErrorKind.CONFLICT, "basis.derivatives"),
        ("output.stresses='cauchy'", ErrorKind.CONFLICT, "output.stresses"),
        ("reference.full=true", ErrorKind.CONFLICT, "reference.full"),
        ("loads.0.follower=true", ErrorKind.CONFLICT, "loads[0].follower"),
    ],
)
def test_what_a_range_of_speeds_cannot_do_is_refused(
    override: str, kind: ErrorKind, key: str
) -> None:
    with refusal(kind, key):
        blade(override)


def test_model_of_one_speed_has_no_diagram_and_no_other_speed(tiny: Any) -> None:
    stored, _ = tiny
    with refusal(ErrorKind.RANGE, "rotation.speed_rpm"):
        at_speed(stored, 7000.0)
    high = stored.with_overrides(["campbell.speeds_rpm=[0.0, 7000.0]"])
    with refusal(ErrorKind.RANGE, "campbell.speeds_rpm"):
        fenicsrom.campbell(high)
    alone = replace(stored, whole=None)
    with refusal(ErrorKind.MISSING, "rotation.speeds_rpm"):
        fenicsrom.campbell(alone)
    with refusal(ErrorKind.CONFLICT, "rotation.speeds_rpm"):
        fenicsrom.run(blade(*TINY))


RUN_UP = (
    "rotation.history=[[0.0, 1500.0], [0.1, 2500.0]]",
    "time={duration=0.1, steps_per_revolution=240}",
)


def test_model_for_a_run_up_matches_the_range_model_at_all_speeds(
    tiny: tuple[StoredModel, Path],
) -> None:
    stored = tiny[0].with_overrides(RUN_UP)
    whole, model = tiny[0].whole, stored.model
    assert whole is not None and stored.size < 0.6 * whole.model.size
    assert stored.candidates is not None and stored.candidates.size > stored.size
    start = whole.equilibrium(1500.0 / RPM)
    np.testing.assert_allclose(
        model.contact_offset, whole.model.contact_rows @ start, rtol=0, atol=1e-12
    )
    for rpm in (1500.0, 1800.0, 2500.0):
        omega = rpm / RPM
        held = speed_history([[0.0, omega]])
        slow = model._replace(
            turning=model.turning._replace(history=held),
            load_histories=model.load_histories._replace(history=held),
        )
        slow.set_interval(0.0, 0.0)
        zero, one = np.zeros(slow.size), np.ones(1)
        y = zero
        for _ in range(8):  # Newton's method for the equilibrium at this speed
            force, tangent = slow.elastic_over_step(zero, y, zero, 0.0, one, one)
            y = y - np.linalg.solve(tangent.matrix, force)
        q = whole.equilibrium(omega)
        moved = model.contact_displacement(y) - whole.model.contact_rows @ q
        assert np.max(np.abs(moved)) < 2e-6
        _, tangent = slow.elastic_over_step(zero, y, zero, 0.0, one, one)
        found = scipy.linalg.eigh(tangent.matrix, model.mass, eigvals_only=True)[:3]
        exact = scipy.linalg.eigh(whole.tangent(omega, q), whole.model.mass, eigvals_only=True)
        np.testing.assert_allclose(found, exact[:3], rtol=1e-3)
        rows = model.contact_rows
        ours = rows @ np.linalg.solve(tangent.matrix, rows.T)
        rows = whole.model.contact_rows
        theirs = rows @ np.linalg.solve(whole.tangent(omega, q), rows.T)
        assert np.linalg.norm(ours - theirs) < 0.05 * np.linalg.norm(theirs)


def test_estimate_of_a_run_up_is_its_distance_from_the_range_model(
    tiny: tuple[StoredModel, Path],
) -> None:
    """A basis of as many coordinates as the accuracy asks, in a run-up with rub."""
    short = "time={duration=0.03, steps_per_revolution=200}"
    stored = tiny[0].with_overrides(
        (*RUN_UP, short, "contacts.0.gap=0.7e-3", "basis.accuracy=1e-3")
    )
    found = fitted(stored, stored.simulate(keep_coordinates=True), [])
    assert found is not None and peak_normal_force(found.motion) > 10.0
    exact = simulate(whole_for_run_up(found.stored), stored.scene)
    true, estimate = distances(found.motion, exact), found.errors
    assert 0.5 < estimate.amplitude / true.amplitude < 3.0
    assert 0.2 < estimate.peak_force / true.peak_force < 5.0


def whole_for_run_up(stored: StoredModel) -> ReducedModel:
    """All coordinates of the range model, for the history of the scene."""
    whole, history = stored.whole, stored.model.turning.history
    assert whole is not None
    q0, every = whole.equilibrium(history[0, 1]), np.eye(whole.model.size)
    turning = whole._turning(history, q0, every)
    damping = whole.model.velocity_matrix if whole.model.velocity_matrix.size else 0.0 * every
    model = whole._on(every, q0, shifted(whole.model.elastic, q0), damping)
    rest = [
        rest_row(turning, model.elastic, omega**2, whole.equilibrium(omega) - q0)
        for omega in np.linspace(history[:, 1].min(), history[:, 1].max(), 25)
    ]
    return model._replace(
        turning=turning._replace(rest=np.array(rest)), load_histories=stored.model.load_histories
    )


def test_run_at_a_constant_history_matches_the_model_at_this_speed(
    tiny: tuple[StoredModel, Path],
) -> None:
    gap = "contacts.0.gap=1.3e-3"  # a nearer casing makes the motion sensitive
    steady = at_speed(tiny[0], 2000.0, gap, "time.steady='march'").simulate()
    held = "rotation.history=[[0.0, 2000.0]]", "time={duration=0.09, steps_per_revolution=100}"
    stored = tiny[0].with_overrides([gap, *held])
    found = stored.simulate()
    np.testing.assert_allclose(found.time, steady.time, atol=1e-12)
    apart = np.max(np.abs(found.displacement - steady.displacement))
    assert apart < 0.01 * amplitude(steady).max()
    normal = steady.force[:, :, 0]  # of all revolutions: only the steady run has a last period
    assert np.max(found.force[:, :, 0]) == pytest.approx(np.max(normal), rel=0.02)
    measured = run_up(stored, found)
    assert measured is not None and measured.time.size == 3
    np.testing.assert_allclose(RPM * measured.speed, 2000.0, rtol=1e-9)
    assert abs(measured.balance) < 1e-11 * measured.contact_work


def test_model_of_a_curve_over_the_speed_moves_as_the_model_at_a_speed(
    tiny: tuple[StoredModel, Path],
) -> None:
    """Periodic motions that bend far, without and with rub."""
    table = "response={parameter='rotation.speed_rpm', first=1500.0, last=2500.0}"
    for gap, allowed in ((3e-3, 1e-3), (1.3e-3, 5e-3)):
        changes = f"contacts.0.gap={gap}", "time.periods=200"
        stored = at_speed(tiny[0], 2000.0, table, *changes)
        wide = stored.over_speeds(1500.0, 2500.0)
        found = start_motion(wide, family_of(wide), 2000.0)
        single = stored.simulate()
        exact = periodic_motion(Problem.of(stored.model, stored.scene), single.end)
        np.testing.assert_allclose(found.amplitude.max(0), exact.amplitude.max(0), rtol=allowed)


def test_run_up_with_rub_and_wear_balances(tiny: tuple[StoredModel, Path]) -> None:
    """The ledger of the blade, and the works of the shaft; the plastic work of the layer is not
    one of the forces on the blade, and is what its depths say."""
    layer = "{thickness=5e-3, modulus=1e9, yield_stress=5e6, hardening=1e8, area=1e-5, cells=360}"
    changes = (*RUN_UP, "contacts.0.gap=0.7e-3", "basis.accuracy=1.0")
    stored = tiny[0].with_overrides([*changes, f"contacts.0.abradable={layer}"])
    motion = stored.simulate()
    found = run_up(stored, motion)
    assert found is not None and found.peak_force.max() > 10.0
    rings = wear_of(motion, stored.scene, stored.model.points)
    assert max(float(ring.depth.max()) for ring in rings) > 5e-4
    assert sum(ring.plastic_work for ring in rings) > found.contact_work
    works = found.shaft_work, found.contact_work, found.load_work, found.own_work
    parts = found.damping, found.friction_heat, found.spring_energy
    assert found.friction_heat == motion.friction_dissipation[-1] and found.damping > 0.0
    own = found.deformation_work - sum(parts)
    assert own == pytest.approx(found.own_work, abs=1e-9 * found.shaft_work)
    assert motion.relative_imbalance < 1e-9
    assert abs(found.balance) < 1e-9 * np.max(np.abs(works))


@pytest.mark.parametrize(
    ("override", "kind", "key"),
    [
        ("rotation.history=[[0.1, 1500.0]]", ErrorKind.RANGE, "rotation.history[0]"),
        ("rotation.history=[[0, 1500], [0, 1600]]", ErrorKind.RANGE, "rotation.history"),
        ("rotation.history=[[0, 1500], [1, 7000]]", ErrorKind.RANGE, "rotation.history[1]"),
        ("time.steps_per_revolution=100", ErrorKind.CONFLICT, "time.steps_per_revolution"),
    ],
)
def test_history_of_the_speed_refuses_bad_values(override: str, kind: ErrorKind, key: str) -> None:
    with refusal(kind, key):
        blade(override)


def test_history_of_the_speed_names_what_it_needs() -> None:
    with refusal(ErrorKind.MISSING, "rotation.speeds_rpm"):
        read_scene(DEMO, (*UNSTRESSED, "rotation.history=[[0, 900]]"))
    with refusal(ErrorKind.CONFLICT, "rotation.coriolis"):
        blade(*RUN_UP, "rotation.coriolis=false")
    with refusal(ErrorKind.CONFLICT, "geometrically_nonlinear"):
        blade(*RUN_UP, "geometrically_nonlinear=false")
    with refusal(ErrorKind.CONFLICT, "time.steps_per_revolution"):
        blade(*RUN_UP, "rotation.history=[[0, 0], [0.1, 1500]]")
    with refusal(ErrorKind.CONFLICT, "time.steps_per_revolution"):
        blade(*RUN_UP, "time.steps_per_revolution=12")
    with refusal(ErrorKind.CONFLICT, "time.steady_tolerance"):
        blade("rotation.history=[[0, 1500], [0.1, 2500]]")


@pytest.mark.long
def test_blade_that_runs_up_through_its_resonance_has_the_known_peak() -> None:
    """Test D: the blade of the demo without contact, from 900 to 1500 rpm in 2 s, against another
    program on matrices of the same solid.

    Reference: run-up of a blade, with and without Euler force: largest distance | another program,
    same matrices | 7.504, 6.904 mm | 7.5035, 6.9046 mm | 0.002; 0.05 mm
    """
    scene = blade(
        "basis.modes=4",
        "contacts=[]",
        'probe={group="tip_nodes", at="centre"}',
        "loads.0.pressure=500",
        "rotation.history=[[0.0, 900.0], [2.0, 1500.0]]",
        f"time={{duration=2.0, step={2.0 / 12000.0}}}",
    )
    stored = fenicsrom.build_model(scene)
    motion = stored.simulate()
    found = run_up(stored, motion)
    assert found is not None
    assert found.amplitude.max() == pytest.approx(7.504e-3, abs=2e-6)
    last = 1e3 * motion.displacement[-1, 0]
    np.testing.assert_allclose(last, (0.4078, -6.4266, 11.8867), rtol=0, atol=2e-3)
    assert np.max(np.abs(motion.imbalance)) < 1e-12 * np.max(motion.work)
    assert stored.candidates is not None and stored.candidates.size > stored.size
    larger = stored.resized(stored.candidates.size)
    judged = run_up(larger, larger.simulate())
    assert judged is not None
    assert judged.amplitude.max() == pytest.approx(found.amplitude.max(), rel=5e-5)
    silent = stored.model.turning._replace(euler=0.0 * stored.model.turning.euler)
    without = replace(stored, model=stored.model._replace(turning=silent))
    other = run_up(without, without.simulate())
    assert other is not None
    assert other.amplitude.max() == pytest.approx(6.904e-3, abs=5e-5)


@pytest.mark.usefixtures("unjudged")
def test_nearly_dependent_vectors_of_the_joined_basis_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A basis that leaves them out at 1e-3 misses the modes of its own speeds."""
    solid = make_solid(at_one_speed(cantilever((0.0, 12.0))))
    assert errors_at((0.0, 6.0, 12.0), solid, 12.0)[0] < 8e-8
    monkeypatch.setattr(joined, "DEPENDENCE", 1e-3)
    assert errors_at((0.0, 6.0, 12.0), solid, 12.0)[0] > 1e-5


@pytest.mark.long
def test_run_up_with_rub_balances_and_writes_its_revolutions(
    tiny: tuple[StoredModel, Path], tmp_path: Path
) -> None:
    changes = (*RUN_UP, "contacts.0.gap=0.7e-3", "basis.accuracy=1.0")
    stored = tiny[0].with_overrides(changes)
    motion = stored.simulate(keep_coordinates=True)
    found = run_up(stored, motion)
    assert found is not None and found.peak_force.max() > 10.0
    assert motion.relative_imbalance < 1e-10
    assert abs(found.balance) < 1e-9 * found.contact_work
    # the casing stands still: what it does to the blade comes from the shaft
    heat = motion.friction_dissipation[-1]
    assert 0.5 * heat < found.contact_work < 2.0 * heat
    # a stored model of a run-up moves as before
    path = tmp_path / "run_up.npz"
    save_model(path, stored)
    again = load_model(path).simulate()
    np.testing.assert_allclose(again.displacement, motion.displacement, rtol=0, atol=1e-12)
    options = [part for change in changes for part in ("--set", change)]
    folder = tmp_path / "out"
    assert main(["run", "--from", str(tiny[1]), *options, "--output", str(folder)]) in (0, 1)
    rows = np.genfromtxt(folder / "run_up.csv", delimiter=",", names=True)
    np.testing.assert_allclose(rows["amplitude_m"], found.amplitude, rtol=1e-6)
    table = "campbell={speeds_rpm={first=1500, last=2500, number=6}, engine_orders=[2, 4, 6, 8]}"
    critical = fenicsrom.campbell(tiny[0].with_overrides(table)).critical
    expected = [(one.mode, one.order, one.speed_rpm) for one in critical if one.mode <= 3]
    close = [one for one in found.critical if one[0] <= 3 and one[1] <= 8]
    assert expected and [one[:2] for one in close] == [one[:2] for one in expected]
    np.testing.assert_allclose([one[2] for one in close], [one[2] for one in expected], rtol=1e-4)
    summary = json.loads((folder / "summary.json").read_text())["run_up"]
    assert summary["critical"] == [list(one) for one in found.critical]
    assert summary["shaft_work"] == pytest.approx(found.shaft_work, rel=1e-6)
    assert (folder / "run_up.png").exists()
