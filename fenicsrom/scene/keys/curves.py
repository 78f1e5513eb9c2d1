"""The tables of the curves: [response], [backbone], [ringdown] and [statics]."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from fenicsrom.scene.base.rules import choice, either, integer, list_of, name, number, text_like
from fenicsrom.scene.base.tables import table_of
from fenicsrom.scene.keys.loads import ACTIONS

LOAD_SIZES = tuple(ACTIONS.tags)
CONTACT_NUMBERS = ("preload", "gap", "normal_stiffness", "tangential_stiffness", "friction")
PATTERN = (
    r"^(frequency|material\.mass_damping|rotation\.speed_rpm"
    rf"|loads\.[0-9]{{1,6}}\.({'|'.join(LOAD_SIZES)})"
    rf"|contacts\.[0-9]{{1,6}}\.({'|'.join(CONTACT_NUMBERS)}))$"
)
ALLOWED = (
    '"frequency", "material.mass_damping", "rotation.speed_rpm", the size of a load such as '
    f'"loads.0.force", or contacts.N. and one of {", ".join(CONTACT_NUMBERS)}'
)
OVER_NUMBERS = tuple(name for name in CONTACT_NUMBERS if name != "gap")
OVER_PATTERN = (
    rf"^(material\.mass_damping|contacts\.([0-9]{{1,6}}|\*)\.({'|'.join(OVER_NUMBERS)}))$"
)
OVER_ALLOWED = (
    '"material.mass_damping", or contacts.N., or contacts.*. for all contacts, and one of '
    f"{', '.join(OVER_NUMBERS)}"
)


class Parameter(NamedTuple):
    """A number of the scene that a response curve follows.

    Attributes:
        table: "loads", "contacts", "material", "rotation", or "" for the frequency.
        number: number of the load or contact; 0 for other parameters.
        name: the key in the table.
    """

    table: str
    number: int
    name: str


def parameter_of(key: str) -> Parameter:
    """The parameter of a key that the rule of `Response.parameter` has accepted."""
    *path, last = key.split(".")
    return Parameter(path[0] if path else "", int(path[1]) if len(path) > 1 else 0, last)


MOST_FULL = 1000  # motions of the full model on a curve


@dataclass(frozen=True, kw_only=True)
class Families:
    """One curve for each value of a second number of the scene.

    Attributes:
        key: key as in `--set`; a stored model must accept other values.
        values: its values.
    """

    key: Annotated[str, name]
    values: Annotated[tuple[float, ...], list_of(number())]


@dataclass(frozen=True, kw_only=True)
class Response:
    """The curves of `fenicsrom response`.

    Attributes:
        parameter: number that changes along a curve. "frequency" is the lowest frequency of the
            loads; all others follow in proportion. "rotation.speed_rpm" needs
            `rotation.speeds_rpm`.
        first: parameter at the start of a curve.
        last: parameter at its end, above or below `first`.
        method: "shooting" marches periods; "balance" finds harmonics, as always for a disk.
        accuracy: with "balance", accepted change of amplitudes by more harmonics.
        points: largest number of points; a smooth curve needs about 100, one with several contact
            points up to 600.
        families: a curve for each value of a second number.
        branches: 1 follows branches at period doublings and branch points; 2 also follows branches
            of these, and so on.
        isolated: parameters at which to look for curves that are not connected with the first one,
            by loads of up to four times.
        peak_over: number of which the run finds the value with the smallest peak.
            "contacts.*.preload" changes all contacts.
        peak_range: range of this number. Default: a tenth to ten times its value.
        full: parameters at which the full model runs too; an integer k takes the midpoints of k
            equal parts. Not with `--from`.
    """

    parameter: Annotated[str, text_like(PATTERN, ALLOWED)] = "frequency"
    first: Annotated[float, number(least=0.0)]
    last: Annotated[float, number(least=0.0)]
    method: Annotated[str, choice("shooting", "balance")] = "shooting"
    accuracy: Annotated[float, number(least=1e-6, most=0.1)] = 2e-4
    points: Annotated[int, integer(2, 100_000)] = 3000
    families: Annotated[Families | None, table_of(Families)] = None
    branches: Annotated[int, integer(0, 10)] = 0
    isolated: Annotated[tuple[float, ...] | None, list_of(number())] = None
    peak_over: Annotated[str | None, text_like(OVER_PATTERN, OVER_ALLOWED)] = None
    peak_range: Annotated[tuple[float, ...] | None, list_of(number(above=0.0), least=2)] = None
    full: Annotated[
        int | tuple[float, ...] | None, either(integer(1, MOST_FULL), list_of(number()))
    ] = None

    @property
    def low(self) -> float:
        """The smaller end of the range."""
        return min(self.first, self.last)

    @property
    def high(self) -> float:
        """The larger end of the range."""
        return max(self.first, self.last)

    @property
    def full_values(self) -> tuple[float, ...]:
        """The values of the parameter at which the scene asks for the full model."""
        if isinstance(self.full, int):
            part = (self.last - self.first) / self.full
            return tuple(self.first + (k + 0.5) * part for k in range(self.full))
        return self.full or ()


@dataclass(frozen=True, kw_only=True)
class Backbone:
    """The nonlinear mode of `fenicsrom backbone`.

    Attributes:
        mode: linear mode in which the nonlinear mode begins; contact points that touch stick.
        first: smallest amplitude of the linear mode at the probe, in its direction of largest
            motion.
        last: largest amplitude.
        points: largest number of points.
        load_factors: ascending factors of the harmonic loads, for peaks of the forced motion.
    """

    mode: Annotated[int, integer(1, 1000)] = 1
    first: Annotated[float, number(above=0.0, unit="m")]
    last: Annotated[float, number(above=0.0, unit="m")]
    points: Annotated[int, integer(2, 100_000)] = 500
    load_factors: Annotated[tuple[float, ...], list_of(number(above=0.0), least=0)] = ()


@dataclass(frozen=True, kw_only=True)
class Ringdown:
    """The free decay of `fenicsrom ringdown`.

    Attributes:
        mode: linear mode whose motion is measured.
        factor: size at which the loads that vary are held, relative to theirs.
        periods: length of the decay, in periods of the mode.
        smallest: relative amplitude at which the table ends.
    """

    mode: Annotated[int, integer(1, 1000)] = 1
    factor: Annotated[float, number(above=0.0)] = 1.0
    periods: Annotated[int, integer(2, 10_000)] = 50
    smallest: Annotated[float, number(above=0.0, below=1.0)] = 0.01


@dataclass(frozen=True, kw_only=True)
class Statics:
    """The equilibrium path of `fenicsrom statics`.

    Attributes:
        last: load factor at which the path ends. It multiplies the static loads.
        lowest: load factor below zero at which the path ends. Default: minus `last`.
        displacement: displacement of the probe at which the path ends.
        points: largest number of points.
        loads: numbers from 0 of the loads that the factor multiplies; the others are constant.
            Default: all static loads.
    """

    last: Annotated[float, number(above=0.0)] = 1.0
    lowest: Annotated[float | None, number(most=0.0)] = None
    displacement: Annotated[float | None, number(above=0.0, unit="m")] = None
    points: Annotated[int, integer(2, 100_000)] = 500
    loads: Annotated[tuple[int, ...] | None, list_of(integer(0, 1000), least=1)] = None
