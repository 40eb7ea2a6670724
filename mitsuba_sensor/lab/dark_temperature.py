"""Dark current over temperature: the temperature step that doubles it, and its activation energy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..core import InputError
from ..core.types import Float64Array
from .line_fits import straight_line
from .quantity import LEVEL, Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 R4 7.2"
BOLTZMANN_EV_PER_K = 8.617333262e-5
"""CODATA 2018."""


@dataclass(frozen=True, eq=False)
class DarkTemperature:
    """Laws of dark current over temperature, each fitted to its logarithm.

    doubling : T_d of D ∝ 2^(T/T_d) [K].  activation : E_a of D ∝ exp(−E_a/kT) [eV]; half the band gap where traps in
        the depletion region generate it, the whole band gap where it diffuses.
    temperature_k, current : the points, in the unit of the currents.
    """

    doubling: Quantity
    activation: Quantity
    temperature_k: Float64Array
    current: Float64Array
    unit: str

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Both."""
        return self.doubling, self.activation

    def plot(self, ax: Axes) -> None:
        """Arrhenius plot: logarithm of dark current against 1/kT."""
        x = 1 / (BOLTZMANN_EV_PER_K * self.temperature_k)
        ax.plot(x, self.current, "o", ms=4, label="measured")
        middle = float(np.log(self.current).mean() + self.activation.value * x.mean())
        ends = np.array([x.min(), x.max()])
        ax.plot(ends, np.exp(middle - self.activation.value * ends), lw=1, label="exp(−E_a/kT)")
        ax.set(xlabel="1/kT [1/eV]", ylabel=f"dark current [{self.unit}]", yscale="log")


def dark_temperature(currents: Mapping[float, Quantity]) -> DarkTemperature:
    """Of dark currents by their temperature [K], 2 or more, all in the same unit.

    Currents whose interval contains 0 are left out, with a note. Raises InputError for fewer than 2 others, for
    temperatures that are not positive, and for different units.
    """
    if any(not t > 0 for t in currents) or len({one.unit for one in currents.values()}) > 1:
        units = sorted({one.unit for one in currents.values()})
        raise InputError(
            f"temperatures {sorted(currents)} K, units {units}; temperatures are above 0, all units equal."
        )
    used = {t: one for t, one in sorted(currents.items()) if one.low > 0}
    if len(used) < 2:
        raise InputError(
            f"dark current is above 0 at {len(used)} temperatures of {len(currents)}; at least 2 are needed."
        )
    t = np.array(list(used))
    current = np.array([one.value for one in used.values()])
    z = float(scipy.special.ndtri((1 + LEVEL) / 2))
    error = np.array([math.log(one.high / one.low) / (2 * z) for one in used.values()])
    octaves = straight_line(t, np.log2(current), error / math.log(2))
    slope, low, high = octaves.interval
    ends = (1 / slope, 1 / high, 1 / low) if low > 0 else (math.nan, 0.0, math.inf)
    left = [f"{t:g} K left out: not told from 0" for t in sorted(currents) if t not in used]
    note = "; ".join(left)
    doubling = Quantity("T_d", "doubling temperature", *ends, "K", SECTION, octaves.note).noted(note)
    energy = straight_line(-1 / (BOLTZMANN_EV_PER_K * t), np.log(current), error)
    arrhenius = Quantity("E_a", "activation energy", *energy.interval, "eV", "Arrhenius law", energy.note).noted(note)
    return DarkTemperature(doubling, arrhenius, t, current, next(iter(used.values())).unit)
