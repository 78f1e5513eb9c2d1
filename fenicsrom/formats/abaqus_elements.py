"""The element types of Abaqus and CalculiX that this program knows."""

from __future__ import annotations

import re

_VARIANT = "(?:R|I|H|RH|IH|M|MH|HS|S|T|RT|HT|MT|MHT|RHT|P|PH|MP|MPH|RP|RPH|PT|RPT)?"
"""Letters for integration, hybrid formulation and other fields; the nodes are the same."""

_FAMILIES: dict[str, int] = {
    rf"C3D4{_VARIANT}": 4,
    rf"C3D10{_VARIANT}": 11,
    rf"C3D5{_VARIANT}": 7,
    rf"C3D6{_VARIANT}": 6,
    rf"C3D13{_VARIANT}": 19,
    rf"C3D15{_VARIANT}": 18,
    rf"C3D8{_VARIANT}": 5,
    rf"C3D20{_VARIANT}": 17,
    rf"(CPS|CPE|CPEG|CAX|M3D)3{_VARIANT}|S3R?S?|STRI3|SFM3D3|DS3|R3D3": 2,
    rf"(CPS|CPE|CPEG|CAX|M3D)4{_VARIANT}|S4R?S?W?|S4R5|SFM3D4R?|DS4|R3D4": 3,
    rf"(CPS|CPE|CPEG|CAX|M3D)6{_VARIANT}|S6|STRI65|SFM3D6|DS6": 9,
    rf"(CPS|CPE|CPEG|CAX|M3D)8{_VARIANT}|S8R?T?|S8R5|SFM3D8R?|DS8": 16,
    r"S9R5|M3D9R?": 10,
    r"(B2|B3)1H?|(B2|B3)1OS|T[23]D2T?|(B2|B3)3H?": 1,
    r"(B2|B3)2[HR]?|(B2|B3)2OS|T[23]D3T?": 8,
}
"""Kinds by the types of elements with the nodes of a cell, a facet or an edge."""

_TYPES = [(re.compile(pattern), kind) for pattern, kind in _FAMILIES.items()]

_NAMES = {
    "3D18": "wedges of 18 nodes",
    "3D27": "hexahedra of variable nodes",
}
"""Solids that this program cannot use, which would leave a hole in the body."""


def kind_of(name: str) -> int | None:
    """The kind of an element type in capitals; None for a type that is left out."""
    return next((kind for pattern, kind in _TYPES if pattern.fullmatch(name)), None)


def refused(name: str) -> str | None:
    """Describe an element type that would leave a hole in the body; None for other types."""
    match = re.match(r"C(3D\d+)", name)
    if match:
        return _NAMES.get(match[1], "solid elements")
    if re.match(r"SC[68]|CSS8|CCL|CIN3D", name):
        return "continuum shells, cylindrical or infinite elements"
    return None


def is_axisymmetric(name: str) -> bool:
    """Whether elements of this type stand for rings."""
    return name.startswith("CAX")
