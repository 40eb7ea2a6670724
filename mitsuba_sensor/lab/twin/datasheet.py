"""Figures of a twin next to those of a datasheet, with their differences in standard errors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from ...camera.figures import emva_figures
from ...core import Exposure
from ...stages.effects.dark_current import mean_dark_e
from ...stages.stage import converter_of
from ..quantity import TWO_SIDED, Quantity

if TYPE_CHECKING:
    from ...camera.camera import Camera

STANDARD_DEVIATIONS = "σ_", "DSNU", "PRNU"
"""Beginnings of the symbols of standard deviations."""


class DatasheetRow(NamedTuple):
    """A measured figure of a twin and the value of a datasheet in the same unit."""

    twin: Quantity
    datasheet: float

    @property
    def z(self) -> float:
        """Difference in standard errors, from the side of the interval that is nearer to the datasheet.

        Standard deviations are compared by their squares, which have a normal distribution near 0.
        """
        twin, datasheet = self.twin, self.datasheet
        if twin.symbol.startswith(STANDARD_DEVIATIONS):
            twin, datasheet = twin.mapped(lambda x: x**2), datasheet**2
        difference = twin.value - datasheet
        half = twin.value - twin.low if difference > 0 else twin.high - twin.value
        if half > 0:
            return TWO_SIDED * difference / half
        return math.copysign(math.inf, difference) if difference else 0.0

    def __str__(self) -> str:
        """``K: twin 0.1245 DN/e- (0.1239 to 0.1251), datasheet 0.1241, +1.3 standard errors``."""
        twin = self.twin
        measured = f"{twin.shown} ({twin.low:.4g} to {twin.high:.4g})"
        return f"{twin.symbol}: twin {measured}, datasheet {self.datasheet:.4g}, {self.z:+.1f} standard errors"


def datasheet_figures(
    camera: Camera, temperature_k: float, wavelength_nm: float | None
) -> Iterator[tuple[str, float]]:
    """Yield symbols and values that a datasheet has for the figures of a twin, in e-, e-/s, DN or without unit.

    wavelength_nm : for the quantum efficiency, or None.
    Raises InputError for a camera with several readouts or a response that is not straight (:func:`emva_figures`).
    """
    pixel, readout, dark = camera.pixel, camera.readout, camera.dark_current
    figures = emva_figures(camera, Exposure(0.0, temperature_k))
    lines_e = readout.row_noise_e, readout.column_noise_e, readout.frame_noise_e
    read_e2 = figures.temporal_dark_noise_e**2 - sum(sigma**2 for sigma in lines_e)
    yield "K", figures.system_gain_dn_per_e
    yield "black", converter_of(camera.stages).black_level_dn
    yield "σ_read", math.sqrt(max(read_e2, 0.0))
    yield from zip(("σ_row", "σ_col", "σ_frame"), lines_e, strict=True)
    yield "DSNU_pixel", pixel.dsnu_e * readout.dsnu_residual
    yield "DSNU_row", readout.dsnu_row * pixel.full_well_e
    yield "DSNU_col", readout.dsnu_col * pixel.full_well_e * readout.dsnu_residual
    yield from (("PRNU_pixel", pixel.prnu), ("PRNU_row", 0.0), ("PRNU_col", readout.prnu_col))
    yield "µ_e.end", figures.saturation_e
    if not dark.components and not dark.rts_fraction:
        yield "µ_I", mean_dark_e(camera, Exposure(1.0, temperature_k))
        yield "D_N", dark.cv
    if wavelength_nm is not None:
        efficiencies = camera.qe([wavelength_nm])[:, 0].tolist()
        for name, efficiency in zip(camera.filter_names, efficiencies, strict=True):
            yield f"η {name}" if camera.quantum_efficiency.tile else "η", efficiency
