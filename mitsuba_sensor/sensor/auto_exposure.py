"""Automatic exposure: a controller that brings the mean of the frames to a target, frame by frame.

    e_k = ln(target / measured of frame k − delay),   X_{k+1} = X_k·exp(damping·e_k)

X is the exposure time times the overall system gain K. In constant light, without delay, the error shrinks by
(1 − damping) from frame to frame. The controller changes the time first and takes a higher gain setting only if the
time reaches its limit. A rolling shutter is open for a whole number of rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..camera.exposure_times import longest_exposure_s
from ..camera.figures import saturation_e
from ..core import Exposure, InputError, checks_names, nearest, require
from ..optics.shutter import shutter_of
from ..stages.gains import gain_dn_per_e

DARKEST_OVER_SATURATION = 1e-6
"""A darker mean is treated as this fraction of saturation."""
EXAMPLE = "target 0.18, damping 0.5, delay 2"


@checks_names
@dataclass(frozen=True)
class AutoExposure:
    """A controller of exposure time and gain, from frame to frame.

    ::

        control = ms.AutoExposure(target=0.18, damping=0.5, delay=2, mains_hz=50)
        captured = ms.capture("scenes/rolling_fan.xml", fps=30, frames=20, auto_exposure=control)

    target : mean of a frame above black, a fraction of saturation.
    damping : fraction of the error (in stops) that the next frame corrects, 0 to 1.
    delay : frames between the measured frame and the first frame that responds.
    shortest_s, longest_s : limits of the exposure time [s]. Default of the longest: the frame period.
    mains_hz : 50 or 60 keeps the time at multiples of half a mains period, so light sources cause no bands.
    """

    target: float = 0.18
    damping: float = 0.5
    delay: int = 0
    shortest_s: float = 1e-6
    longest_s: float | None = None
    mains_hz: float | None = None

    def __post_init__(self) -> None:
        require("target", self.target, 1e-4, 1.0, "a fraction of saturation, e.g. 0.18")
        require("damping", self.damping, 1e-3, 1.0, "a fraction of the error, e.g. 0.5")
        delay = require("delay", self.delay, 0, 1000, "a whole number of frames, e.g. 2")
        if delay % 1:
            raise InputError(f"delay is {delay}; give a whole number of frames, e.g. 2.")
        object.__setattr__(self, "delay", int(delay))
        require("shortest_s", self.shortest_s, 1e-12, 1e6, "seconds, e.g. 1e-5")
        if self.longest_s is not None:
            require(
                "longest_s", self.longest_s, self.shortest_s, 1e6, "seconds from shortest_s on"
            )
        if self.mains_hz is not None:
            require("mains_hz", self.mains_hz, 1.0, 1e4, "hertz, e.g. 50")

    @classmethod
    def of_text(cls, text: str) -> AutoExposure:
        """Return the controller that a text like ``"target 0.18, damping 0.5, delay 2"`` names. Raises InputError."""
        numbers = dict[str, float]()
        for part in filter(None, (part.strip() for part in text.split(","))):
            name, _, number = part.replace("=", " ").partition(" ")
            if name not in cls.__dataclass_fields__:
                known = ", ".join(cls.__dataclass_fields__)
                raise InputError(
                    f"auto_exposure names {name!r}; its numbers are {known}, e.g. {EXAMPLE!r}."
                    f"{nearest(name, cls.__dataclass_fields__)}"
                )
            try:
                numbers[name] = float(number)
            except ValueError:
                raise InputError(
                    f"auto_exposure has {part!r}; {number!r} is not a number; give e.g. {EXAMPLE!r}."
                ) from None
        return cls(**numbers)  # type: ignore[arg-type]


def checked_auto_exposure(name: str, given: object) -> AutoExposure:
    """Return a controller, which may be given as text. Raises InputError."""
    if isinstance(given, AutoExposure):
        return given
    if isinstance(given, str):
        return AutoExposure.of_text(given)
    raise InputError(f"{name} is {given!r}; pass AutoExposure(target=0.18), or {EXAMPLE!r}.")


@dataclass
class ExposureControl:
    """The state of a controller: camera and exposure of the next frame.

    settings : K [DN/e-] and the camera at each gain, the lowest first.
    saturation_dn : saturation of the first camera above black [DN].
    """

    rule: AutoExposure
    camera: Camera
    exposure: Exposure
    longest_s: float
    settings: list[tuple[float, Camera]]
    saturation_dn: float
    errors: list[float] = field(default_factory=list)

    @classmethod
    def begin(
        cls, rule: AutoExposure, camera: Camera, exposure: Exposure, period_s: float
    ) -> ExposureControl:
        """Return a controller whose first frame has this exposure, moved into the limits. Raises InputError."""
        longest_s = longest_exposure_s(camera, period_s)
        if rule.longest_s is not None:
            longest_s = min(rule.longest_s, longest_s)
        if longest_s < rule.shortest_s:
            raise InputError(
                f"shortest_s is {rule.shortest_s:g}, but a frame lasts {longest_s:g} s; reduce shortest_s or fps."
            )
        gain = gain_dn_per_e(camera)
        saturation_dn = saturation_e(camera) * gain
        settings = sorted(_settings(camera), key=lambda setting: setting[0])
        control = cls(rule, camera, exposure, longest_s, settings, saturation_dn)
        control.exposure = replace(exposure, time_s=control._allowed_s(exposure.time_s))
        return control

    def measure(self, digital: NDArray[np.unsignedinteger]) -> float:
        """Return the mean of a frame above black, a fraction of saturation, and set camera and exposure of the next."""
        black_dn = self.camera.black_level_dn
        mean_dn = float(digital.mean(dtype=np.float64)) - black_dn
        measured = mean_dn / self.saturation_dn
        self.errors.append(math.log(self.rule.target / max(measured, DARKEST_OVER_SATURATION)))
        if len(self.errors) > self.rule.delay:
            error = self.errors[-1 - self.rule.delay]
            now = self.exposure.time_s * gain_dn_per_e(self.camera)
            self._set(now * math.exp(self.rule.damping * error))
        return measured

    def _set(self, wanted: float) -> None:
        """Set time and gain so that their product is ``wanted`` [s·DN/e-] or the nearest within the limits."""
        for gain, camera in self.settings:
            self.camera = camera
            if wanted / gain <= self.longest_s:
                break
        time_s = self._allowed_s(wanted / gain_dn_per_e(self.camera))
        self.exposure = replace(self.exposure, time_s=time_s)

    def _allowed_s(self, time_s: float) -> float:
        """Return the nearest time within the limits [s]: whole half-periods of the mains if at least one fits, and
        whole rows of a rolling shutter."""
        time_s = min(max(time_s, self.rule.shortest_s), self.longest_s)
        if self.rule.mains_hz is not None:
            time_s = whole_steps(time_s, 0.5 / self.rule.mains_hz, 0.0, self.longest_s)
        row_s = shutter_of(self.camera, self.exposure).row_time_s
        if row_s > 0:
            time_s = whole_steps(time_s, row_s, self.rule.shortest_s, self.longest_s)
        return time_s


def whole_steps(time_s: float, step_s: float, shortest_s: float, longest_s: float) -> float:
    """Return the nearest whole number of steps within the limits [s], at least one; the time itself if none fits."""
    fewest = math.ceil(shortest_s / step_s - 1e-9)
    most = math.floor(longest_s / step_s + 1e-9)
    steps = min(max(round(time_s / step_s), fewest), most)
    return steps * step_s if steps >= max(fewest, 1) else time_s


def _settings(camera: Camera) -> Iterator[tuple[float, Camera]]:
    """Yield K and the camera, unchanged and at each of its other gain settings."""
    yield gain_dn_per_e(camera), camera
    for setting in camera.gains:
        if setting.label != camera.gain:
            other = camera.at_gain(setting.label)
            yield gain_dn_per_e(other), other
