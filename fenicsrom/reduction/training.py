"""The motions that choose the interface vectors of bodies that touch (`reduction.interface`).

They are the motion of the scene, with [backbone] the decay of the mode from its largest amplitude,
or with [response] a few motions of each curve (`fenicsrom.assess.curves.checks.curve_motions`).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from fenicsrom.notes import DISSIPATION, PEAK_FORCE, Note, NoteKind
from fenicsrom.online.contact.points import closed_springs, contacts_of, springs_of, trial_forces
from fenicsrom.online.curves.nonlinear_mode import linear_modes
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.motion import Motion, attempted
from fenicsrom.online.periodic.shooting import FALLBACK_STEPS, force_family
from fenicsrom.online.run.march import integrate
from fenicsrom.online.run.simulate import checked_problem
from fenicsrom.online.store.scene_changes import Trained
from fenicsrom.progress import log
from fenicsrom.reduction import interface
from fenicsrom.reduction.interface import SETTLED, dissipated, settled
from fenicsrom.reduction.protocols import Structure
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Scene
from fenicsrom.scene.keys.times import Time
from fenicsrom.scene.reading.overrides import as_given

DECAY = 10.0
"""Periods for which the mode of a backbone decays."""

LARGER = 1.02
"""A motion is beyond that of the training if it is larger or longer by this factor."""

STIFFER = 2.0
"""Forces at rest of a contact of twice the stiffness are right to 0.1 %; of a twentieth to 4 %."""

Moves = Callable[[Reduction], Sequence[Motion]]
"""Gives the motions of a reduced model that choose the vectors of the next one."""


def train(structure: Structure, scene: Scene, moves: Moves, scenes: Sequence[Scene]) -> Trained:
    """Let motions choose the `interface` vectors of a structure.

    Args:
        structure: the structure.
        scene: the scene.
        moves: gives the motions.
        scenes: the scenes of the motions, between which loads and contacts may differ.

    Returns:
        What the last motions hold.

    Raises:
        ConvergenceError, AccuracyError: a stage failed, or a motion at its start.
    """
    contacts, d = contacts_of(scene, structure.points), structure.dimension
    x = structure.comm.allreduce(structure.contact_rows @ structure.equilibrium)
    springs, closed, force = springs_of(contacts, d), closed_springs(contacts, x), 0.0 * x
    force[::d] = trial_forces(contacts, x).clip(0.0)
    spent = np.nan
    for number in range(1, interface.PASSES + 1):
        motions = moves(Reduction(structure, scene, lambda stage: nullcontext()))
        before, spent = spent, max(map(dissipated, motions))
        log.info(f"  motion {number}: friction dissipates {spent:.4g} J")
        vectors = interface.interface_vectors(springs, closed, (x, force), motions)
        structure.interface = vectors if vectors.shape[1] else None
        if settled(before, spent):
            break
    else:
        text = (
            f"the friction of the motions that choose the interface vectors still changes after "
            f"{interface.PASSES} rounds, from {before:.4g} J to {spent:.4g} J (at most "
            f'{100.0 * SETTLED:g} % is accepted): take basis.masters = "all"'
        )
        structure.warnings.append(Note(NoteKind.ERROR, text, "basis.masters", quantity=DISSIPATION))
    loads = zip(*(each.loads for each in scenes), strict=True)
    pairs = zip(*(each.contacts for each in scenes), strict=True)
    return Trained(
        loads=tuple(max(abs(load.size) for load in same) for same in loads),
        friction=tuple(min(contact.friction for contact in same) for same in pairs),
        amplitude=max(map(probe_amplitude, motions)),
        duration=max(map(duration, motions)),
        dissipation=spent,
    )


def motion_of_scene(model: Any, scene: Scene) -> list[Motion]:
    """The motion of a scene, or the decay of its mode."""
    start: tuple[Any, ...] | None = None
    if scene.backbone is not None:
        problem, start = _decay(scene, model)
    else:
        problem = checked_problem(model, scene)
    return [attempted(lambda: integrate(problem, start=start))[0]]


def _decay(scene: Scene, model: ReducedModel) -> tuple[Problem, tuple[Any, ...]]:
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


def probe_amplitude(motion: Motion) -> float:
    """Half of the range of the probe, of all directions together, m."""
    return 0.5 * float(np.linalg.norm(np.ptp(np.asarray(motion.probe), axis=0)))


def duration(motion: Motion) -> float:
    """Duration of a motion that does not repeat, s; 0 of one that does."""
    return float(motion.time[-1]) if motion.period is None else 0.0


def beyond(trained: Trained | None, scene: Scene, size: float, length: float = 0.0) -> list[Note]:
    """Notes if motions ask more of the interface vectors than the motions that chose them.

    Args:
        trained: what the motions that chose them hold.
        scene: the scene of the motions.
        size: their largest `probe_amplitude`, m.
        length: the duration of one that does not repeat, s.
    """
    if trained is None:
        return []
    notes = [*_other_stiffness(trained)]
    if not any(trained.friction + tuple(c.friction for c in scene.contacts)):
        return notes
    found = []
    for k, (load, most) in enumerate(zip(scene.loads, trained.loads, strict=True)):
        if abs(load.size) > LARGER * most:
            key = f"loads.{k}.{load.kind}"
            now, was = (as_given(scene, key, size) for size in (abs(load.size), most))
            found.append(f"{key} is {now:.4g}, and was {was:.4g}")
    found += [
        f"contacts.{k}.friction is {contact.friction:g}, and was {least:g}"
        for k, (contact, least) in enumerate(zip(scene.contacts, trained.friction, strict=True))
        if contact.friction < least / LARGER
    ]
    if size > LARGER * trained.amplitude:
        found.append(f"the probe moves by {size:.4g} m, and moved by {trained.amplitude:.4g} m")
    if length > LARGER * trained.duration:
        found.append(f"the motion lasts {length:.4g} s, and lasted {trained.duration:.4g} s")
    for key, *values in trained.changed:
        was, now = ("not given" if x is None else as_given(scene, key, x) for x in values)
        found.append(f"{key} is {now}, and was {was}")
    if not found:
        return notes
    text = (
        f"this run is beyond the motion that chose the interface vectors: {'; '.join(found)}; run "
        'the scene again without --from, or with basis.masters = "all", for an estimate of the '
        "friction"
    )
    return [*notes, Note(NoteKind.ERROR, text, "basis.masters", quantity=DISSIPATION)]


def _other_stiffness(trained: Trained) -> Iterator[Note]:
    """A note on each contact whose new forces at rest the coordinates may not hold."""
    for key, was, now in trained.changed:
        if key.endswith(".normal_stiffness") and max(now / was, was / now) > STIFFER:
            text = (
                f"{key} is {now / was:.3g} times that of the run that made the model: the contact "
                "forces at rest come from its coordinates, and their error is not estimated; run "
                "the scene again without --from"
            )
            yield Note(NoteKind.UNCHECKED, text, key, quantity=PEAK_FORCE)


def unsettled(trained: Trained | None, scene: Scene, motion: Motion) -> list[Note]:
    """A note if friction dissipates more or less than in the same motion that chose the vectors."""
    if trained is None or scene.backbone or scene.response:
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
