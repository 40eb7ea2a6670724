"""Mean photons and electrons per pixel: what enters the sensor and what its well collects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Photons:
    """Mean photons per pixel in one exposure; means, so they are not whole numbers.

    mean : (H, W), or (H, W, B) with one layer per band; never negative, never NaN; +inf saturates its pixel.
    wavelengths_nm : (B,) centre of each band, or None when ``mean`` is (H, W) at the camera's own wavelength.
    detected : whether ``mean`` has one layer per colour filter with the QE in it: electrons of a pixel behind it.
    origin : (row, column) of the first pixel on the sensor, where nobody says otherwise.
    variance_e2 : (H, W), variance of the mean light electrons over renders [e-²], still to be counted within the shot
        noise, for a frame that has a render of its own; None: the mean is exact.
    """

    mean: NDArray[Any]
    wavelengths_nm: NDArray[np.float64] | None = None
    variance_e2: NDArray[Any] | None = None
    detected: bool = False
    origin: tuple[int, int] = (0, 0)

    @property
    def total(self) -> NDArray[Any]:
        """Photons per pixel over all bands, (H, W)."""
        return self.mean if self.mean.ndim == 2 else self.mean.sum(axis=-1)

    def rows_only(self, rows: slice) -> Photons:
        """The same light on ``rows`` of the window."""
        variance_e2 = None if self.variance_e2 is None else self.variance_e2[rows]
        return replace(self, mean=self.mean[rows], variance_e2=variance_e2)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.mean, dtype=dtype, copy=copy)


@dataclass(frozen=True, eq=False)
class Electrons:
    """Electrons per pixel, those that light freed and those of the dark current apart.

    light, dark : (H, W), or a scalar where every pixel has the same; means before the shot noise, whole counts after.
    yield_mean, yield_variance : electrons per interacting photon where that is not one (ultraviolet).
    variance_e2 : of the mean light over renders [e-²], still to be counted within the shot noise; None: it is exact.
    """

    light: Any
    dark: Any = 0.0
    yield_mean: Any = 1.0
    yield_variance: Any = 0.0
    variance_e2: Any = None

    @property
    def total(self) -> Any:
        """Nobody can tell the two apart in the well: light + dark, (H, W)."""
        return self.light + self.dark
