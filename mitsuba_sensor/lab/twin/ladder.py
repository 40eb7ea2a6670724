"""Several gain settings as the ladder of a camera file, and where the conversion gain of the pixel changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .setting import Setting


def gains_of(settings: Sequence[Setting]) -> list[dict[str, Any]]:
    """K, read noise with the shape of its law, black level, row and column noise of each setting.

    Full wells too, where all settings show one.
    """
    wells = all(one.brightest.limited_by == "well" for one in settings)
    return [_rung(one, wells) for one in settings]


def _rung(one: Setting, well: bool) -> dict[str, Any]:
    numbers = {
        "gain_dn_per_e": one.gain.quantity.value,
        "read_noise_e": one.electrons(one.noise.read).quantity.value,
        "black_level_dn": max(one.dark.black.quantity.value, 0.0),
        "row_noise_e": one.electrons(one.noise.row).quantity.value,
        "column_noise_e": one.electrons(one.noise.column).quantity.value,
    }
    if one.noise.shape.known:
        numbers["read_noise_shape"] = one.noise.shape.quantity.value
    if well:
        numbers["full_well_e"] = one.electrons(one.brightest.end).quantity.value
    return {**_label(one.name), **numbers}


def _label(name: str) -> dict[str, Any]:
    try:
        return {"iso": float(name)} if float(name) > 0 else {"name": name}
    except ValueError:
        return {"name": name or "unnamed"}


def step_notes(settings: Sequence[Setting]) -> list[str]:
    """Where read noise falls in DN while K rises, which one conversion gain cannot do.

    With σ² = a²K² + b² (noise before and behind the amplifier) it never falls.
    """
    found = []
    for low, high in zip(settings, settings[1:], strict=False):
        before, after = low.noise.read.quantity, high.noise.read.quantity
        if after.high < before.low:
            k = [f"{one.gain.quantity.value:.3g}" for one in (low, high)]
            found.append(
                f"conversion gain changes from {low.name} to {high.name}: K rises from {k[0]} to {k[1]} DN/e- while "
                f"the read noise falls from {before.value:.3g} to {after.value:.3g} DN"
            )
    return found
