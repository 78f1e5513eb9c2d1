"""The evidence of the schemes: fitted orders, refused runs, the report and the command."""

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scheme_errors
import scheme_report
import schemes as command
from scheme_errors import SCHEMES, Errors, Run, Series
from support import oscillator

from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.online.motion.measures import amplitude
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate

STEPS = (6, 100, 200, 400)


@pytest.fixture(scope="module")
def smooth() -> Series:
    """A linear oscillator, by six steps a period too."""
    model, scene, _ = oscillator()
    return scheme_errors.series("smooth", model, scene, STEPS, (1e-3,), reference=6400)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("measure", ["path", "cycle"])
def test_every_scheme_is_of_second_order_on_a_smooth_problem(
    smooth: Series, scheme: str, measure: str
) -> None:
    assert smooth.order(scheme, measure) == pytest.approx(2.0, abs=0.03)


@pytest.mark.slow
def test_amplitude_error_matches_the_exact_oscillator(smooth: Series) -> None:
    """The exact amplitude of a forced oscillator is known; the reference run is close enough to
    it."""
    model, scene, _ = oscillator()
    omega = 2.0 * np.pi
    exact = [f / abs(complex(k - omega**2, 0.5 * omega)) for f, k in ((1.0, 60.0), (0.3, 30.0))]
    coarse = simulate(model, scheme_errors.with_steps(scene, "discrete-gradient", 100))
    error = float(np.linalg.norm(amplitude(coarse) - exact) / np.linalg.norm(exact))
    run = next(run for run in smooth.of("discrete-gradient") if run.steps == 100)
    assert run.errors.amplitude == pytest.approx(error, rel=0.01)
    assert smooth.agreement.amplitude is not None and smooth.agreement.amplitude < 1e-6


@pytest.mark.slow
def test_refused_run_appears_in_brackets(smooth: Series) -> None:
    for scheme in SCHEMES:
        six, *others = smooth.of(scheme)
        loses = scheme == "generalised-alpha"
        assert six.steps == 6 and six.refused
        assert six.kind is (ErrorKind.ENERGY if loses else ErrorKind.TIME_STEP)
        assert not any(run.refused for run in others) and all(run.settled for run in others)
    head, *rows = scheme_report.table([smooth])
    assert head == ["case", "scheme", "6", "100", "200", "400", "amplitude order", "path order"]
    assert scheme_report.table([smooth], "path")[0][-2:] == ["400", "path order"]
    assert [row[:2] for row in rows] == [
        ["smooth", name]
        for name in ("discrete gradient", "average acceleration", "generalised-alpha")
    ]
    assert all(row[2].startswith("(") and not row[3].startswith("(") for row in rows)
    alpha = smooth.of("generalised-alpha")[0]  # its purpose is to lose energy
    assert alpha.imbalance > 0.01 > alpha.created >= 0.0
    told = scheme_report.sentences([smooth])
    assert told[0].startswith(
        "Discrete gradient: of 4 runs 3 settled, 0 did not, 1 were refused (0 for their energy, "
    )


def test_run_without_motion_keeps_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    model, scene, _ = oscillator(100)

    def fails(model, scene):  # type: ignore[no-untyped-def]
        if scene.time.scheme == "average-acceleration":
            raise ConvergenceError("it stopped")
        return simulate(model, scene)

    monkeypatch.setattr(scheme_errors, "simulate", fails)
    found = scheme_errors.series("s", model, scene, (100,), (), reference=400)
    assert [run.refused for run in found.runs] == ["", "it stopped", ""]
    assert found.runs[1].errors == Errors() and found.agreement.path is not None
    assert [row[2] is None for row in scheme_report.table([found])[1:]] == [False, True, False]
    monkeypatch.setattr(
        scheme_errors, "simulate", lambda *_: (_ for _ in ()).throw(ConvergenceError("none at all"))
    )
    assert (
        "none at all" in scheme_errors.series("s", model, scene, (100,), (), reference=400).failure
    )


