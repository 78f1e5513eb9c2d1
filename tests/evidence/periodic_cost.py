"""The cost of periodic motions and their curves in marched periods.

    python3 tests/evidence/periodic_cost.py [--without-marching]

All times are CPU times of one process, side by side in one run. The unit of the first rows is the
march of one period of `slip_liftoff_2d` by `fenicsrom run`, with 200 steps. Then come whole runs of
reduced models with their error estimates, by Newton's method against `time.steady = "march"`, which
stops where a period changes the motion by less than 1e-5.

The last two rows march the four curves of figure 4 of the paper up and down. The first stops where
a period changes the motion by less than 1e-4, as `demos/paper/reproduce.py` does; the motion may
still be far from its steady state. The second has the accuracy of the curves: it stops where the
change in a period, divided by 1 - |largest multiplier|, is below 1e-6. It takes some of the
frequencies and scales their time to all. The two rows take some minutes.
"""

from __future__ import annotations

import argparse
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.response_problem import family_of, start_motion
from fenicsrom.assess.errors.verdicts import estimate_errors
from fenicsrom.online.curves.continuation import follow
from fenicsrom.online.curves.curve import Curve
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import Shooting, hold_sliders, largest_multiplier
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.base.tables import text_table
from fenicsrom.scene import read_scene
from fenicsrom.scene.reading.reading import with_time
from fenicsrom.study import build_model

DEMOS = Path(__file__).parents[2] / "demos"
SCENE = DEMOS / "slip_liftoff_2d.toml"
RUNS = ("slip_liftoff_2d", "stick_slip_2d", "high_load_2d", "open_2d")  # whole runs
MODELS = {
    10: ("basis.modes=3", 'basis.derivatives=["1V1V", "1V2V", "1V3V", "1V1S", "1V2S"]'),
    24: (
        "basis.modes=5",
        "basis.derivatives=["
        '"1V1V", "1V2V", "1V3V", "1V4V", "1V5V", "2V2V", "2V3V", "2V4V", "2V5V", "3V3V", "3V4V", '
        '"3V5V", "4V4V", "4V5V", "5V5V", "1V1S", "1V2S"]',
    ),
}
FIGURE_4 = {0: (2.6, 3.8, 0.02), 40: (2.6, 3.8, 0.02), 60: (2.6, 3.8, 0.02), 250: (7.0, 9.0, 0.05)}
PERIODS = 50  # of one measured march
ROUNDS = 5  # measurements, of which the shortest counts
POINTS = 500  # of the long curve
NEWTON, CURVE, RUN_FASTER, FASTER = 4.0, 1500.0, 3.0, 20.0  # what is asked for

ACCURACY = 1e-6  # of a motion of the curves, relative to its amplitude
EACH = 20  # every so many frequencies are marched so accurately
LONGEST = 3000  # periods of such a march; one that takes longer counts as so long

CONTACT = "contacts.0."
MARCHED = ('time.steady="march"',)


class Case:
    """A model with its periodic motion at one frequency."""

    def __init__(self, stored: StoredModel, frequency: float):
        """Find the periodic motion."""
        self.stored = stored
        self.family = family_of(stored)
        problem = self.family(frequency)
        self.motion = start_motion(stored, self.family, frequency)
        self.shooting = Shooting(problem)
        self.s = self.shooting.scaled(self.motion.z)
        overrides = (f"time.periods={PERIODS}", "time.steady_tolerance=0.0", *MARCHED)
        self.marched = stored.with_overrides(overrides)

    def march(self) -> None:
        """March `PERIODS` periods as `fenicsrom run` does."""
        self.marched.simulate()

    def iterate(self) -> None:
        """Find the residual and its derivative, and solve for one step of Newton's method."""
        found = self.shooting.march(self.s)
        assert found is not None
        jacobian = found[1] - np.eye(self.s.size)
        hold_sliders(jacobian, self.shooting.sliders)
        np.linalg.solve(jacobian, -found[0])


def seconds(work: Callable[[], Any]) -> float:
    """CPU time of some work, s."""
    begin = clock.process_time()
    work()
    return clock.process_time() - begin


def stored_model(size: int) -> StoredModel:
    """A reduced model of the scene with so many coordinates."""
    of = "response={first=2.9, last=3.6, points=1000}"
    return build_model(read_scene(SCENE, (*MODELS[size], of)))


def newton_row(size: int) -> list[str]:
    """The cost of one iteration in marched periods."""
    case = Case(stored_model(size), 3.2)
    case.march()  # compiles
    marches, iterations = [], []
    for _ in range(ROUNDS):
        marches.append(seconds(case.march) / PERIODS)
        iterations.append(seconds(case.iterate))
    unit, cost = min(marches), min(iterations) / min(marches)
    name = f"Newton iteration, n = {case.stored.size}"
    return [name, f"{1e3 * unit:.2f}", f"{cost:.2f}", f"at most {NEWTON:g}"]


def curve_row() -> list[str]:
    """The cost of a curve of 500 points in marched periods."""
    case = Case(stored_model(10), 2.9)
    table = case.stored.scene.response
    assert table is not None

    def curve(**options: Any) -> Curve:
        return follow(case.family, case.motion, table.first, (table.first, table.last), **options)

    coarse = curve(largest_step=0.01)
    size, width = float(np.linalg.norm(coarse.points[0].s)), table.last - table.first
    places = [np.append(point.s / size, point.parameter / width) for point in coarse.points]
    length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(places))
    step = length / (POINTS - 2)
    found: list[Curve] = []
    costs, units = [], []
    for _ in range(2):
        units.append(seconds(case.march) / PERIODS)
        costs.append(seconds(lambda: found.append(curve(step=step, largest_step=step))))
    last, unit = found[-1], min(units)
    marches = np.sum([point.marches for point in last.points], axis=0)
    name = f"curve of {len(last.points)} points ({last.reason}), marches {marches[0]}, {marches[1]}"
    cost = min(costs) / unit * POINTS / len(last.points)
    return [name + " with derivatives", f"{1e3 * unit:.2f}", f"{cost:.0f}", f"at most {CURVE:g}"]


