"""Parts of an Abaqus model: their nodes, elements and sets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.abaqus_keywords import Keyword, fields
from fenicsrom.formats.mesh_file import Ints
from fenicsrom.formats.text import numbers_between

OF_ELEMENTS = "*ELSET="
"""Prefix of an item of a node set: all nodes of the element set of this name."""


class Entry(NamedTuple):
    """A part of a set.

    Attributes:
        instance: the instance whose numbers and sets are meant, or "".
        items: numbers, and names of sets.
    """

    instance: str
    items: tuple[int | str, ...]


class Side(NamedTuple):
    """A part of a surface: the elements, by number or set, and the number of the face from 0."""

    item: int | str
    face: int


@dataclass(eq=False)
class Part:
    """A part, or the file itself if it has no parts.

    Attributes:
        nodes: coordinates of each node by its number.
        elements: nodes of each element by its number, by the type of the element.
        node_sets: entries of each node set by its name.
        element_sets: entries of each element set by its name.
        surfaces: sides of each surface by its name.
        internal: keyword and name of the sets that Abaqus/CAE made for itself, which are no groups.
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[str, dict[int, tuple[int, ...]]] = field(default_factory=dict)
    node_sets: dict[str, list[Entry]] = field(default_factory=dict)
    element_sets: dict[str, list[Entry]] = field(default_factory=dict)
    surfaces: dict[str, list[Side]] = field(default_factory=dict)
    internal: set[tuple[str, str]] = field(default_factory=set)

    def names(self, keyword: str) -> list[str]:
        """The names of the node sets, element sets or surfaces, by their keyword."""
        sets = {"NSET": self.node_sets, "ELSET": self.element_sets, "SURFACE": self.surfaces}
        return [name for name in sets[keyword] if (keyword, name.upper()) not in self.internal]


def add_to_set(sets: dict[str, list[Entry]], name: str, entry: Entry) -> None:
    """Add an entry to a set, whose name may have been written in other letters before."""
    sets.setdefault(known_name(sets, name), []).append(entry)


def known_name(names: dict[str, list[Entry]] | dict[str, list[Side]], name: str) -> str:
    """The spelling of a name that was used first: capitals and small letters are the same."""
    return next((known for known in names if known.upper() == name.upper()), name)


def read_set(path: Path, keyword: Keyword) -> tuple[int | str, ...]:
    """The numbers and names of the data lines of *NSET or *ELSET.

    Raises:
        SceneError: a range is wrong.
    """
    if "GENERATE" not in keyword.parameters:
        words = [word for line in keyword.lines for word in fields(line) if word]
        return tuple(_number_or_name(word) for word in words)
    found: list[int] = []
    for line in keyword.lines:
        try:
            first, last, step = ([int(word) for word in fields(line)] + [1])[:3]
            found += numbers_between(first, last, step)
        except ValueError:
            reason = "must be first, last and step (1 if left out)"
            raise refuse(path, f"*{keyword.name}, GENERATE: {line!r}: {reason}") from None
    return tuple(found)


def _number_or_name(word: str) -> int | str:
    return int(word) if word.lstrip("+-").isdigit() else word


def by_block(chosen: Ints, starts: Ints) -> list[Ints]:
    """The indices inside each block of some elements, which are counted over all blocks.

    Args:
        chosen: indices of elements.
        starts: index of the first element of each block, and the number of all elements.
    """
    return [chosen[(chosen >= a) & (chosen < b)] - a for a, b in pairwise(starts)]


@dataclass(frozen=True, eq=False)
class Resolver:
    """Finds the nodes or elements of a set of a model.

    Attributes:
        path: the file, for messages.
        keyword: "NSET" or "ELSET".
        sets: the sets of the model itself.
        instances: the sets of each instance by its name.
        numbers: index of each node or element by its number, in each instance by its name; "" is
            the model itself.
        nodes_of: gives the nodes of an element set by instance and name.
    """

    path: Path
    keyword: str
    sets: dict[str, list[Entry]]
    instances: dict[str, dict[str, list[Entry]]]
    numbers: dict[str, dict[int, int]]
    nodes_of: Callable[[str, str], Ints] | None = None

    def indices(self, instance: str, name: str, seen: tuple[str, ...] = ()) -> Ints:
        """Sorted indices of a set of an instance, or of the model itself if instance is "".

        Numbers that the file does not define, such as the numbers of elements that are left out,
        are ignored.

        Raises:
            SceneError: there is no such set, or it contains itself.
        """
        sets = self.instances.get(instance, {}) if instance else self.sets
        known, key = known_name(sets, name), f"{instance}.{name}".upper()
        if known not in sets:
            where, _, rest = name.partition(".")
            if not instance and rest and self._instance(where):
                return self.indices(self._instance(where), rest, seen)
            raise refuse(self.path, f"*{self.keyword}: there is no set {name!r}")
        if key in seen:
            raise refuse(self.path, f"*{self.keyword}: the set {name!r} contains itself")
        found: set[int] = set()
        for entry in sets[known]:
            where = instance
            # a file without parts may keep the names of the instances it was made from
            named = entry.instance and self.instances
            if named and not (where := self._instance(entry.instance)):
                reason = f"*{self.keyword} {name}: there is no instance {entry.instance!r}"
                raise refuse(self.path, reason)
            for item in entry.items:
                found.update(self._item(where, item, (*seen, key)))
        return np.array(sorted(found), dtype=np.int64)

    def found(self, scope: tuple[str, ...], text: str) -> Ints:
        """Sorted indices of a number or a set, as a data line names it.

        Args:
            scope: instances of the part in which the line stands, or ("",).
            text: the number or name.

        Raises:
            SceneError: there is no such set.
        """
        item: int | str = int(text) if text.isdigit() else text
        every = [index for instance in scope for index in self._item(instance, item, ())]
        return np.array(sorted(set(every)), dtype=np.int64)

    def _item(self, instance: str, item: int | str, seen: tuple[str, ...]) -> list[int]:
        """Indices of a number, of a number with its instance, or of a set."""
        if isinstance(item, str):
            where, _, number = item.rpartition(".")
            if where and number.isdigit() and self._instance(where):
                return self._item(self._instance(where), int(number), seen)
            if item.startswith(OF_ELEMENTS) and self.nodes_of is not None:
                return list(map(int, self.nodes_of(instance, item.removeprefix(OF_ELEMENTS))))
            return list(map(int, self.indices(instance, item, seen)))
        index = self.numbers.get(instance, {}).get(item)
        return [] if index is None else [index]

    def _instance(self, name: str) -> str:
        """The instance of a name in any letters, or ""."""
        return next((known for known in self.instances if known.upper() == name.upper()), "")