@pytest.mark.slow
def test_tolerance_replaces_the_steps(smooth: Series) -> None:
    """No setting of another scheme remains."""
    adaptive = [run for run in smooth.runs if run.tolerance is not None]
    assert [run.scheme for run in adaptive] == list(SCHEMES)
    assert all(
        run.errors.path is None and 0.0 < run.errors.amplitude < 2e-3 and run.taken > 20.0
        for run in adaptive
    )
    _, scene, _ = oscillator()
    alpha = scheme_errors.with_steps(scene, "generalised-alpha", None, 1e-2)
    assert (alpha.time.tolerance, alpha.time.steps_per_period, alpha.time.spectral_radius) == (
        1e-2,
        None,
        0.8,
    )
    back = scheme_errors.with_steps(alpha, "average-acceleration", 60)
    assert (back.time.tolerance, back.time.steps_per_period, back.time.spectral_radius) == (
        None,
        60,
        None,
    )
    assert (back.time.periods, back.loads) == (scene.time.periods, scene.loads)


def test_fitted_order_of_a_power_law_is_its_exponent() -> None:
    steps = np.array(scheme_errors.STEPS)
    assert scheme_errors.fitted_order(steps, 3.0 * steps**-1.5) == pytest.approx(1.5, abs=1e-12)


def made(order: float, least: float = 0.0, **changed: object) -> Series:
    """Runs of the discrete gradient whose errors follow an order but do not fall below a floor."""

    def runs(scheme: str) -> list[Run]:
        errors = [max(float(n) ** -order, least) for n in scheme_errors.STEPS]
        return [
            Run(scheme, n, None, errors=Errors(e, e, e, e), imbalance=1e-12, settled=True)
            for n, e in zip(scheme_errors.STEPS, errors, strict=True)
        ]

    return replace(
        Series("made", tuple(run for scheme in SCHEMES for run in runs(scheme))), **changed
    )


def test_errors_below_those_of_the_reference_are_not_fitted() -> None:
    floor = 400.0**-1.7
    found = made(1.7, floor)
    assert found.order(SCHEMES[0], "path") < 1.6
    assert found.order(SCHEMES[0], "amplitude") < 1.6
    clear = replace(
        found, agreement=Errors(amplitude=floor, path=0.99 * 200.0**-1.7 / scheme_errors.CLEAR)
    )
    assert clear.order(SCHEMES[0], "path") is None  # two are left
    assert found.order(SCHEMES[0], "cycle") is not None


def test_unsettled_runs_have_an_order_of_the_path_only() -> None:
    found = made(2.0)
    restless = replace(found, runs=tuple(replace(run, settled=False) for run in found.runs))
    assert restless.order(SCHEMES[0], "path") == pytest.approx(2.0)
    assert restless.order(SCHEMES[0], "amplitude") is None
    assert scheme_report.table([restless])[1][2].endswith("*")


def test_sentences_count_refusals_and_low_orders() -> None:
    """The sentences give the counts and name the orders below two."""
    found = made(1.0)
    lost = {
        "refused": "the energy ledger is off: 2e-02 is lost",
        "kind": ErrorKind.ENERGY,
        "errors": Errors(),
        "imbalance": 0.02,
        "created": 1e-3,
    }
    given = lost | {"created": 0.02}
    runs = [
        replace(run, **(given if run.scheme == SCHEMES[2] else lost)) if run.steps == 25 else run
        for run in found.runs
    ]
    runs[1] = replace(runs[1], errors=Errors(amplitude=1e-9))
    told = scheme_report.sentences(
        [
            replace(found, runs=tuple(runs), agreement=Errors(amplitude=1e-7)),
            Series("none", failure="why"),
        ]
    )
    assert told[0] == "none: why"
    assert "of 6 runs 5 settled, 0 did not, 1 were refused (1 for their energy, 1 of " in told[1]
    assert "1 of which only lose some); at 200" in told[1]
    assert "(1 for their energy, 0 of which only lose some)" in told[3]
    assert "at 200 steps per period or more 3 of 3 settled" in told[1]
    assert "Nearest of the three 5 times" in told[1] and "Nearest of the three 0 times" in told[2]
    assert "0 of 3 fits" in told[4] and "lower orders: made (1.00, 1.00, 1.00)" in told[4]
    assert "agree to 1.0e-07 (made)" in told[5]
    assert scheme_report.sentences([Series("none", failure="why")]) == ["none: why"]


