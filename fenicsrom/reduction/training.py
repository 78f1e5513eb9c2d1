"""The motions that choose the interface vectors of bodies that touch (`reduction.interface`).

They are the motion of the scene, or those of its tables: with [response], motions at the ends of
the curves and at the resonances between, under the largest load; with [backbone], the decay of the
mode from its largest amplitude.
"""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from typing import Any

import numpy as np

from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.notes import DISSIPATION, Note, NoteKind
from fenicsrom.online.contact.points import (
    closed_springs,
    contacts_of,
    springs_of,
    trial_forces,
)
from fenicsrom.online.curves.nonlinear_mode import linear_modes
from fenicsrom.online.model.loads import displacement_sines
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import FALLBACK_STEPS, force_family, frequency_family
from fenicsrom.online.run.march import integrate
from fenicsrom.online.run.simulate import checked_problem, load_histories
from fenicsrom.online.store.archive import Trained, changed_scene
from fenicsrom.progress import log
from fenicsrom.reduction import interface
from fenicsrom.reduction.interface import SETTLED, dissipated, settled
from fenicsrom.reduction.protocols import Structure
from fenicsrom.reduction.snapshots import curve_frequencies
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Scene
from fenicsrom.scene.keys.times import Time

PERIODS = 40
"""Most periods of a motion on a curve."""

DECAY = 10.0
"""Periods for which the mode of a backbone decays."""

LARGER = 1.02
"""A motion is outside of the training if it is larger or longer by this factor."""

Task = tuple[Problem, tuple[Any, ...] | None]
"""A problem of time integration, and its start; None starts at rest."""


def train(structure: Structure, scene: Scene, stop: Callable[[], bool] = lambda: False) -> Trained:
    """Let motions of a scene choose the `interface` vectors of its structure.

    Args:
        structure: the structure.
        scene: the scene.
        stop: as `fenicsrom.online.run.march.integrate`.

    Returns:
        What the last motions hold.

    Raises:
        ConvergenceError, AccuracyError: a stage or a motion failed at its start.
    """
    contacts, d = contacts_of(scene, structure.points), structure.dimension
    x = structure.contact_rows @ structure.equilibrium
    springs, closed, force = springs_of(contacts, d), closed_springs(contacts, x), 0.0 * x
    force[::d] = trial_forces(contacts, x).clip(0.0)
    spent = list[float]()
    for number in range(1, interface.PASSES + 1):
        reduction = Reduction(structure, scene, lambda stage: nullcontext())
        tasks = [*_tasks(scene, structure, reduction)]
        motions = [_moved(*task, stop) for task in tasks]
        before, spent = spent, [interface.dissipated(motion) for motion in motions]
        log.info(f"  motion {number}: friction dissipates {sum(spent):.4g} J")
        vectors = interface.interface_vectors(springs, closed, (x, force), motions)
        structure.interface = vectors if vectors.shape[1] else None
        if before and all(map(interface.settled, before, spent)):
            break
    else:
        text = (
            f"the friction of the motions that choose the interface vectors still changes after "
            f"{interface.PASSES} rounds, from {sum(before):.4g} J to {sum(spent):.4g} J (at most "
            f'{100.0 * SETTLED:g} % is accepted): take basis.masters = "all"'
        )
        structure.warnings.append(Note(NoteKind.ERROR, text, "basis.masters", quantity=DISSIPATION))
    return _trained(scene, tasks, motions, sum(spent))


def _tasks(scene: Scene, structure: Structure, reduction: Reduction) -> Iterator[Task]:
    """The motions of a scene."""
    model: Any = reduction.model
    if scene.backbone is not None:
        yield _decay(scene, model)
    if scene.response is not None:
        yield from ((problem, None) for problem in _on_curves(scene, structure, reduction))
    if scene.backbone is None and scene.response is None:
        yield checked_problem(model, scene), None


def _on_curves(scene: Scene, structure: Structure, reduction: Reduction) -> Iterator[Problem]:
    """The problems at the ends of response curves and at the resonances between."""
    steps = scene.time.steps_per_period or FALLBACK_STEPS
    time = scene.time.changed(
        periods=PERIODS, steps_per_period=steps, steady="march", steady_tolerance=1e-3
    )
    model: Any = reduction.model
    frequencies = curve_frequencies(structure, scene, reduction.modes)
    for changed in extreme_scenes(scene):
        model = model._replace(
            load_histories=load_histories(changed), damping=float(changed.material.mass_damping)
        )
        problem = Problem.of(model, changed)._replace(time=time)
        family = frequency_family(problem, displaced=displacement_sines(changed.loads))
        yield from map(family, frequencies) if frequencies else (problem,)


