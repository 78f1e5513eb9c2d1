"""Dataclasses of arrays and numbers as JSON text and a few flat arrays, for an `.npz` file.

A list of many small records becomes a handful of entries of the file, so that it is written and
read in milliseconds.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

DTYPES = ("float64", "complex128", "int64", "int8")  # of the arrays that can be packed


def pack(value: Any) -> tuple[Any, dict[str, Any]]:
    """Split a value into a tree that JSON can hold and flat arrays by their type.

    Args:
        value: a dataclass, list, tuple (named or not), array of `DTYPES`, complex or JSON value,
            nested at will.

    Returns:
        The tree and the arrays; an array in the tree is a place in one of these arrays.

    Raises:
        TypeError: a value of another type.
    """
    parts: dict[str, list[Any]] = {name: [] for name in DTYPES}
    sizes = dict.fromkeys(DTYPES, 0)

    def tree(item: Any) -> Any:
        if isinstance(item, np.ndarray) and item.dtype.name in DTYPES:
            name = item.dtype.name
            place = {"array": name, "shape": list(item.shape), "at": sizes[name]}
            parts[name].append(item.ravel())
            sizes[name] += item.size
            return place
        if isinstance(item, np.generic):
            item = item.item()
        if item is None or isinstance(item, bool | int | float | str):
            return item
        if isinstance(item, complex):
            return {"complex": [item.real, item.imag]}
        if isinstance(item, list):
            return [tree(one) for one in item]
        if isinstance(item, tuple) and hasattr(item, "_fields"):
            named = {name: tree(one) for name, one in zip(item._fields, item, strict=True)}
            return {"class": type(item).__name__, "fields": named}
        if isinstance(item, tuple):
            return {"tuple": [tree(one) for one in item]}
        if is_dataclass(item) and not isinstance(item, type):
            named = {part.name: tree(getattr(item, part.name)) for part in fields(item)}
            return {"class": type(item).__name__, "fields": named}
        raise TypeError(f"a value of type {type(item).__name__} cannot be packed")

    packed = tree(value)
    return packed, {
        name: np.concatenate([np.zeros(0, name), *found]) for name, found in parts.items()
    }


def unpack(tree: Any, arrays: Mapping[str, Any], classes: Mapping[str, Any]) -> Any:
    """The value of which `pack` made a tree and arrays.

    Args:
        tree: the tree.
        arrays: the arrays by their type.
        classes: the dataclasses and named tuples that may occur, by name.

    Raises:
        KeyError, TypeError, ValueError: the tree was not made by `pack`, or of other classes.
    """
    if isinstance(tree, list):
        return [unpack(one, arrays, classes) for one in tree]
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        size = int(np.prod(tree["shape"]))
        found = arrays[tree["array"]][tree["at"] : tree["at"] + size]
        return found.reshape(tree["shape"]).copy()
    if "complex" in tree:
        return complex(*tree["complex"])
    if "tuple" in tree:
        return tuple(unpack(one, arrays, classes) for one in tree["tuple"])
    named = {name: unpack(one, arrays, classes) for name, one in tree["fields"].items()}
    return classes[tree["class"]](**named)
