"""Checks between keys of the curves: of periodic motions, nonlinear modes and equilibria."""

from collections.abc import Iterator, Mapping

from fenicsrom.errors import ErrorKind
from fenicsrom.scene.base.rules import Problem, Problems
from fenicsrom.scene.keys.curves import Response, parameter_of
from fenicsrom.scene.keys.loads import OrderFrequency
from fenicsrom.scene.keys.schema import Scene
from fenicsrom.scene.keys.unit_system import REGIONAL
from fenicsrom.words import counted

MAY_BE_ZERO = ("mass_damping", "preload", "gap", "friction")  # parameters of a response curve


def uses_balance(scene: Scene) -> bool:
    """Whether response curves are found by harmonic balance: by the scene, or as of a disk."""
    response = scene.response
    return response is not None and (response.method == "balance" or scene.cyclic is not None)


def _balance_problems(scene: Scene, response: Response) -> Problems:
    """Yield what curves by harmonic balance cannot do."""
    unusual: dict[str, object] = {
        "response.branches": response.branches,
        "response.isolated": response.isolated,
        "response.peak_over": response.peak_over,
        "response.full": response.full,
        "rotation.history": scene.rotation is not None and scene.rotation.history,
        **{f"loads[{k}].follower": True for k in scene.followers},
        **{
            f"contacts[{k}].abradable": contact.abradable
            for k, contact in enumerate(scene.contacts)
        },
    }
    for key in filter(unusual.get, unusual):
        yield Problem(key, "not allowed in response curves by harmonic balance")
    if response.parameter == "rotation.speed_rpm":
        allowed = 'only allowed with response.method = "shooting"'
        if scene.cyclic is not None:
            allowed = (
                "not allowed with [cyclic], whose stiffness is that of one speed: follow a range "
                "of frequency at a critical speed (fenicsrom campbell) in rotation.speed_rpm, "
                "or run fenicsrom sweep --over rotation.speed_rpm, which makes a disk at each speed"
            )
        yield Problem("response.parameter", allowed)
    if scene.cyclic is None:
        return
    orders = [load.order for load in scene.loads if not load.static]
    if min(orders, default=0) == 0 < max(orders, default=0):
        allowed = "must be an engine_order in response curves of a disk, as of the other loads"
        yield Problem(f"loads[{orders.index(0)}].frequency", allowed)


def response_problems(scene: Scene) -> Problems:
    """Yield the problems of the table [response]."""
    response = scene.response
    if response is None:
        return
    if scene.period is None:
        yield Problem("response.parameter", "only allowed in a scene whose loads repeat")
    if response.last == response.first:
        allowed = f"must differ from response.first = {response.first:g}"
        yield Problem("response.last", allowed, ErrorKind.RANGE)
    for value in response.isolated or ():
        if not response.low <= value <= response.high:
            allowed = f"must be from {response.low:g} to {response.high:g}"
            yield Problem("response.isolated", allowed, ErrorKind.RANGE)
    for k, value in enumerate(response.full_values):
        if not response.low <= value <= response.high:
            allowed = f"must be from first, {response.first:g}, to last, {response.last:g}"
            yield Problem(f"response.full[{k}]", allowed, ErrorKind.RANGE)
            return
    if uses_balance(scene):
        yield from _balance_problems(scene, response)
    yield from _peak_problems(scene, response)
    if response.parameter == "rotation.speed_rpm":
        yield from _speed_problems(scene, response)
    table, index, name = parameter_of(response.parameter)
    if table in ("loads", "contacts") and index >= len(getattr(scene, table)):
        present = len(getattr(scene, table))
        allowed = f"the scene has {counted(present, table[:-1])}, numbered from 0"
        if present == 0:
            allowed = f"the scene has no {table}"
        yield Problem("response.parameter", allowed, ErrorKind.RANGE)
    elif table == "loads":
        load = scene.loads[index]
        if load.static or load.kind != name:
            kind = f"static {load.kind}" if load.static else load.kind
            allowed = f"loads[{index}] is a {kind}; must be the size of a load that repeats"
            yield Problem("response.parameter", allowed)
    if response.low == 0.0 and name not in MAY_BE_ZERO:
        key = "response.first" if response.first == 0.0 else "response.last"
        yield Problem(key, "must be above 0", ErrorKind.RANGE)
    if table == "contacts" and name == "gap" and _has_radius(scene, index):
        allowed = "not allowed with surface.radius, which determines the gap"
        yield Problem("response.parameter", allowed)