def extreme_scenes(scene: Scene) -> list[Scene]:
    """The scenes at the ends of the curves of [response] and of its families.

    Of loads only the largest one counts.
    """
    table, changes = scene.response, list[dict[str, float]]([{}])
    assert table is not None
    given = {} if table.parameter == "frequency" else {table.parameter: (table.low, table.high)}
    if table.families is not None:
        given[table.families.key] = (min(table.families.values), max(table.families.values))
    for key, (low, high) in given.items():
        values = {high} if key.startswith("loads.") and abs(high) >= abs(low) else {low, high}
        changes = [{**change, key: value} for change in changes for value in sorted(values)]
    return [changed_scene(scene, change, si=True) if change else scene for change in changes]


def _decay(scene: Scene, model: ReducedModel) -> Task:
    """The decay of the mode of a backbone from its largest amplitude, without loads that vary."""
    table = scene.backbone
    assert table is not None
    problem = force_family(Problem.of(model, scene))(0.0)
    mode = linear_modes(problem)[table.mode - 1]
    shape = np.real(mode.shape)
    moved = shape * table.last / np.max(np.abs(model.probe @ shape))
    period = 2.0 * np.pi / mode.omega
    steps = scene.time.steps_per_period or FALLBACK_STEPS
    time = Time.of(scheme=scene.time.scheme, duration=DECAY * period, step=period / steps)
    start = mode.equilibrium + moved, 0.0 * shape, mode.sliders.copy()
    return problem._replace(period=None, time=time), start


def _moved(problem: Problem, start: tuple[Any, ...] | None, stop: Callable[[], bool]) -> Motion:
    """The motion of a problem, up to its failure if there is one."""
    try:
        return integrate(problem, start=start, stop=stop)
    except (AccuracyError, ConvergenceError) as error:
        if not isinstance(error.partial, Motion):
            raise
        return error.partial


def _trained(scene: Scene, tasks: list[Task], motions: list[Motion], spent: float) -> Trained:
    """What the motions of some tasks hold."""
    curves = [scene] if scene.response is None else extreme_scenes(scene)
    lasting = [float(m.time[-1]) for (p, _), m in zip(tasks, motions, strict=True) if not p.period]
    return Trained(
        loads=tuple(max(abs(s.loads[k].size) for s in curves) for k in range(len(scene.loads))),
        friction=tuple(
            min(s.contacts[k].friction for s in curves) for k in range(len(scene.contacts))
        ),
        amplitude=max(probe_amplitude(motion) for motion in motions),
        duration=max(lasting, default=0.0),
        dissipation=spent,
    )


def probe_amplitude(motion: Motion) -> float:
    """Half of the range of the probe, of all directions together, m."""
    return 0.5 * float(np.linalg.norm(np.ptp(np.asarray(motion.probe), axis=0)))


def beyond(trained: Trained | None, scene: Scene, motion: Motion) -> list[Note]:
    """A note if a motion asks more of the interface vectors than the motions that chose them."""
    if trained is None:
        return []
    size, length = probe_amplitude(motion), float(motion.time[-1])
    found = [
        f"loads.{k}.{load.kind} is {abs(load.size):.4g}, and was {most:.4g}"
        for k, (load, most) in enumerate(zip(scene.loads, trained.loads, strict=True))
        if abs(load.size) > LARGER * most
    ]
    found += [
        f"contacts.{k}.friction is {contact.friction:g}, and was {least:g}"
        for k, (contact, least) in enumerate(zip(scene.contacts, trained.friction, strict=True))
        if contact.friction < least / LARGER
    ]
    if size > LARGER * trained.amplitude:
        found.append(f"the probe moves by {size:.4g} m, and moved by {trained.amplitude:.4g} m")
    if motion.period is None and length > LARGER * trained.duration:
        found.append(f"the motion lasts {length:.4g} s, and lasted {trained.duration:.4g} s")
    if not found:
        return []
    text = (
        f"this run is beyond the motion that chose the interface vectors: {'; '.join(found)}; run "
        "the scene again, without --from, for an estimate of the friction"
    )
    return [Note(NoteKind.ERROR, text, "basis.masters", quantity=DISSIPATION)]


def unsettled(trained: Trained | None, scene: Scene, motion: Motion) -> list[Note]:
    """A note if friction dissipates more or less than in the same motion that chose the vectors."""
    if trained is None or scene.response or scene.backbone:
        return []
    found = dissipated(motion)
    if settled(trained.dissipation, found):
        return []
    text = (
        f"friction dissipates {found:.4g} J, and {trained.dissipation:.4g} J in the motion that "
        f"chose the interface vectors (at most {100.0 * SETTLED:g} % of difference is accepted): "
        'take basis.masters = "all", or compare with reference.full = true'
    )
    return [Note(NoteKind.ERROR, text, "basis.masters", quantity=DISSIPATION)]
