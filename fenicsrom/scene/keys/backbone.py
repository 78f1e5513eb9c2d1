"""The table [backbone]: a damped nonlinear mode over its amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fenicsrom.scene.base.rules import integer, list_of, number


@dataclass(frozen=True, kw_only=True)
class Backbone:
    """The nonlinear mode of `fenicsrom backbone`.

    Attributes:
        mode: number of the linear mode in which the nonlinear mode begins; mode 1 has the lowest
            frequency. Linear modes are those of small motions about the equilibrium, in which
            contact points that touch stick.
        first: smallest amplitude. Amplitudes are those of the linear mode at the probe, in the
            direction in which the mode moves the probe most; the results also give the amplitudes
            of the nonlinear motion.
        last: largest amplitude, above `first`.
        points: largest number of points.
        load_factors: ascending factors of all harmonic loads; for each factor the run finds the
            largest amplitude of the forced motion over the frequency.
    """

    mode: Annotated[int, integer(1, 1000)] = 1
    first: Annotated[float, number(above=0.0, unit="m")]
    last: Annotated[float, number(above=0.0, unit="m")]
    points: Annotated[int, integer(2, 100_000)] = 500
    load_factors: Annotated[tuple[float, ...], list_of(number(above=0.0), least=0)] = ()
