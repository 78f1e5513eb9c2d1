"""The table [backbone]: a damped nonlinear mode over its amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fenicsrom.scene.rules import integer, list_of, number


@dataclass(frozen=True, kw_only=True)
class Backbone:
    """The nonlinear mode of `fenicsrom backbone`.

    Attributes:
        mode: number of the linear mode in which the nonlinear one begins, from 1 at the lowest
            frequency, of small motions about the equilibrium; contact points that touch there
            stick.
        first: smallest amplitude. Amplitudes are those of the linear mode at the probe, in the
            direction in which the mode moves the probe most; the results also give the amplitudes
            of the nonlinear motion.
        last: largest amplitude, above `first`.
        points: largest number of points.
        load_factors: factors on all harmonic loads, ascending; at each of them the largest
            amplitude of the forced motion over the frequency is found.
    """

    mode: Annotated[int, integer(1, 1000)] = 1
    first: Annotated[float, number(above=0.0, unit="m")]
    last: Annotated[float, number(above=0.0, unit="m")]
    points: Annotated[int, integer(2, 100_000)] = 500
    load_factors: Annotated[tuple[float, ...], list_of(number(above=0.0), least=0)] = ()