def _speed_problems(scene: Scene, response: Response) -> Problems:
    """Yield what a curve over the speed of rotation needs."""
    key = "response.parameter"
    if not scene.geometrically_nonlinear:
        allowed = (
            "must be true in a curve over rotation.speed_rpm: the equilibrium changes along it"
        )
        yield Problem("geometrically_nonlinear", allowed)
    if scene.speeds_rpm is None:
        yield Problem(key, "needs rotation.speeds_rpm, one model for all speeds")
        return
    ends = {"response.first": response.first, "response.last": response.last}
    yield from speed_problems(scene.speeds_rpm, ends)
    for allowed in beside_speed(scene):
        yield Problem(key, allowed)


def beside_speed(scene: Scene) -> Iterator[str]:
    """Yield what does not follow the speed of rotation: frequencies, and surfaces that turn."""
    for k, load in enumerate(scene.loads):
        if load.frequency is not None and not isinstance(load.frequency, OrderFrequency):
            yield f"needs an engine_order for loads[{k}]: its frequency must follow the speed"
    for k, contact in enumerate(scene.contacts):
        if contact.surface is not None and contact.surface.spin:
            yield f"not allowed with contacts[{k}].surface.spin"


def speed_problems(speeds: tuple[float, ...], given: Mapping[str, float]) -> Problems:
    """Yield given speeds, by their keys, that are out of the range of `rotation.speeds_rpm`."""
    first, *_, last = speeds
    for key, speed in given.items():
        if not first <= speed <= last:
            allowed = f"must be in the range of rotation.speeds_rpm, {first:g} to {last:g}"
            yield Problem(key, allowed, ErrorKind.RANGE, value=speed)


def keys_over(scene: Scene, over: str) -> list[str]:
    """The keys of `response.peak_over`: one, or one for each contact where it has a star."""
    return [over.replace("*", f"{k}") for k in range(len(scene.contacts) if "*" in over else 1)]


def values_over(scene: Scene, over: str) -> list[float]:
    """The numbers of the scene with these keys; none if the scene lacks such a contact."""
    table, *which, name = over.split(".")
    if table == "material":
        return [float(getattr(scene.material, name))]
    chosen = scene.contacts if which == ["*"] else scene.contacts[int(which[0]) :][:1]
    return [float(getattr(contact, name)) for contact in chosen]


def _peak_problems(scene: Scene, response: Response) -> Problems:
    """Yield the problems of the keys `peak_over` and `peak_range`."""
    over, given = response.peak_over, response.peak_range
    if over is None:
        if given is not None:
            yield Problem("response.peak_range", "only allowed with peak_over")
        return
    if response.parameter != "frequency":
        yield Problem("response.peak_over", 'needs response.parameter = "frequency"')
    values = values_over(scene, over)
    if not values:
        allowed = f"the scene has {counted(len(scene.contacts), 'contact')}, numbered from 0"
        yield Problem("response.peak_over", allowed, ErrorKind.RANGE)
        return
    regions = {contact.place.at == "nodes" for contact in scene.contacts}
    if "*" in over and over.rsplit(".", 1)[-1] in REGIONAL and len(regions) > 1:
        allowed = "not allowed with contacts at points and with the nodes of regions"
        yield Problem("response.peak_over", allowed)
    if min(values) <= 0.0 or min(values) < max(values):
        allowed = "needs a number above 0 in the scene, where the peaks begin"
        if "*" in over:
            allowed += ", the same of all contacts"
        yield Problem("response.peak_over", allowed, ErrorKind.RANGE)
    elif given is not None and not (len(given) == 2 and given[0] <= values[0] <= given[1]):
        allowed = f"must be two numbers, with the {values[0]:g} of the scene between them"
        yield Problem("response.peak_range", allowed, ErrorKind.RANGE)


def backbone_problems(scene: Scene) -> Problems:
    """Yield the problems of the table [backbone]."""
    backbone = scene.backbone
    if backbone is None:
        return
    if not backbone.last > backbone.first:
        allowed = f"must be above backbone.first = {backbone.first:g}"
        yield Problem("backbone.last", allowed, ErrorKind.RANGE)
    factors = backbone.load_factors
    if list(factors) != sorted(factors):
        yield Problem("backbone.load_factors", "must be in ascending order", ErrorKind.RANGE)
    if factors and scene.period is None:
        yield Problem("backbone.load_factors", "only allowed in a scene whose loads repeat")


def statics_problems(scene: Scene) -> Problems:
    """Yield the problems of the table [statics]."""
    for index, number in enumerate(scene.statics.loads or ()):
        if number >= len(scene.loads):
            allowed = f"must be below the number of loads, {len(scene.loads)}"
            yield Problem(f"statics.loads[{index}]", allowed, ErrorKind.RANGE)
        elif not scene.loads[number].static:
            yield Problem(f"statics.loads[{index}]", "must be the number of a static load")


def _has_radius(scene: Scene, index: int) -> bool:
    """Whether a contact has a surface of a given radius."""
    surface = scene.contacts[index].surface if index < len(scene.contacts) else None
    return surface is not None and surface.radius is not None
