"""SNR of a camera versus photoelectrons per pixel, in uniform illumination."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..camera.camera_file import AnyCamera, camera_of
from ..core import Exposure, InputError, Photons
from ..core.html import Table, fragment
from ..core.plots import labelled_axes
from ..core.types import Float64Array
from ..sensor.expose import exposure_of_photons
from .clean import pixel_moments

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE_PX = 64
"""Rows and columns of the uniform pixels, at most."""
COLUMNS = {
    "electrons": "signal [e-]",
    "signal_dn": "signal [DN]",
    "temporal_dn": "temporal σ [DN]",
    "spatial_dn": "spatial σ [DN]",
    "snr": "temporal SNR",
    "total_snr": "total SNR",
}
LEVELS_PER_DECADE, DARKEST_E, BRIGHTEST_OVER_SATURATION = 4, 1.0, 0.9


@dataclass(frozen=True, eq=False)
class SnrCurve:
    """Signal and noise of one camera at several exposure levels of uniform illumination, each shape (L,).

    electrons : mean photoelectrons per pixel.  signal_dn : mean code above the dark.
    temporal_dn, spatial_dn : σ from frame to frame and from pixel to pixel [DN].
    """

    camera: str
    exposure: Exposure
    electrons: Float64Array
    signal_dn: Float64Array
    temporal_dn: Float64Array
    spatial_dn: Float64Array

    @property
    def snr(self) -> Float64Array:
        """Signal over temporal noise (EMVA 1288); infinite without noise."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.signal_dn / self.temporal_dn

    @property
    def total_snr(self) -> Float64Array:
        """Signal over temporal and spatial noise together; infinite without noise."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.signal_dn / np.hypot(self.temporal_dn, self.spatial_dn)

    def __repr__(self) -> str:
        levels = f"{len(self.electrons)} levels from {self.electrons[0]:.4g} to {self.electrons[-1]:.4g} e-"
        return f"<SnrCurve: {self.camera}, {levels}, SNR up to {self.snr.max():.4g}>"

    @property
    def rows(self) -> list[dict[str, float]]:
        """Return the numbers of each level by their column."""
        columns = [getattr(self, name).tolist() for name in COLUMNS]
        return [dict(zip(COLUMNS, row, strict=True)) for row in zip(*columns, strict=True)]

    def explain(self) -> str:
        """Return the curve as a table for people."""
        head = "".join(f"{name:>16}" for name in COLUMNS.values())
        lines = ["".join(f"{x:>16.5g}" for x in row.values()) for row in self.rows]
        return "\n".join([self._title, head, *lines])

    def _repr_html_(self) -> str:
        rows = [[f"{x:.5g}" for x in row.values()] for row in self.rows]
        return fragment(self._title, Table([*COLUMNS.values()], rows))

    @property
    def _title(self) -> str:
        exposure = self.exposure
        return f"SNR of {self.camera} in {exposure.time_s:g} s at {exposure.temperature_k:g} K"

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw both SNR curves and the shot noise limit with Matplotlib; return the axes."""
        labels = f"SNR versus signal, {self.camera}", "photoelectrons per pixel", "SNR"
        drawn = labelled_axes(axes, *labels)
        drawn.loglog(self.electrons, self.snr, "o-", label="temporal noise")
        drawn.loglog(self.electrons, self.total_snr, "s-", label="temporal and spatial noise")
        limit = np.sqrt(self.electrons)
        drawn.loglog(self.electrons, limit, "k:", label="shot noise only (√N)")
        drawn.legend()
        drawn.grid(True, alpha=0.3)
        return drawn


def snr_curve(
    camera: AnyCamera,
    exposure: Exposure | None = None,
    electrons: Sequence[float] | None = None,
    *,
    serial: int = 1,
) -> SnrCurve:
    """Return the SNR of uniform light against its photoelectrons, from each pixel's expected code and variance.

    ::

        curve = ms.snr_curve("sony_imx174", ms.Exposure(0.01))
        print(curve.snr.max())

    exposure : its time and temperature give the dark current. Default: 0.01 s.
    electrons : mean photoelectrons per pixel of each level. Default: four levels per decade, 1 e- to 90 % of
        saturation.
    serial : the sensor unit whose fixed pattern gives the spatial noise.
    Raises InputError for levels that are not positive numbers.
    """
    chosen = camera_of(camera)
    assert chosen is not None
    when = exposure or Exposure(0.01)
    if electrons is None:
        brightest_e = max(BRIGHTEST_OVER_SATURATION * chosen.saturation_e, 10 * DARKEST_E)
        count = round(LEVELS_PER_DECADE * np.log10(brightest_e / DARKEST_E)) + 1
        electrons = np.geomspace(DARKEST_E, brightest_e, count).tolist()
    levels = np.asarray(electrons, dtype=np.float64).ravel()
    if not levels.size or not (np.isfinite(levels) & (levels > 0)).all():
        raise InputError(
            f"electrons is {electrons!r}; pass mean photoelectrons per pixel above 0, e.g. [10, 100, 1000]."
        )
    shape = min(SIDE_PX, chosen.sensor.rows), min(SIDE_PX, chosen.sensor.columns)
    found = []
    for level in (0.0, *levels):
        light = Photons(np.full(shape, level), detected=True)
        sensor = exposure_of_photons(light, chosen, when, {"serial": serial})
        moments = pixel_moments(sensor.stages, sensor.detected.now(), sensor.first)
        found.append((moments.mean.mean(), moments.temporal.mean() ** 0.5, moments.mean.std()))
    mean_dn, temporal_dn, spatial_dn = np.transpose(found)
    signal_dn = mean_dn[1:] - mean_dn[0]
    return SnrCurve(chosen.name, when, levels, signal_dn, temporal_dn[1:], spatial_dn[1:])
