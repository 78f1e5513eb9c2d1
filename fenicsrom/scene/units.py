"""The units of the numbers of a scene, by the paths of their keys."""

from __future__ import annotations

from fenicsrom.scene.overrides import names_of
from fenicsrom.scene.schema import Scene
from fenicsrom.scene.tables import keys, table_kind

REGIONAL = ("preload", "normal_stiffness", "tangential_stiffness")
"""Keys of a contact whose units depend on its region: they may be per area."""


def unit_of(scene: Scene, path: str) -> str:
    """The unit of the number that a key such as `loads.0.force` holds.

    A number without a unit gives "". So does the stiffness or preload of a contact with the nodes
    of a region, because its unit depends on the region. The key "frequency" is the lowest frequency
    of the loads, as in the table [response].
    """
    if path == "frequency":
        return "Hz"
    kind: type | None = Scene
    unit, names = "", names_of(path)
    for name in names:
        if name.isdecimal():
            continue
        rule = next((rule for key, rule, *_ in keys(kind) if key == name), None) if kind else None
        if rule is None:
            return ""
        kind, unit = table_kind(rule), rule.unit
    several = "," in unit  # of the columns of a table
    varies = names[0] == "contacts" and names[-1] in REGIONAL
    return "" if several or (varies and _is_region(scene, names)) else unit


def in_words(scene: Scene, path: str, *values: float) -> str:
    """A number of the scene with its unit, such as `loads.0.force = 25 N`, or `= 25 and 30 N`."""
    listed = " and ".join(f"{value:.6g}" for value in values)
    return f"{path} = {listed} {unit_of(scene, path)}".rstrip()


def column_name(scene: Scene, path: str) -> str:
    """The name of the column that holds the values of a key, with its unit, such as `gap_m`."""
    unit = unit_of(scene, path).replace("²", "2")
    return f"{path}_{unit}" if unit else path


def _is_region(scene: Scene, names: list[str]) -> bool:
    """Whether a path leads to a contact with the nodes of a region."""
    places = [contact.place for contact in scene.contacts]
    return any(f"{k}" == names[1] and place.at == "nodes" for k, place in enumerate(places))
