"""Metering: find the exposure time at which an image of this light is well exposed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..camera.figures import metered_saturation_e
from ..core import (
    Doubt,
    Electrons,
    Exposure,
    Float64Array,
    Frame,
    InputError,
    Photons,
    SensorWindow,
    check_types,
    checks_names,
    require,
)
from ..core.backend import FLOAT32_LIMIT
from ..core.exposure import TIME_MAX_S
from ..stages.effects.dark_current import mean_dark_e
from ..stages.stage import detector_of
from .detection import Detected, detect
from .options import PERCENTILE, SHARE
from .run import row_strips_of

if TYPE_CHECKING:
    from ..camera.camera import Camera

SATURATED_MAX = 0.2
"""Above this fraction of saturated pixels a shorter time is suggested."""
SHOT_NOISE_SIGMAS = 2.5
"""Range of light [σ of shot noise] in which the fraction of saturated pixels rises linearly from 0 to 1."""
PIXELS_AT_ONCE = 2**18
DIGITS = 3
"""Digits of the metered time, so that it can be typed."""


@checks_names
@dataclass(frozen=True)
class Metering:
    """An exposure whose time follows from the light.

    ::

        median = ms.Metering(percentile=50.0, share=0.3)
        captured = ms.capture("cornell_box", camera, median, width=64)

    percentile : percentile of the lit pixels that reaches ``share`` of saturation, dark current included.
    share : fraction of saturation.  temperature_k : sensor temperature [K].
    Raises InputError for numbers out of range.
    """

    percentile: float = PERCENTILE
    share: float = SHARE
    temperature_k: float = 298.15

    def __post_init__(self) -> None:
        Exposure(0.0, self.temperature_k)
        require(
            "percentile", self.percentile, 1.0, 100.0, "of the lit pixels, in percent, e.g. 95"
        )
        require("share", self.share, 1e-6, 1.0, "of saturation, e.g. 0.7")

    @classmethod
    def of_text(cls, text: str, temperature_k: float = 298.15) -> Metering:
        """Return the metering of a text ``"PERCENTILE:SHARE"``, as in scene files. Raises InputError."""
        try:
            percentile, share = map(float, text.split(":"))
        except (ValueError, AttributeError):
            raise InputError(
                f"meter is {text!r}; give PERCENTILE:SHARE, the percentile of the lit pixels (1 to 100) and the "
                f"fraction of saturation that it reaches (up to 1), e.g. {PERCENTILE:g}:{SHARE:g}."
            ) from None
        return cls(percentile, share, temperature_k)

    @property
    def unit_exposure(self) -> Exposure:
        """Exposure of 1 s in which light is collected for metering."""
        return Exposure(1.0, self.temperature_k)

    def exposure(self, photons: Photons, camera: Camera) -> Exposure:
        """Return the metered exposure, with a time of three digits [s]. Raises InputError if no pixel has light.

        photons : mean photons of :attr:`unit_exposure`.
        """
        return Exposure(self.time_s(photons, camera, self.unit_exposure), self.temperature_k)

    def time_s(self, photons: Photons, camera: Camera, exposure: Exposure) -> float:
        """Return the metered time [s] from the mean photons of any exposure. Raises InputError."""
        return self.time_of(electrons_of(photons, camera, exposure), camera, exposure)

    def time_of(
        self, electrons: NDArray[np.floating], camera: Camera, exposure: Exposure
    ) -> float:
        """Return the metered time [s] from the mean electrons of each pixel in any exposure. Raises InputError.

        Unlit pixels and pixels of infinite light do not count.
        """
        lit = electrons[electrons > 0]
        bounded = lit[lit < FLOAT32_LIMIT]
        if not lit.size:
            raise InputError(
                "no pixel has any light to meter; set an exposure time, e.g. 0.1 s."
            )
        if not bounded.size:
            raise InputError(
                f"every lit pixel has {FLOAT32_LIMIT:g} electrons or more in {exposure.time_s:g} s, too many to meter; "
                "check the unit of the light, or set an exposure time, e.g. 0.1 s."
            )
        level_e = float(np.percentile(bounded, self.percentile)) + mean_dark_e(camera, exposure)
        time_s = exposure.time_s * self.share * metered_saturation_e(camera) / level_e
        return min(float(f"{time_s:.{DIGITS}g}"), TIME_MAX_S)

    def record(self, exposure: Exposure) -> dict[str, float]:
        """Return the metered time and its rule, for metadata."""
        return {
            "exposure_s": exposure.time_s,
            "percentile": self.percentile,
            "share_of_saturation": self.share,
        }


AUTO = Metering()
"""Metering for exposure "auto", unless a scene or light sets its own rule and temperature."""

AskedExposure: TypeAlias = Exposure | Metering | Literal["auto"]


def checked_exposure(
    camera: object, exposure: AskedExposure | None
) -> Exposure | Metering | None:
    """Return the requested exposure or metering. Raises InputError for a wrong type of exposure or camera."""
    asked = AUTO if isinstance(exposure, str) and exposure == "auto" else exposure
    check_types(camera, None if isinstance(asked, Metering) else asked, optional=True)
    return asked


def electrons_of(photons: Photons, camera: Camera, exposure: Exposure) -> Float64Array:
    """Return the mean electrons that the light of an exposure frees in each pixel, shape (H, W)."""
    rows, columns = photons.shape[:2]
    signal = detect(
        photons,
        detector_of(camera.stages),
        Frame(exposure, SensorWindow(0, (rows, columns), photons.origin)),
    ).signal
    return np.asarray(signal.light * signal.yield_mean, dtype=np.float64)


def clipped_note(light: Detected, camera: Camera, frame: Frame) -> Iterator[str]:
    """Note many saturated pixels, with the time that metering would choose.

    light : light on the window of ``frame``.
    """
    electrons, exposure = _mean_electrons(light, camera, frame), frame.exposure
    share = saturated_share(electrons, camera, exposure)
    if share > SATURATED_MAX:
        remedy = _remedy(electrons, camera, exposure)
        yield Doubt(
            f"{100 * share:.0f} % of the pixels are saturated at {exposure.time_s:g} s{remedy}"
        )


def saturated_share(
    electrons: NDArray[np.floating], camera: Camera, exposure: Exposure
) -> float:
    """Return the mean fraction of the pixels that saturate, with shot noise and dark current.

    electrons : mean electrons of the light, shape (H, W).
    """
    try:
        level_e = camera.saturation_e
    except InputError:  # the black level is the full-scale code
        return 1.0
    limit_e = max(
        level_e - mean_dark_e(camera, exposure), -FLOAT32_LIMIT
    )  # the light may be float32
    width_e = SHOT_NOISE_SIGMAS * math.sqrt(max(level_e, 1.0))
    if electrons.max() < limit_e - width_e / 2:
        return 0.0
    saturated = 0.0
    for rows in row_strips_of((electrons.shape[0], electrons.shape[1]), PIXELS_AT_ONCE):
        beyond = (electrons[rows] - limit_e) / width_e + 0.5
        saturated += float(np.clip(beyond, 0.0, 1.0).sum(dtype=np.float64))
    return saturated / electrons.size


def _mean_electrons(light: Detected, camera: Camera, frame: Frame) -> NDArray[np.floating]:
    """Return the mean electrons of each pixel, also for a chain that begins with photons."""
    signal = light.signal
    if not isinstance(signal, Electrons):
        return electrons_of(light.photons, camera, frame.exposure)
    return np.asarray(signal.light * signal.yield_mean)


def _remedy(electrons: NDArray[np.floating], camera: Camera, exposure: Exposure) -> str:
    """Return how to saturate fewer pixels; empty if no exposure time helps, e.g. in infinite light."""
    shorter_s, dark_e = np.inf, mean_dark_e(camera, exposure)
    with suppress(InputError):  # no pixel has light
        shorter_s = Metering().time_of(electrons, camera, exposure)
    if shorter_s < exposure.time_s:
        return f"; expose for {shorter_s:g} s, as metering does"
    if dark_e < camera.pixel.full_well_e:
        return ""
    return (
        f", of which dark current is {dark_e:.3g} e-; cool the sensor, or expose for less time"
    )
