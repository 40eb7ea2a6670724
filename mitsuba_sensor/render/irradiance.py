"""Spectral irradiance at the focal plane, with the standard errors of its Monte Carlo estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import InputError
from .statistics import RenderStatistics


@dataclass(frozen=True, eq=False)
class Irradiance:
    """Spectral irradiance at the focal plane, and its standard errors.

    data : (H, W, B) mean over pixel and band [W m⁻² nm⁻¹]; float32, as in a file.
    wavelengths_nm, bandwidths_nm : (B,) centres and widths of the bands.
    standard_error : (H, W, B) of the Monte Carlo mean, same unit.
    relative_error : (H, W) relative standard error of the photoelectrons of the camera that it was rendered for;
        kept beside ``standard_error`` because the bands of a pixel are correlated.
    filters : None, or the colour filters whose responses took the place of bands: ``data`` [W m⁻²] is then what would
        be detected with a quantum efficiency of 1 at ``wavelengths_nm``.
    in_band : (H, W) photoelectrons of each pixel of the camera that it was rendered for, over those of a spectrum that
        is flat within each band; None where they are not known.
    response : the fingerprint of the camera of ``filters`` or ``in_band``.
    origin : (row, column) of the first pixel on the sensor: where the film's crop window begins.
    raw : the same light before it was denoised, if asked for and denoised; its statistics are its own.
    """

    data: NDArray[np.float32]
    wavelengths_nm: NDArray[np.float64]
    bandwidths_nm: NDArray[np.float64]
    standard_error: NDArray[np.float32]
    relative_error: NDArray[np.float32]
    statistics: RenderStatistics
    filters: tuple[str, ...] | None = None
    response: str | None = None
    origin: tuple[int, int] = (0, 0)
    in_band: NDArray[np.float32] | None = None
    raw: Irradiance | None = None

    def before_denoising(self) -> Irradiance:
        """The light as it was rendered. Raises InputError where it was denoised and that was not kept."""
        if self.raw is None and self.statistics.denoised is not None:
            raise InputError(
                "raw_light is asked for and this light is denoised only; render it again with --raw-light."
            )
        return self if self.raw is None else self.raw
