"""The number of normal modes of a basis, and their computation.

With modes = "auto", a basis has the modes up to `HIGHEST_MODE` times the highest frequency that the
scene excites (`fenicsrom.scene.keys.excitation`), and the next one, but at least `LEAST_MODES`. A
mode above twice the frequency of a load responds with at most 1/(1 − 1/4) = 1.3 times its static
response. The responses of the modes that are left out are therefore small and nearly static.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.reduction.protocols import Inverse, Structure
from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.checks.checks import LEAST_MODES
from fenicsrom.scene.keys.excitation import HIGHEST_MODE, highest_frequency

ENOUGH = 1.5
"""The last mode of any basis should be above this multiple of the highest excited frequency."""

MOST_MODES = 12
"""Most modes of "auto" in a nonlinear scene: its derivatives grow with the square of the modes."""

MOST_LINEAR_MODES = 100
"""Most modes of "auto" in a linear scene; at most half of the free unknowns in any scene."""

EXTRA_MODES = 2
"""Modes computed beyond the wanted ones, so that the last group of close modes is complete."""


def solve_eigenmodes(
    structure: Structure, inverse: Inverse, wanted: str | int, free: int
) -> tuple[Array, Array, int]:
    """Compute the normal modes that [basis] asks for, and a few more.

    Args:
        structure: the structure.
        inverse: the inverse of its stiffness, with the contact displacements held or free.
        wanted: the key `basis.modes`.
        free: the number of free unknowns.

    Returns:
        ω² (k,) ascending, the modes (local, k), and the number of modes to keep.

    Raises:
        SceneError: there are fewer free unknowns than modes.
        ConvergenceError: the eigensolver did not find all modes.
        AccuracyError: a mode failed its residual check.
    """
    count = min(LEAST_MODES, free) if isinstance(wanted, str) else wanted
    if count > free:
        allowed = f"must be at most {free}, the number of free unknowns"
        raise Where(structure.source, "basis.modes").refuse(count, allowed)
    most = MOST_MODES if structure.geometrically_nonlinear else MOST_LINEAR_MODES
    most = max(count, min(most, free // 2))  # all modes would leave no flexibility to static modes
    while True:
        solved = count + min(EXTRA_MODES, free - count) if count else 0
        omega_squared, modes = structure.eigenmodes(inverse, solved)
        if not isinstance(wanted, str):
            return omega_squared, modes, count
        frequencies = np.sqrt(np.maximum(omega_squared, 0.0)) / (2.0 * np.pi)
        needed = int(np.sum(frequencies <= HIGHEST_MODE * structure.excitation)) + 1
        if needed <= solved or count == most:
            break
        count = min(2 * count, most)
    if needed - 1 > most:
        structure.warnings.append(
            f'basis.modes = "auto" keeps {most} modes, up to {frequencies[most - 1]:.5g} Hz, but '
            f"the scene excites up to {structure.excitation:.5g} Hz; for more modes, set "
            "basis.modes to a larger number"
        )
    return omega_squared, modes, max(min(needed, most), min(LEAST_MODES, free))


def missing_modes(scene: Scene, frequencies: Array) -> str | None:
    """Give a warning of loads that are too fast for the modes of a basis; None without such loads.

    Args:
        scene: the scene.
        frequencies: (v,) natural frequencies of the normal modes, Hz.
    """
    highest, last = highest_frequency(scene), float(np.max(frequencies, initial=0.0))
    if highest * ENOUGH <= last or highest == 0.0:
        return None
    return (
        f"the scene excites up to {highest:.5g} Hz, and the normal modes of the basis "
        f"({frequencies.size}) end at {last:.5g} Hz; they should reach {ENOUGH:g} times the "
        'highest excited frequency: run the scene with basis.modes = "auto", or with more modes'
    )
