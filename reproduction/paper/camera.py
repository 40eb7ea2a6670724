"""Table 1's camera, with and without curves and column offsets; its frames; closed forms of its response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mitsuba_sensor import Camera, Exposure, expose, load_camera
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.study.kit import Array

FULL_WELL_E, CODES, EFFICIENCY = 33_000.0, 4096.0, 0.60  # Table 1
PRNU, COLUMN_DN = 0.005, 0.001 * CODES  # Table 1: 0.5 % and 0.10 % of a full well
READ_E = 6.105069  # closed form of the source follower's noise with the released code's densities and times
DARK_E_PER_S, KELVIN = (
    1741.58223,
    298.15,
)  # eq. 1 with Table 1's D_FM, normalised at 300 K, at +25 °C
GAIN = CODES / FULL_WELL_E  # K, 0.1241212 DN/e-
FULL_PHOTONS = FULL_WELL_E / EFFICIENCY
ROWS, COLUMNS = 1300, 1900  # Table 1
FRAME_S = 0.1  # §Photon Transfer Curve: 100 ms

LINEAR, PAIR, ONLY_VV, ONLY_ADC = "linear", "V/V 1.05 + ADC 1.04", "V/V 1.05", "ADC 1.04"
CURVES: dict[str, dict[str, Any]] = {
    LINEAR: {},
    PAIR: {
        "source_follower.vv_nonlinearity": 1.05,
        "adc.gamma": 1.04,
    },  # §Photon Transfer Curve
    ONLY_VV: {"source_follower.vv_nonlinearity": 1.05},
    ONLY_ADC: {"adc.gamma": 1.04},
}
NO_COLUMNS: dict[str, Any] = {"readout.dsnu_col": 0.0}


@dataclass(frozen=True)
class Size:
    """How much is measured. window : side of the centre that flat and dark frames are made of [pixel]."""

    window: int = 512  # §Radiometric function
    gradient: tuple[int, int] = (
        ROWS,
        COLUMNS,
    )  # pixels of the scene of the photon transfer curves
    other_rows: int = 325  # of the curves that only closed forms are compared with
    frames: int = 64  # §Photon Transfer Curve, §PRNU
    dark_frames: int = 32  # §Dark signal performance
    chips: int = 100  # §Noise Spectrogram: measurements of F

    @property
    def origin(self) -> tuple[int, int]:
        """Of the window, in the middle of the sensor."""
        return (ROWS - self.window) // 2, (COLUMNS - self.window) // 2

    def flat(self, photons: float) -> Array:
        """The window under uniform light."""
        return np.full((self.window, self.window), photons)


FULL = Size()
SMALL = Size(window=160, gradient=(96, 950), other_rows=64, frames=32, dark_frames=32, chips=12)


def table1(**changes: Any) -> Camera:
    """The camera of Table 1 with these fields changed, ``__`` for the dot."""
    return load_camera("konnik_table1").replace(
        **{name.replace("__", "."): value for name, value in changes.items()}
    )


def stack_of(
    camera: Camera, exposure_s: float, photons: Array | float, size: Size, **options: Any
) -> Stack:
    """Frames at +25 °C.  photons : of a scene, or of a flat field of the size's window.  options : of ``expose``."""
    flat = np.ndim(photons) == 0
    light, origin = (
        (size.flat(float(photons)), size.origin) if flat else (np.asarray(photons), (0, 0))
    )
    frames = expose(
        light, camera, Exposure(exposure_s, KELVIN), origin=origin, **options
    ).digital
    return Stack(
        frames, exposure_s, float(photons) if flat else light, KELVIN, bits=camera.adc.bits
    )


@dataclass(frozen=True)
class Response:
    """Closed form of the means and temporal variances: DN above the black level from electrons N, with n = N/N_well.

    s = n·(1 + (vv − 1)·n)/range, y = 4096·s·γ^(−s), σ² = (dy/dN)²·(N + read²) + 1/12.

    vv, gamma : of the source follower and the ADC, 1 for none.  range : V_FS over the linear swing of a full well.
    """

    vv: float = 1.0
    gamma: float = 1.0
    range: float = 1.0

    def signal(self, electrons: Array) -> Array:
        """y [DN]."""
        share = self._share(electrons)
        return np.asarray(CODES * share * self.gamma**-share)

    def slope(self, electrons: Array) -> Array:
        """dy/dN [DN/e-]."""
        n, share = np.asarray(electrons) / FULL_WELL_E, self._share(electrons)
        curved = (1 + 2 * (self.vv - 1) * n) / self.range
        return np.asarray(GAIN * curved * self.gamma**-share * (1 - share * np.log(self.gamma)))

    def variance(self, electrons: Array) -> Array:
        """Temporal [DN²]."""
        return np.asarray(
            self.slope(electrons) ** 2 * (np.asarray(electrons) + READ_E**2) + 1 / 12
        )

    def electrons(self, signal: Array, dark_e: float) -> Array:
        """N of a signal above the dark signal of so many electrons, up to 1.2 full wells."""
        n = np.linspace(0, 1.2 * FULL_WELL_E, 100_000)
        return np.asarray(
            np.interp(np.asarray(signal) + self.signal(np.array(dark_e)), self.signal(n), n)
        )

    def snr(self, signal: Array, dark_e: float) -> Array:
        """Signal over temporal noise [1]."""
        return np.asarray(signal / np.sqrt(self.variance(self.electrons(signal, dark_e))))

    def _share(self, electrons: Array) -> Array:
        n = np.asarray(electrons) / FULL_WELL_E
        return np.asarray(n * (1 + (self.vv - 1) * n) / self.range)


RESPONSES = {
    LINEAR: Response(),
    PAIR: Response(1.05, 1.04, 1.05),
    ONLY_VV: Response(1.05, 1.0, 1.05),
    ONLY_ADC: Response(1.0, 1.04, 1.0),
}
"""V_FS is the non-linear swing of a full well, so that the well and not the converter ends the response."""
