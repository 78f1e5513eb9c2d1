"""Overrides of single keys, such as `loads.0.force=200`, axes of sweeps, and units of keys.

The axes of a sweep: lists and ranges of values of scene keys.

    loads.0.force=[50, 100, 150]       a list, as TOML writes it
    loads.0.frequency=3.0:3.4:21       21 values in equal steps, both ends included
    contacts.0.friction=0.01:1:5:log   5 values in equal ratios

The runs of a sweep are all combinations of the values of its axes. The keys of one axis change
together.
"""

import copy
import itertools
import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.scene.base.rules import Rule, Where, is_number, is_sequence, show
from fenicsrom.scene.base.tables import keys, plain, table_kind, toml_value, without_alternatives
from fenicsrom.scene.keys.loads import Load
from fenicsrom.scene.keys.schema import Scene
from fenicsrom.scene.keys.times import Time
from fenicsrom.scene.keys.unit_system import PER_AREA, REGIONAL, Units, table_in_si

MOST_RUNS = 100_000
DIGITS = 12  # of the values of a range, so that 0.1 does not become 0.10000000000000001


@dataclass(frozen=True)
class Axis:
    """Keys of the scene that change together.

    Attributes:
        keys: their paths.
        values: for each position on the axis, one value of each key.
    """

    keys: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...]

    def overrides(self, position: int) -> list[str]:
        """The overrides of a position, one for each key."""
        return [
            f"{key}={json.dumps(value, ensure_ascii=False)}"
            for key, value in zip(self.keys, self.values[position], strict=True)
        ]


def make_axes(over: Sequence[str], together: Sequence[str] = ()) -> tuple[Axis, ...]:
    """Read the axes of a sweep.

    Args:
        over: texts KEY=VALUES, each of which is an axis.
        together: texts KEY=VALUES of keys that change together; they form one axis, the last one.

    Raises:
        SceneError: there is no axis, a text is not KEY=VALUES, a value has another type than its
            key, a key occurs twice, the keys that change together have different numbers of
            values, or there are more than `MOST_RUNS` runs.
    """
    axes = [Axis((key,), tuple((value,) for value in values)) for key, values in map(_read, over)]
    if together:
        keys, lists = zip(*map(_read, together), strict=True)
        counts = {key: len(values) for key, values in zip(keys, lists, strict=True)}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{key} has {count}" for key, count in counts.items())
            raise _refuse_values(
                "--zip", f"the keys need equally many values, but {listed}", keys[0]
            )
        axes.append(Axis(tuple(keys), tuple(zip(*lists, strict=True))))
    if not axes:
        sentence = "sweep: give at least one axis, such as --over loads.0.force=50:150:11"
        raise SceneError(sentence, kind=ErrorKind.MISSING, key="--over")
    keys = [key for axis in axes for key in axis.keys]
    for key in keys:
        if keys.count(key) > 1:
            raise _refuse_values("--over", f"{key} is given twice", key)
    count = math.prod(len(axis.values) for axis in axes)
    if count > MOST_RUNS:
        raise _refuse_values("--over", f"{count} runs are too many: at most {MOST_RUNS}", keys[0])
    return tuple(axes)


def combinations(axes: Sequence[Axis]) -> Iterator[tuple[int, ...]]:
    """The positions of all runs on the axes; the last axis changes fastest."""
    return itertools.product(*(range(len(axis.values)) for axis in axes))


def _read(text: str) -> tuple[str, list[Any]]:
    """Read the key and the values of `KEY=VALUES`."""
    key, equals, values = (part.strip() for part in text.partition("="))
    if not key or not equals:
        raise _refuse_values(text, "must be KEY=VALUES, where VALUES is a list or a range", key)
    found = _list(text, key, values) if values.startswith("[") else _range(text, key, values)
    if rule := _rule(names_of(key)):
        for value in found:
            try:
                rule(value, Where("sweep", key))
            except SceneError as error:
                if error.kind is ErrorKind.TYPE:  # others may be a bound, and fail in their run
                    raise
    return key, found


