"""The units of the numbers of a scene, by the paths of their keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fenicsrom.scene.base.rules import is_sequence
from fenicsrom.scene.base.tables import keys, table_kind
from fenicsrom.scene.base.toml import toml_value
from fenicsrom.scene.keys.schema import Scene
from fenicsrom.scene.keys.unit_system import PER_AREA, REGIONAL, Units, table_in_si
from fenicsrom.scene.reading.overrides import names_of, parsed_override

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


def _found(names: list[str]) -> tuple[str, type | None]:
    """The unit of the key with these names, and the dataclass of its table if it is a table."""
    kind: type | None = Scene
    unit = ""
    for name in names:
        if name.isdecimal() or name == "*":
            continue
        rule = next((rule for key, rule, *_ in keys(kind) if key == name), None) if kind else None
        if rule is None:
            return "", None
        kind, unit = table_kind(rule), rule.unit
    return unit, kind


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
    if not geometry.is_cad and geometry.mesh.suffix.lower() != ".geo":
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
