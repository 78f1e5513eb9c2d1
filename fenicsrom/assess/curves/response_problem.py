"""The periodic problems of a scene with response curves: by their parameter, and at a start."""

import re

import numpy as np

from fenicsrom.assess.curves.results import Reduced, require_polynomial, response_table
from fenicsrom.errors import ConvergenceError, ErrorKind, SceneError, refuse
from fenicsrom.online.contact.points import shares
from fenicsrom.online.model.loads import displacement_sines
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic import shooting
from fenicsrom.online.run.march import integrate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.scene_changes import changed_path
from fenicsrom.scene import (
    Families,
    Scene,
    Time,
    override_table,
    parameter_of,
    parse_scene,
    scene_table,
)
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.checks.contact_checks import require_repeating
from fenicsrom.scene.reading.overrides import in_words, names_of

START_PERIODS = 320  # largest number to march before a curve starts


def check_response(scene: Scene) -> None:
    """Check before the offline stage that the curves of a scene can be computed.

    Raises:
        SceneError: there is no table [response], nothing excites the body, the model would not be
            an exact polynomial, a surface does not repeat, the scene may not have the parameter of
            an end of the curves, the second number of the curves cannot be used, or a disk is not
            tuned.
    """
    table = response_table(scene)
    if scene.cyclic is not None and scene.cyclic.mistuning is not None:
        reason = "not allowed in response curves: a wave needs a tuned disk"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "cyclic.mistuning")
    _check_excitation(scene, scene)
    require_repeating(scene)
    require_polynomial(scene, "response curves")
    if table.parameter not in ("frequency", "rotation.speed_rpm"):
        for key, value in (("response.first", table.first), ("response.last", table.last)):
            try:
                _changed(scene, table.parameter, value, f"{scene.source}: {key}")
            except SceneError as error:
                raise SceneError(
                    str(error), kind=error.kind, key=key, source=scene.source
                ) from error
    if table.families is not None:
        _check_families(scene, table.parameter, table.families)


def _changed(scene: Scene, key: str, value: float, place: str) -> Scene:
    """The scene with another value of a key; the place names it in errors.

    Raises:
        SceneError: the scene may not have this value.
    """
    table = override_table(scene_table(scene), {key: value}, place)
    return parse_scene(table, place, None)


def scenes_of_curves(scene: Scene) -> list[Scene]:
    """The scenes at both ends of each curve, but for its frequency or speed."""
    table, found = response_table(scene), [scene]
    if (families := table.families) is not None:
        found = [_changed(scene, families.key, v, str(scene.source)) for v in families.values]
    if table.parameter not in ("frequency", "rotation.speed_rpm"):
        ends, key = (table.first, table.last), table.parameter
        found = [_changed(each, key, v, str(scene.source)) for each in found for v in ends]
    return found


def of_curves(stored: StoredModel) -> StoredModel:
    """The model of the curves of its scene: over the speed of rotation, one for all speeds.

    Raises:
        ConvergenceError: as `StoredModel.over_speeds`.
    """
    table = response_table(stored.scene)
    if table.parameter != "rotation.speed_rpm":
        return stored
    return stored.over_speeds(table.low, table.high)


def _check_excitation(scene: Scene, given: Scene) -> None:
    """Check that something excites the body.

    Args:
        scene: the scene, or the one of a curve.
        given: the scene of all curves.

    Raises:
        SceneError: all loads that vary are zero, and no surface has waves.
    """
    parameter = response_table(given).parameter
    varies = [(k, load) for k, load in enumerate(scene.loads) if not load.static]
    waves = any(contact.surface and contact.surface.waves for contact in scene.contacts)
    varied = any(load.size or parameter == f"loads.{k}.{load.kind}" for k, load in varies)
    if not waves and not varied:
        keys = [f"loads[{k}].{load.kind}" for k, load in varies]
        zero = " and ".join(f"{key} = 0" for key in keys)
        said = f"{given.source}: {zero}: nothing excites the body, so a response "
        said += "curve has no motion; give a load that varies a size other than zero"
        raise SceneError(said, kind=ErrorKind.RANGE, key=keys[0], source=given.source)