def _list(text: str, key: str, values: str) -> list[Any]:
    """Read a list of numbers, texts, truth values, or lists of these."""
    try:
        table = tomllib.loads(f"values = {values}")
        found = table["values"] if len(table) == 1 else None
        json.dumps(found, allow_nan=False)
    except (ValueError, TypeError):
        found = None
    if not isinstance(found, list) or not found or any(isinstance(item, dict) for item in found):
        reason = "the list must hold values as TOML writes them, such as [50, 100] or ['a', 'b']"
        raise _refuse_values(text, reason, key)
    return found


def _range(text: str, key: str, values: str) -> list[float | int]:
    """Read a range FIRST:LAST:COUNT or FIRST:LAST:COUNT:log."""
    parts = [part.strip() for part in values.split(":")]
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        first, last, count = math.nan, math.nan, 0
    spacing = parts[3] if len(parts) == 4 else "" if len(parts) == 3 else None
    if not (is_number(first) and math.isfinite(first) and math.isfinite(last)) or not (
        2 <= count <= MOST_RUNS and spacing in ("", "log")
    ):
        reason = "must be a list in brackets, or FIRST:LAST:COUNT or FIRST:LAST:COUNT:log with at "
        raise _refuse_values(text, reason + "least 2 values", key)
    if first == last:
        raise _refuse_values(text, "the ends of a range must differ", key)
    if spacing == "log" and not (first > 0.0 and last > 0.0):
        raise _refuse_values(text, "a range with equal ratios needs ends above 0", key)
    shares = [k / (count - 1) for k in range(count)]
    if spacing == "log":
        spaced = [first * (last / first) ** part for part in shares]
    else:
        spaced = [first + (last - first) * part for part in shares]
    return [_whole(float(f"{value:.{DIGITS}g}")) for value in spaced]


def _refuse_values(text: str, reason: str, key: str) -> SceneError:
    """Make the error of an axis."""
    return SceneError(f"sweep: {show(text)}: {reason}", kind=ErrorKind.FORMAT, key=key)


Overrides = str | Sequence[str] | Mapping[str, Any]
"""Changes of a scene: one or several texts KEY=VALUE, or the new values by their keys."""

# tables whose keys exclude each other, by the first name and the number of names before the key
ALTERNATIVES: dict[tuple[str, int], type] = {("time", 1): Time, ("loads", 2): Load}


def override_texts(overrides: Overrides) -> list[str]:
    """Write overrides as texts KEY=VALUE, with the values as TOML writes them.

    Raises:
        SceneError: TOML has no such value.
    """
    if not isinstance(overrides, Mapping):
        return [overrides] if isinstance(overrides, str) else list(overrides)
    try:
        return [f"{key}={toml_value(plain(_whole(value)))}" for key, value in overrides.items()]
    except TypeError as error:
        sentence = f"overrides {show(overrides)}: {error}"
        raise SceneError(sentence, kind=ErrorKind.TYPE) from None