def run_row(name: str) -> list[str]:
    """How much faster a run with its error estimates is by Newton's method than by marching."""
    stored = build_model(read_scene(DEMOS / f"{name}.toml"))

    def run(way: str) -> None:
        scene = with_time(stored.scene, steady=way)
        motion = simulate(stored.model, scene)
        estimate_errors(stored.model, stored.candidates, scene, motion, {})

    times: dict[str, list[float]] = {"newton": [], "march": []}
    for number in range(ROUNDS + 1):
        for way, found in times.items():
            time = seconds(lambda way=way: run(way))
            found += [time] if number else []  # the first round compiles
    newton, marched = (min(found) for found in times.values())
    assert stored.candidates is not None
    sizes = f"n = {stored.size}, check of the basis {stored.candidates.size}"
    numbers = [f"{1e3 * newton:.0f} ms against {1e3 * marched:.0f} ms"]
    numbers += [f"{marched / newton:.1f} times faster"]
    return [f"run of {name}, {sizes}", *numbers, f"at least {RUN_FASTER:g} times faster"]


def figure_4_rows() -> list[list[str]]:
    """How much faster the four curves of figure 4 are than marching them up and down."""
    stored = stored_model(10)
    curves = loose = accurate = 0.0
    sampled = unfinished = 0
    for preload, (low, high, step) in FIGURE_4.items():
        gap = f"{CONTACT}gap={0.0 if preload else 1.0}"
        table = f"response={{first={low}, last={high}, points=1000}}"
        at = stored.with_overrides([table, f"{CONTACT}preload={preload}", gap])
        curves += seconds(lambda at=at: response(at))
        frequencies = np.arange(low, high + 0.5 * step, step)
        for order in (frequencies, frequencies[::-1]):
            marches = march_along(at, order, EACH if order is frequencies else 0)
            loose += marches.loose
            if marches.accurate:
                accurate += 2.0 * frequencies.size * float(np.mean(marches.accurate))
            sampled += len(marches.accurate)
            unfinished += marches.unfinished
    rows = []
    bound = f" ({unfinished} of {sampled} took more than {LONGEST} periods)" if unfinished else ""
    for name, time in (("to 1e-4 in a period", loose), (f"to {ACCURACY:g}{bound}", accurate)):
        numbers = [f"{curves:.1f} s against {time:.1f} s", f"{time / curves:.1f} times faster"]
        rows.append([f"figure 4, marched {name}", *numbers, f"at least {FASTER:g} times faster"])
    return rows


@dataclass
class Marches:
    """CPU times of marches over the frequencies of a curve.

    Attributes:
        loose: of all frequencies, until a period changes the motion by less than 1e-4, s.
        accurate: of some frequencies, until the steady state is `ACCURACY` away, s.
        unfinished: number of these that ended after `LONGEST` periods.
    """

    loose: float = 0.0
    accurate: list[float] = field(default_factory=list)
    unfinished: int = 0


def march_along(stored: StoredModel, frequencies: Any, each: int = 0) -> Marches:
    """March at each frequency until the motion settles, from the end of the one before.

    Args:
        stored: the model.
        frequencies: Hz, in their order.
        each: every so many frequencies the march is repeated to the accuracy of the curves, unless
            the motion there is unstable; 0 leaves it out.
    """
    found, last, family = Marches(), None, family_of(stored)
    for number, frequency in enumerate(frequencies):
        begin = clock.process_time()
        settled = march(stored, frequency, 1e-4, last)
        found.loose += clock.process_time() - begin
        if each and number % each == each // 2:
            motion = start_motion(stored, family, frequency)
            rate = abs(largest_multiplier(motion.multipliers, motion.free_sliders))
            if motion.stable:
                begin = clock.process_time()
                end = march(stored, frequency, ACCURACY * (1.0 - rate), last, LONGEST)
                found.accurate.append(clock.process_time() - begin)
                found.unfinished += not end.steady
        last = settled
    return found


def march(
    stored: StoredModel,
    frequency: float,
    tolerance: float,
    start: Motion | None,
    periods: int | None = None,
) -> Motion:
    """March from a motion until a period changes it by less than a tolerance."""
    overrides = [
        f"loads.0.frequency={float(frequency)!r}",
        f"time.steady_tolerance={tolerance!r}",
        *MARCHED,
        *([] if periods is None else [f"time.periods={periods}"]),
    ]
    return stored.with_overrides(overrides).simulate(start=start, keep_coordinates=True)


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description="The cost of periodic motions.")
    parser.add_argument("--without-marching", action="store_true", help="leave figure 4 out")
    options = parser.parse_args()
    rows = [["", "marched period, ms", "cost, marched periods", "asked for"]]
    rows += [newton_row(size) for size in MODELS]
    rows.append(curve_row())
    rows += [run_row(name) for name in RUNS]
    if not options.without_marching:
        rows += figure_4_rows()
    print(text_table(rows))


if __name__ == "__main__":
    main()
