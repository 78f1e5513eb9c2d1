"""The rule by which the estimates of a finished motion decide, and if it is the only motion.

A run ends with exit code 0 only if every estimate of the error of its displacements, of all
directions together and of each, by the time step, the basis and the mesh, is known and at most its
limit:

    cause        a motion that settles, or has no period    a motion with a period that does not
                                                            settle (root mean squares)
    time step    `TIME_ERROR`                               `UNSETTLED_ERROR`
    basis        `BASIS_ERROR`                              `UNSETTLED_BASIS_ERROR`
    mesh         `MESH_ERROR`                               `UNSETTLED_BASIS_ERROR`

Near a resonance, where the amplitude at a fixed frequency says little, these limits hold for the
amplitude between motions of the same phase and for twice the shift of the frequency
(`fenicsrom.assess.errors.resonance`). A model without a mesh, and a body that is too large for
finer elements, have no estimate of the mesh error; the run says so. A run that has not reached the
stable periodic motion that Newton's method found has no estimates. Otherwise it ends with exit code
1; its files are written, and say why.

The estimates of the largest normal force, of the dissipated energy and of the worn depth refuse no
run. Above `CONTACT_ERROR`, or `UNSETTLED_ERROR` of a motion that does not settle, they cast doubt
on these quantities, and the verdict says so. Where bodies touch, the displacements are those of the
probe, and the contact displacements are one of these quantities.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fenicsrom.assess.errors.estimates import (
    BASIS_SAFETY,
    MESH_SAFETY,
    STEP_SAFETY,
    MotionErrors,
    basis_errors,
    mesh_errors,
    nested_motion,
    step_errors,
    with_range,
)
from fenicsrom.assess.errors.resonance import near_resonance
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.notes import AMPLITUDES, DISSIPATION, PEAK_FORCE, PROBE, WEAR, Note, NoteKind
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.measures import is_unsteady, misses_motion
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import end_of
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.reading import coarser, refined, step_key
from fenicsrom.words import are, counted, enumerated, two_digits

# largest accepted relative error of the amplitudes due to the time step
TIME_ERROR = 0.1
# largest accepted relative error of the root mean squares of a motion that does not settle; two
# right runs of a chaotic motion differ by some ten percent within a hundred periods
UNSETTLED_ERROR = 0.5
# largest accepted relative difference of the amplitudes from those of an enriched basis
BASIS_ERROR = 0.05
# largest accepted relative error of the amplitudes due to the mesh
MESH_ERROR = 0.1
# error of a frequency that casts doubt: that of the stiffness is twice as large
FREQUENCY_ERROR = MESH_ERROR / 2.0
# the same of the root mean squares of a motion that does not settle: half of `UNSETTLED_ERROR`,
# because both models take the same steps, and a basis that misses more is too small
UNSETTLED_BASIS_ERROR = 0.25

# largest error of a quantity of the contact that casts no doubt on it
CONTACT_ERROR = 0.1

CONTACT = {
    AMPLITUDES: "largest",
    PROBE: "probe",
    PEAK_FORCE: "peak_force",
    DISSIPATION: "dissipation",
    WEAR: "worn",
}
"""The quantities that refuse no run, and their estimates in `MotionErrors`."""

REMEDIES = {
    "time step": "shorter steps",
    "basis": "a larger basis.modes",
    "mesh": "smaller elements at the contact",
}
"""What lowers an error of each cause."""

LIMITS = {
    "time step": (TIME_ERROR, UNSETTLED_ERROR),
    "basis": (BASIS_ERROR, UNSETTLED_BASIS_ERROR),
    "mesh": (MESH_ERROR, UNSETTLED_BASIS_ERROR),
}
"""The limits of an error by its cause: of a motion that settles or has no period, and of others."""


def estimate_errors(
    model: Any,
    candidates: ReducedModel | None,
    scene: Scene,
    motion: Motion,
    errors: dict[str, MotionErrors],
    basis: MotionErrors | None = None,
    meshes: tuple[ReducedModel, ReducedModel, Sequence[int]] | None = None,
) -> None:
    """Estimate the errors of a motion and apply the rule of this module.

    Args:
        model: the model that was integrated.
        candidates: the larger model that judges its basis; None if the model has none.
        scene: the scene.
        motion: the motion.
        errors: receives the estimates by their causes, "time step", "basis" and "mesh".
        basis: the estimate of the error due to the basis, if it is known.
        meshes: models of the same coordinates on the elements of the run and on finer ones, and
            the numbers of these coordinates in the run, -1 for others; None if there are none.

    Raises:
        AccuracyError: an estimate is above its limit, or the motion has not come to the periodic
            motion that it nears; there are no estimates then.
    """
    check_settled(scene, motion)
    unsteady = is_unsteady(motion)
    joined = scene.joined
    found = step_errors(model, scene, motion)
    if found.deciding(joined) > TIME_ERROR and scene.time.tolerance is None:
        found = near_resonance(found, STEP_SAFETY, model, coarser(scene), motion, motion.end)
    errors["time step"] = with_range(found, STEP_SAFETY, model, coarser(scene), motion)
    if candidates is not None:
        basis = basis or basis_errors(motion, nested_motion(candidates, scene, motion))
        errors["basis"] = with_range(basis, BASIS_SAFETY, candidates, scene, motion)
    elif basis is not None:
        errors["basis"] = basis
    if meshes is not None:
        own, finer, numbers = meshes
        near = motion if own is model else nested_motion(own, scene, motion, numbers)
        found = mesh_errors(near or motion, near and nested_motion(finer, scene, near))
        if near is not None and found.deciding(joined) > MESH_ERROR:
            start = end_of(motion)
            if near is not motion and near.coordinates is not None and near.velocity is not None:
                start = near.coordinates[-1], near.velocity[-1], start[2]
            found = near_resonance(found, MESH_SAFETY, finer, scene, near, start)
        errors["mesh"] = with_range(found, MESH_SAFETY, finer, scene, motion)
    for cause, found in errors.items():
        shifted = found if found.shift else None
        check_error(scene, cause, found.deciding(joined), unsteady, shifted)


def check_settled(scene: Scene, motion: Motion) -> None:
    """Refuse a motion that has not reached the stable periodic motion that Newton's method found.

    Where the march comes nearer, the largest multiplier mu tells how many periods k are missing:
    mu^k times the distance is the tolerance. Otherwise the motion may be a transient as well as
    another motion, which does not repeat.

    Raises:
        AccuracyError: the motion is on its way, or not seen to be.
    """
    search = motion.search
    if search is None or not misses_motion(motion):
        return
    rate, tolerance = float(abs(search.multipliers[0])), float(scene.time.steady_tolerance or 0.0)
    if np.isfinite(search.away):
        missing = np.log(tolerance / search.away) / np.log(min(rate, 1.0 - 1e-9))
        needed = search.marched + search.periods * max(int(np.ceil(missing)), 1)
        said = (
            f"too few for this motion to settle: after {search.marched} periods it was "
            f"{in_percent(search.away)} away from the stable periodic motion that Newton's method "
            f"found, and with the largest Floquet multiplier {rate:.6g} it needs about {needed} "
            f"periods to reach it to time.steady_tolerance = {tolerance:g}: set time.periods = "
            f"{needed}"
        )
    else:
        said = (
            "this motion did not settle, and was not seen to come nearer to the stable periodic "
            f"motion that Newton's method found after {search.marched} periods (largest Floquet "
            f"multiplier {rate:.6g}): raise time.periods to find out whether it does, or set "
            "time.steady_tolerance = 0 to accept a motion that does not repeat"
        )
    raise AccuracyError(
        f"time.periods = {motion.periods}: {said}", kind=ErrorKind.CONVERGENCE, key="time.periods"
    )


def check_error(
    scene: Scene,
    cause: str,
    estimate: float,
    unsteady: bool = False,
    resonance: MotionErrors | None = None,
) -> None:
    """Refuse a motion whose estimated error is too large.

    Args:
        scene: the scene of the motion.
        cause: "time step", "basis" or "mesh".
        estimate: the relative error, infinite if there is no estimate.
        unsteady: whether the motion does not settle.
        resonance: the errors near a resonance, of which the estimate is the largest.

    Raises:
        AccuracyError: the estimate is above the limit in `LIMITS`.
    """
    allowed = LIMITS[cause][unsteady]
    if estimate <= allowed:
        return
    sentence = {"time step": _step_sentence, "basis": _basis_sentence, "mesh": _mesh_sentence}
    found, remedy, kind, key = sentence[cause](scene, estimate, unsteady)
    limit = f"{100.0 * allowed:g} % is accepted"
    if unsteady:
        limit += " for a motion that does not settle"
    if resonance is not None:
        found += (
            f", near a resonance: its frequency differs by {in_percent(resonance.shift)}, its "
            f"amplitude by {in_percent(max(resonance.amplitude, *resonance.directions))}"
        )
        limit = f"{50.0 * allowed:g} % of the frequency and {limit}"
    raise AccuracyError(f"{found} (at most {limit}): {remedy}", kind=kind, key=key)


Sentence = tuple[str, str, ErrorKind, str]
"""What is wrong, what to do, and the kind and the key of an error."""


def contact_quantities(scene: Scene) -> list[str]:
    """The quantities of `CONTACT` that a scene has beside the amplitudes."""
    if not scene.contacts:
        return []
    probe, worn = [PROBE] * (scene.probe is not None), [WEAR] * scene.wears
    return [*probe, PEAK_FORCE, DISSIPATION, *worn]


def error_notes(scene: Scene, errors: Mapping[str, MotionErrors], motion: Motion) -> list[Note]:
    """Notes on quantities whose estimated errors cast doubt on them, without a refusal.

    These are the quantities of the contact, and near a resonance the amplitudes at the frequency of
    the loads.

    Args:
        scene: the scene of the motion.
        errors: the estimates by their causes.
        motion: the motion.
    """
    allowed, found = UNSETTLED_ERROR if is_unsteady(motion) else CONTACT_ERROR, []
    for quantity in [*[AMPLITUDES] * scene.joined, *contact_quantities(scene)]:
        name = CONTACT[quantity]
        sizes = {
            cause: max(float(getattr(each, name)) for each in (error, error.from_rest or error))
            for cause, error in errors.items()
        }
        large = {cause: size for cause, size in sizes.items() if not size <= allowed}
        if large:
            text = (
                f"{_by_cause(f'the {quantity}', large)} (at most {in_percent(allowed)} casts no "
                f"doubt); {enumerated([REMEDIES[cause] for cause in large])} may lower it"
            )
            found.append(Note(NoteKind.ERROR, text, quantity=quantity))
    steep = {
        c: e.at_frequency for c, e in errors.items() if e.shift and not e.at_frequency <= allowed
    }
    if steep:
        text = (
            f"{_by_cause('the amplitude at this frequency of the loads', steep)}: next to a "
            "resonance, the amplitude changes steeply with the frequency: read both together"
        )
        found.append(Note(NoteKind.ERROR, text, quantity=AMPLITUDES))
    return found


def _by_cause(what: str, sizes: Mapping[str, float]) -> str:
    """Name the errors of a quantity by their causes, and the causes of which there is no estimate.

    Such as "the error of the peak force is 17 % by the time step, and that by the mesh could not be
    estimated".
    """
    known = [f"{in_percent(size)} by the {c}" for c, size in sizes.items() if np.isfinite(size)]
    missing = enumerated([f"the {c}" for c, size in sizes.items() if not np.isfinite(size)])
    if not known:
        return f"the error of {what} by {missing} could not be estimated"
    found = f"the estimated error of {what} is {enumerated(known)}"
    return f"{found}, and that by {missing} could not be estimated" if missing else found


def _step_sentence(scene: Scene, estimate: float, unsteady: bool) -> Sentence:
    """The sentence on an error due to the time step; arguments as `check_error`."""
    name = step_key(scene)
    given, better = (getattr(s.time, name) for s in (scene, recommended_step(scene, estimate)))
    if np.isfinite(estimate):
        coarse = "eight times the tolerance" if name == "tolerance" else "twice the step"
        run = "another step" if unsteady else coarse
        found, other = f"{run} gives an error of about {in_percent(estimate)}", ""
    else:
        differs = "settles" if unsteady else "does not settle"
        found = f"another step gives a motion that {differs}, or no motion"
        other = f"{other_scheme(scene)}; or add modes that the loads may excite, basis.modes"
    said = f"time.{name} = {given:g}: the steps are too long: a run with {found}"
    return said, f"try {name} = {better:g}{other}", ErrorKind.TIME_STEP, f"time.{name}"


def _basis_sentence(scene: Scene, estimate: float, unsteady: bool) -> Sentence:
    """The sentence on an error due to the basis; arguments as `check_error`."""
    said = "the basis is too small: a basis with the modes or derivatives that the motion lacks "
    modes = scene.basis.modes
    more = 'to more modes than "auto" takes' if modes == "auto" else f"above {modes}"
    remedy = f'lower basis.threshold, set basis.derivatives = "all", or set basis.modes {more}'
    return f"{said}gives {_difference(estimate)}", remedy, ErrorKind.BASIS, "basis"


def _mesh_sentence(scene: Scene, estimate: float, unsteady: bool) -> Sentence:
    """The sentence on an error due to the mesh; arguments as `check_error`."""
    said = f"the mesh is too coarse: elements of degree {scene.geometry.degree + 1} give "
    remedy = finer_mesh(scene, estimate)
    return f"{said}{_difference(estimate)}", remedy, ErrorKind.MESH, "geometry"


def _difference(estimate: float) -> str:
    """What another basis or mesh gives, in words."""
    if np.isfinite(estimate):
        return f"displacements that differ by {in_percent(estimate)}"
    return "a motion that does not settle, or no motion"


def in_percent(error: float) -> str:
    """A relative error in percent, with two digits or as a whole number."""
    return f"{two_digits(100.0 * error)} %"


def other_scheme(scene: Scene) -> str:
    """The end of a sentence: the scheme to try where a motion does not settle, or ""."""
    if scene.time.scheme != "discrete-gradient":
        return ""
    return (
        '; or try time.scheme = "generalised-alpha", which damps the waves that the steps do not '
        "resolve"
    )


def finer_mesh(scene: Scene, estimate: float) -> str:
    """The cheapest change of a mesh that likely brings its error below half of `MESH_ERROR`.

    The frequencies of elements of degree p converge with the order 2 p where the body is smooth. At
    corners the order is less; one order less is assumed.
    """
    degree = scene.geometry.degree
    if degree == 1:
        return "set geometry.degree = 2, which costs less than smaller elements"
    wanted = (estimate / (0.5 * MESH_ERROR)) ** (1.0 / (2 * degree - 1))
    factor = min(max(wanted, 1.5), 4.0) if np.isfinite(wanted) else 2.0
    if scene.geometry.size is not None:
        return f"make geometry.size {factor:.2g} times smaller"
    return (
        f"make the elements {factor:.2g} times smaller along the directions in which the body "
        "bends (geometry.parameters, or the mesh file)"
    )


def recommended_step(scene: Scene, estimate: float) -> Scene:
    """The scene with a step that likely brings the error below half of `TIME_ERROR`.

    The number of halvings assumes a scheme of first order, because contacts that switch may reduce
    the order to one. If the estimate is infinite, the step is halved twice.
    """
    halvings = np.log2(estimate / (0.5 * TIME_ERROR)) if np.isfinite(estimate) else 2.0
    return refined(scene, 2 ** max(1, int(np.ceil(halvings))))


def multiplicity_warnings(name: str, motion: Motion) -> list[Note]:
    """Warn that a model has another equilibrium or periodic motion than the one of a motion.

    Args:
        name: the model: "reduced", "full" or "beam".
        motion: its motion.
    """
    found = [_buckled_sentence(name, motion)] if motion.buckled else []
    if sentence := free_slider_sentence(name, motion):
        found.append(sentence)
    return [Note(NoteKind.SEVERAL, text) for text in found]


def _buckled_sentence(name: str, motion: Motion) -> str:
    """Warn that the preload has buckled a model."""
    return (
        f"the preload buckles the {name} model: its equilibrium nearest to the unloaded body is "
        f"unstable in {counted(motion.buckled, 'direction')}, so the motion starts from a stable "
        "equilibrium nearby"
    )


def free_slider_sentence(name: str, motion: Motion) -> str | None:
    """Warn that the periodic motion is not unique; None if it is."""
    search = motion.search
    if search is None or not search.accepted or search.free_sliders == 0:
        return None
    free = counted(search.free_sliders, "slider position")
    return (
        f"the periodic motion of the {name} model is not unique: {free} of contact points that "
        f"stick all the time {are(search.free_sliders)} free; the run takes the motion nearest to "
        "the marched one"
    )
