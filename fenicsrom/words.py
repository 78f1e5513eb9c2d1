"""Words of sentences that depend on a number."""

from __future__ import annotations


def counted(number: int, noun: str, plural: str = "") -> str:
    """Write a number and a noun; its plural has an s, if it is not given."""
    return f"{number} {noun if number == 1 else plural or f'{noun}s'}"


def are(number: int) -> str:
    """The verb of a sentence whose subject is a number of things."""
    return "is" if number == 1 else "are"