def _whole(value: Any) -> Any:
    """A whole number as an integer, which keys of integers and of other numbers take."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def override_table(table: Mapping[str, Any], overrides: Overrides, source: str) -> dict[str, Any]:
    """Give a copy of the table of a scene with some of its values replaced.

    Missing tables on the path of a key are made; entries of lists must exist. A new key of [time]
    or of a load removes the keys that it excludes: `time.tolerance=1e-4` removes
    `steps_per_period`, and `loads.0.pulse={duration=0.01}` removes `frequency`.

    Args:
        table: the plain data of a scene.
        overrides: one or several texts KEY=VALUE, with the value as TOML writes it, or the new
            values by their keys.
        source: name of the table in messages.

    Returns:
        The new table, not yet checked.

    Raises:
        SceneError: an override has no `=`, its value is not TOML, or its path leads nowhere.
    """
    changed = dict(table)
    for override in override_texts(overrides):
        names, value = parsed_override(override, source)
        branch: Any = changed
        for depth, name in enumerate(names):
            numbered = re.fullmatch(r"[0-9]{1,6}", name)
            if isinstance(branch, list) and numbered and int(name) < len(branch):
                step: Any = int(name)
            elif isinstance(branch, dict):
                step = name
            else:
                reason = f"{'.'.join(names[:depth])} {_no_entry(branch, name)}"
                raise _refuse(override, source, reason)
            if depth == len(names) - 1:
                if (kind := ALTERNATIVES.get((names[0], depth))) and isinstance(branch, dict):
                    kept = without_alternatives(kind, branch, name)
                    branch.clear()
                    branch |= kept
                branch[step] = value
            else:  # copy only the tables on the way to the key
                inner = branch.get(step, {}) if isinstance(branch, dict) else branch[step]
                branch[step] = copy.copy(inner)
                branch = branch[step]
    return changed


def names_of(key: str) -> list[str]:
    """The names on the path of a key; an entry of a list is `loads.0` or `loads[0]`."""
    return [name.strip() for name in key.replace("[", ".").replace("]", "").split(".")]


def parsed_override(override: str, source: str) -> tuple[list[str], Any]:
    """Give the names on the path of an override, and its value.

    Raises:
        SceneError: the override has no `=`, or its value is not TOML.
    """
    path, equals, text = override.partition("=")
    names = names_of(path)
    if not equals or not all(names):
        raise _refuse(override, source, "must be KEY=VALUE, such as loads.0.force=200")
    try:
        value = tomllib.loads(f"value = {text}")
    except ValueError:
        value = {}
    if list(value) != ["value"]:
        reason = "the value must be written as in TOML, text in quotes"
        raise _refuse(override, source, reason)
    return names, value["value"]


def _refuse(override: str, source: str, reason: str) -> SceneError:
    sentence = f"{source}: override {show(override)}: {reason}"
    key = override.partition("=")[0].strip()
    return SceneError(sentence, kind=ErrorKind.FORMAT, key=key, source=source)


def _no_entry(branch: Any, name: str) -> str:
    """Say why a table, a list or a value of a scene has no such entry."""
    if not isinstance(branch, list):
        return "is not a table"
    if not branch:
        return f"is empty: it has no entry {name}"
    last = len(branch) - 1
    numbers = f"entries are numbered from 0 to {last}" if last else "the only entry is 0"
    return f"has no entry {name}: {numbers}"


ALONG = ("first", "last", "isolated", "full", "peak_range")
"""Keys of [response] in the unit of its parameter, the last one in that of `peak_over`."""


def unit_of(scene: Scene, path: str) -> str:
    """The unit of the number that a key such as `loads.0.force` holds.

    A number without a unit gives "". So does the stiffness or preload of a contact with the nodes
    of a region in SI units, because its unit depends on the region; in other units it is held per
    area (`fenicsrom.online.contact.points.shares`). The key "frequency" is the lowest frequency of
    the loads, as in the table [response].
    """
    if path == "frequency":
        return "Hz"
    names = names_of(path)
    unit, _ = _found(names)
    if _is_regional(scene, names):
        return "" if scene.units.is_si else PER_AREA.get(unit, unit)
    return "" if "," in unit else unit  # of the columns of a table


def _rule(names: list[str]) -> Rule | None:
    """The rule of the key with these names; None if there is no such key."""
    kind: type | None = Scene
    rule: Rule | None = None
    for name in names:
        if name.isdecimal() or name == "*":
            continue
        rule = next((rule for key, rule, *_ in keys(kind) if key == name), None) if kind else None
        if rule is None:
            return None
        kind = table_kind(rule)
    return rule


def _found(names: list[str]) -> tuple[str, type | None]:
    """The unit of the key with these names, and the dataclass of its table if it is a table."""
    rule = _rule(names)
    return ("", None) if rule is None else (rule.unit, table_kind(rule))


def given_unit_of(scene: Scene, path: str) -> str:
    """The unit in which the file of the scene gives the number of a key, by its [units]."""
    return scene.units.name_of(unit_of(scene, path))


def as_given(scene: Scene, path: str, value: Any) -> Any:
    """The value of a key of a scene in the units of its file; the scene itself is in SI units."""
    return scene.units.from_si(value, _whole_unit(scene, path))


def _whole_unit(scene: Scene, path: str) -> str:
    """As `unit_of`, but per area for a contact with the nodes of a region."""
    names = names_of(path)
    unit = _found(names)[0]
    if names[:1] == ["response"] and names[-1] in ALONG and scene.response is not None:
        over = scene.response.peak_over if names[-1] == "peak_range" else None
        return _whole_unit(scene, over or scene.response.parameter)
    return PER_AREA.get(unit, unit) if _is_regional(scene, names) else unit_of(scene, path)


def override_in_si(scene: Scene, override: str) -> str:
    """An override of a stored scene, written in the units of its [units], in SI units.

    Raises:
        SceneError: the override is not written as an override.
    """
    if scene.units.is_si:
        return override
    names, value = parsed_override(override, scene.source)
    path, kind = ".".join(names), _found(names)[1]
    if isinstance(value, Mapping) and kind is not None:
        value = table_in_si(value, kind, scene.units)
    elif "," in (unit := _found(names)[0]):
        value = scene.units.rows_in_si(value, unit)
    elif path != "response.full" or is_sequence(value):
        value = scene.units.in_si(value, _whole_unit(scene, path))
    return f"{path} = {toml_value(value)}"


def scene_in_si(table: Mapping[str, Any], scene: Scene, units: Units) -> dict[str, Any]:
    """The plain data of a scene in SI units.

    Args:
        table: the data, as the file has it.
        scene: the scene with the numbers of the file.
        units: the units of these numbers.
    """
    found = table_in_si(table, Scene, units)
    found["units"] = {**found["units"], "si": True}
    geometry = scene.geometry
    if geometry.has_mesh:
        found["geometry"] = {**found["geometry"], "scale": units.in_si(geometry.scale, "m")}
    response = scene.response
    if response is not None:
        changed = {
            key: units.in_si(value, _whole_unit(scene, f"response.{key}"))
            for key, value in table["response"].items()
            if key in ALONG and (key != "full" or is_sequence(value))
        }
        if response.families is not None:
            unit = _whole_unit(scene, response.families.key)
            values = units.in_si(response.families.values, unit)
            changed["families"] = {**table["response"]["families"], "values": values}
        found["response"] = {**found["response"], **changed}
    return found


def in_words(scene: Scene, path: str, *values: float) -> str:
    """A number of the scene with its unit, such as `loads.0.force = 25 N`, or `= 25 and 30 N`."""
    listed = " and ".join(f"{value:.6g}" for value in values)
    return f"{path} = {listed} {unit_of(scene, path)}".rstrip()


def column_name(scene: Scene, path: str, given: bool = False) -> str:
    """The name of the column that holds the values of a key, with its unit, such as `gap_m`.

    Args:
        scene: the scene.
        path: the key.
        given: whether the column is in the units of the file of the scene.
    """
    unit = (given_unit_of if given else unit_of)(scene, path).replace("²", "2")
    return f"{path}_{unit}" if unit else path


def units_sentence(scene: Scene) -> str:
    """Say in which units the scene is written; "" if it is written in SI units."""
    return "" if scene.units.is_si else f"units of the scene: {scene.units.names}; results in SI"


def _is_regional(scene: Scene, names: list[str]) -> bool:
    """Whether a path leads to a stiffness or preload of a contact with the nodes of a region."""
    if names[0] != "contacts" or names[-1] not in REGIONAL:
        return False
    places = [contact.place for contact in scene.contacts]
    return any(names[1] in (f"{k}", "*") and place.at == "nodes" for k, place in enumerate(places))