def test_events_count_changes_of_contact_state() -> None:
    _, _, motion = oscillator()
    motion = replace(motion, state=np.full((motion.time.size, 1), -1, dtype=np.int8))
    assert scheme_errors.events(motion) == ()
    motion.state[3:9], motion.state[5:9] = 1, 0
    late = motion.time > scheme_errors.PATH * motion.period
    motion.state[late] = 1  # too late to count
    assert dict(scheme_errors.events(motion)) == {
        "changes from stick to slip": 1,
        "openings": 1,
        "closings": 1,
    }


def test_errors_compare_equal_instants() -> None:
    """The error of a doubled motion is one.

    A motion whose peak lies between two steps has no error over its cycle.
    """
    _, _, exact = oscillator(400)

    def scaled(motion: Motion, factor: float) -> Motion:
        return replace(motion, displacement=factor * motion.displacement)

    assert scheme_errors.errors_of(scaled(exact, 2.0), exact, 25) == pytest.approx(
        (1.0, 1.0, None, 1.0)
    )
    every = slice(None, None, 16)
    thinned = replace(
        exact,
        **{
            name: getattr(exact, name)[every] for name in ("time", "displacement", "force", "state")
        },
    )
    errors = scheme_errors.errors_of(thinned, exact, 25)
    assert errors.cycle == pytest.approx(0.0, abs=1e-12) and errors.path == pytest.approx(
        0.0, abs=1e-12
    )
    assert errors.amplitude is not None and errors.amplitude > 1e-4


@pytest.mark.slow
def test_write_makes_report_and_files(smooth: Series, tmp_path: Path) -> None:
    files = scheme_report.write([smooth, Series("none", failure="it <cannot>")], tmp_path)
    names = ["report.html", "schemes.json", "schemes.csv", "schemes.png"]
    assert [path.name for path in files] == names
    lines = list(csv.DictReader(files[2].read_text(encoding="utf-8").splitlines()))
    assert len(lines) == 15 and lines[0]["case"] == "smooth" and lines[0]["steps_per_period"] == "6"
    assert lines[0]["refused"] and lines[1]["settled"] == "True"
    assert float(lines[1]["path_error"]) == smooth.runs[1].errors.path
    assert files[3].read_bytes().startswith(b"\x89PNG")
    page = files[0].read_text()
    assert "none: it &lt;cannot&gt;" in page and "Every run of the schemes" in page
    told = json.loads(files[1].read_text())
    assert told["cases"][0]["orders"]["discrete-gradient"]["path"] == pytest.approx(2.0, abs=0.03)
    nothing = scheme_report.write([Series("none", failure="why")], tmp_path / "none")
    assert [path.name for path in nothing] == names[:2]
    assert scheme_report.terminal([Series("none", failure="why")]) == "none: why"
    assert "smooth  discrete gradient" in scheme_report.terminal([smooth])


@pytest.mark.slow
def test_command_compares_the_schemes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The paper's first case runs by every scheme; a case with a missing group fails by itself."""
    pytest.importorskip("dolfinx")
    studied = {"slip and lift-off": (), "wrong": ("contacts.0.group='nowhere'",)}
    monkeypatch.setattr(command, "STUDIED", studied)
    monkeypatch.setattr(command, "WORKERS", 1)
    monkeypatch.setattr(sys, "argv", ["schemes.py", "--output", str(tmp_path)])
    assert command.main() == 0
    told, progress = capsys.readouterr()
    assert "slip and lift-off  discrete gradient" in told and f"{tmp_path / 'schemes.png'}" in told
    assert "2/2 wrong" in progress and "nowhere" in told
    found = json.loads((tmp_path / "schemes.json").read_text())
    assert len(found["runs"]) == 27
    first, second = found["cases"]
    assert first["events"]["openings"] > 0 and second["failure"]
    default = [
        run
        for run in found["runs"]
        if run["scheme"] == "discrete-gradient" and (run["steps_per_period"] or 0) >= 200
    ]
    assert len(default) == 3 and not any(run["refused"] for run in default)
    assert all(
        run["settled"] and run["amplitude_error"] < 1e-3 and run["imbalance"] < 1e-9
        for run in default
    )
    assert first["orders"]["discrete-gradient"]["path"] > 1.5  # measured 1.8
    assert first["agreement"]["path"] < 1e-5
    assert "(0 for their energy," in (tmp_path / "report.html").read_text()
