"""Words of sentences that depend on a number."""

from __future__ import annotations


def counted(number: int, noun: str, plural: str = "") -> str:
    """Write a number and a noun; by default the plural of the noun has an s."""
    return f"{number} {noun if number == 1 else plural or f'{noun}s'}"


def are(number: int) -> str:
    """The verb of a sentence whose subject is a number of things."""
    return "is" if number == 1 else "are"