def _check_families(scene: Scene, parameter: str, families: Families) -> None:
    """Check the second number of the curves.

    Raises:
        SceneError: the scene has no such number; the number has no effect on a curve or belongs to
            the offline stage; or a value is not allowed.
    """
    key = ".".join(names_of(families.key))

    def refusal(reason: str, kind: ErrorKind) -> SceneError:
        return Where(str(scene.source), "response.families.key").refuse(families.key, reason, kind)

    if parameter == "frequency" and re.fullmatch(r"(loads\.[0-9]+\.)?frequency", key):
        reason = "the frequency is the parameter of the curves already; choose another number"
        raise refusal(reason, ErrorKind.CONFLICT)
    if key == parameter or key.startswith("response."):
        raise refusal("must be a number that [response] does not set", ErrorKind.CONFLICT)
    place = f"{scene.source}: response.families.values"
    for value in families.values:
        try:
            changed = _changed(scene, families.key, value, place)
        except SceneError as error:
            if error.kind in (ErrorKind.FORMAT, ErrorKind.UNKNOWN_KEY):
                reason = (
                    'the scene has no such number; must be a key of it, such as "loads.0.force"'
                )
                raise refusal(reason, ErrorKind.RANGE) from error
            raise SceneError(
                str(error), kind=error.kind, key="response.families.values", source=scene.source
            ) from error
        _check_excitation(changed, scene)
        if (other := changed_path(scene, changed)) is not None:
            raise refusal(f"{other} cannot change on a reduced model", ErrorKind.MISMATCH)


def family_of(stored: Reduced) -> shooting.Family:
    """The periodic problems of a stored model by the parameter of its [response] table.

    Raises:
        SceneError: the scene has no table [response].
    """
    key, problem = response_table(stored.scene).parameter, _settled(stored)
    table, index, name = parameter_of(key)
    if table == "":
        return shooting.frequency_family(
            problem,
            spin=bool(np.any(problem.contacts.height)),
            displaced=displacement_sines(stored.scene.loads),
        )
    if table == "material":
        return shooting.damping_family(problem)
    if (rotation := stored.scene.rotation) is not None and table == "rotation":
        return shooting.speed_family(
            problem, rotation.speed_rpm, displacement_sines(stored.scene.loads)
        )
    if table == "loads":  # a load of size 1 times the parameter
        return shooting.force_family(_settled(stored.with_values({key: 1.0})), index)
    mine = (stored.model.points.contact == index).astype(float)
    if name == "gap":  # the parameter is added to a gap of zero
        problem = _settled(stored.with_values({key: 0.0}))
    elif name != "friction":  # numbers of a node are those of a unit of its area
        mine = mine * shares(stored.scene, stored.model.points)
    return shooting.contact_family(problem, name, mine)


def _settled(stored: Reduced) -> Problem:
    """The problem of a stored model after the approach of its surfaces."""
    return Problem.of(stored.model, stored.scene).settled()


def shooting_of(stored: Reduced, family: shooting.Family, periods: int = 1) -> shooting.Shooting:
    """The equation of motions of some periods; all pieces share the scales of the variables."""
    return shooting.Shooting(family(response_table(stored.scene).high), periods)


def start_motion(stored: Reduced, family: shooting.Family, value: float) -> shooting.PeriodicMotion:
    """The periodic motion at a value of the parameter: a march from rest, then Newton's method.

    Raises:
        ConvergenceError, AccuracyError: no motion was found; the error names the value.
    """
    scene, problem = stored.scene, family(value)
    key, radius = response_table(scene).parameter, scene.time.spectral_radius
    place = in_words(scene, key, value)
    settings = Time.of(
        scheme=scene.time.scheme,
        periods=START_PERIODS,
        steps_per_period=scene.time.steps_per_period or shooting.FALLBACK_STEPS,
        steady_tolerance=1e-5,
        **({} if radius is None else {"spectral_radius": radius}),
    )
    try:
        return shooting.periodic_motion(problem, integrate(problem._replace(time=settings)).end)
    except ConvergenceError as error:
        raise ConvergenceError(
            f"response: at {place} no periodic motion was found: {error}",
            kind=ErrorKind.CONVERGENCE,
        ) from error
