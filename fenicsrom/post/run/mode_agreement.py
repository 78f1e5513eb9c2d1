"""The modes of the reduced model beside those of the full model: table, sentence and picture."""

from typing import Any

import numpy as np

from fenicsrom.assess.errors.mode_agreement import ModeAgreement
from fenicsrom.post.base.style import Figure, new_panels, styled
from fenicsrom.post.base.tables import table_of

SAME = 0.99
"""Modes of a larger MAC count as the same."""

ALIKE = 0.5
"""From this MAC on, a full mode has a partner; a reduced mode is the partner of one mode only."""

DARK = 0.6
"""Fields of a larger MAC have white numbers."""

AGREEMENT_NOTE = (
    "Free vibrations about the equilibrium without contact, damping and Coriolis forces. The MAC "
    "(modal assurance criterion, weighted by the mass) is 1 for modes of the same shape and 0 for "
    "modes without a common part. The energy is the part of the kinetic energy of the full mode "
    "that the basis can represent."
)


def agreement_rows(found: ModeAgreement) -> list[list[Any]]:
    """Compose the table of the full modes and their partners."""

    def row(i: int, j: int) -> dict[str, Any]:
        full, reduced = found.full_hz[i], found.reduced_hz[j]
        alike = found.mac[i, j] >= ALIKE
        difference = round(100.0 * (reduced / full - 1.0), 3) + 0.0 if full > 0.0 else None
        return {
            "full mode": i + 1,
            "full Hz": f"{full:.5g}",
            "reduced Hz": f"{reduced:.5g}" if alike else None,
            "difference %": difference if alike else None,
            "MAC": f"{found.mac[i, j]:.3f}",
            "energy %": f"{100.0 * found.represented[i]:.1f}",
        }

    return table_of(row(i, j) for i, j in enumerate(found.partners))


def agreement_summary(found: ModeAgreement) -> dict[str, Any]:
    """The frequencies and the MAC for `summary.json`."""
    return {"full_hz": found.full_hz, "reduced_hz": found.reduced_hz, "mac": found.mac}


def agreement_sentence(found: ModeAgreement) -> str:
    """State how many modes of the full model the reduced model has, counted from the lowest."""
    same = [found.mac[i, j] >= SAME for i, j in enumerate(found.partners)]
    count = same.index(False) if False in same else len(same)
    which = f"MAC of at least {SAME:g}"
    if count == 0:
        return f"The reduced model has no mode with a {which} to the first mode of the full model."
    modes = "mode" if count == 1 else f"{count} modes"
    return (
        f"The reduced model has the first {modes} of the full model, up to "
        f"{found.full_hz[count - 1]:.5g} Hz, with a {which} ({len(same)} compared)."
    )


def _hz(frequency: float) -> str:
    """Four digits of a frequency, without a power of ten."""
    return f"{frequency:.0f}" if frequency >= 1e3 else f"{frequency:.4g}"


@styled
def agreement_figure(found: ModeAgreement) -> Figure:
    """Draw the MAC of the full modes and as many reduced modes as a matrix with its numbers."""
    mac = found.mac[:, : len(found.full_hz)]
    rows, columns = mac.shape
    figure, (axis,) = new_panels(2.6 + 0.62 * columns, 1.6 + 0.42 * rows)
    image = axis.imshow(mac, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto", origin="lower")
    axis.grid(False)
    for i, j in np.ndindex(rows, columns):
        if mac[i, j] >= 0.005:
            colour = "white" if mac[i, j] > DARK else "#30363C"
            text = f"{mac[i, j]:.2f}"
            axis.text(j, i, text, ha="center", va="center", color=colour, fontsize=8)
    axis.set_xticks(range(columns), [_hz(f) for f in found.reduced_hz[:columns]], rotation=45)
    axis.set_yticks(range(rows), [_hz(f) for f in found.full_hz])
    axis.set(xlabel="reduced model, Hz", ylabel="full model, Hz")
    bar: Any = figure.colorbar(image, ax=axis, label="MAC", ticks=[0.0, 0.5, 1.0], aspect=30)
    bar.outline.set_visible(False)
    return figure
