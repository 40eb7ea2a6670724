"""Spectral irradiance at the focal plane, with the standard errors of its Monte Carlo estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...camera.camera_file import camera_from
from ...camera.fingerprint import pixel_fingerprint, response_fingerprint
from ...core import Exposure, InputError, checks_names
from ...core.signals import Illuminant
from ...optics.waveform import Waveform
from .light_html import light_html
from .light_sum import with_levels, without_unlit
from .statistics import RenderStatistics

Region: TypeAlias = tuple[slice, slice] | NDArray[np.bool_]
WHOLE = slice(None), slice(None)


@dataclass(frozen=True, eq=False)
class RenderedFor:
    """Camera, exposure and serial number of a render, which an exposure of its light takes by default.

    camera : None if it has added stages, which a file cannot keep.
    illuminant : of the scene, if the camera has colour filters and an emitter was found.
    """

    camera: Camera | None
    exposure: Exposure
    serial: int
    illuminant: Illuminant | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        illuminant = self.illuminant
        return {
            "camera": self.camera and self.camera.model_dump(mode="json"),
            "exposure": asdict(self.exposure),
            "serial": self.serial,
            "illuminant": illuminant
            and {name: x.tolist() for name, x in illuminant._asdict().items()},
        }

    def shared_with(self, camera: Camera, exposure: Exposure, serial: int | None) -> list[str]:
        """Return the names of the fields that another exposure of the light shares with the render."""
        other = {"camera": camera, "exposure": exposure, "serial": serial}
        return [name for name, value in other.items() if value == getattr(self, name)]

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> RenderedFor:
        """Return the object of such values, the inverse of :meth:`to_dict`. Raises InputError for a wrong camera."""
        camera, light = values["camera"], values["illuminant"]
        return cls(
            None if camera is None else camera_from(camera, "of the irradiance"),
            Exposure(**values["exposure"]),
            int(values["serial"]),
            None
            if light is None
            else Illuminant(**{name: np.array(x, dtype=float) for name, x in light.items()}),
        )


@checks_names
@dataclass(frozen=True, eq=False, repr=False)
class Irradiance:
    """Spectral irradiance at the focal plane, and its standard errors.

    ::

        light = ms.render("cornell_box", camera, exposure, width=64)
        print(light.data.shape, light.wavelengths_nm, light.notes)

    data : mean over pixel and band, shape (H, W, B), float32 [W m⁻² nm⁻¹].
    wavelengths_nm, bandwidths_nm : centres and widths of the bands, shape (B,).
    standard_error : of the Monte Carlo mean, shape (H, W, B) [W m⁻² nm⁻¹].
    relative_error : relative standard error of the photoelectrons of the camera of the render, shape (H, W). It does
        not follow from ``standard_error``, because the bands of a pixel are correlated.
    filters : None, or the colour filters whose responses replace bands; ``data`` [W m⁻²] is then the light that a
        quantum efficiency of 1 at ``wavelengths_nm`` would detect.
    in_band : photoelectrons of each pixel of the camera of the render, over those of a spectrum that is flat within
        each band, shape (H, W); None if unknown.
    response : fingerprint of the camera of ``filters`` or ``in_band``.
    polarizers : fingerprint of the polarisers of the render, or None. With polarisers, ``data`` is the unpolarised
        light of which each pixel's polariser passes as much, S0 + c·(S1 cos 2θ + S2 sin 2θ).
    origin : (row, column) of the first pixel on the sensor, at the start of the film's crop window.
    rendered_for : camera, exposure and serial number, if known.
    raw : the light before denoising, with its own statistics, if it was requested and denoised.
    pass_error : relative standard error of the photoelectrons by the spread of the passes, before denoising, shape
        (H, W); None if unknown. See :meth:`error_of_sum`.
    groups : the light groups by name, as rendered; empty for light that was rendered as a whole.
    levels : factor of each group in ``data``, see :meth:`with_lights`.
    waveforms : of the groups that flicker. ``data`` and its errors are means over time; frames get the light at the
        time when their rows are open.
    later : of a moving scene, the light of the later exposures of a frame, by readout; files do not contain it.
    """

    data: NDArray[np.float32]
    wavelengths_nm: NDArray[np.float64]
    bandwidths_nm: NDArray[np.float64]
    standard_error: NDArray[np.float32]
    relative_error: NDArray[np.float32]
    statistics: RenderStatistics
    filters: tuple[str, ...] | None = None
    response: str | None = None
    polarizers: str | None = None
    origin: tuple[int, int] = (0, 0)
    in_band: NDArray[np.float32] | None = None
    rendered_for: RenderedFor | None = None
    raw: Irradiance | None = None
    pass_error: NDArray[np.float32] | None = None
    groups: Mapping[str, Irradiance] = field(default_factory=dict)
    levels: Mapping[str, float] = field(default_factory=dict)
    waveforms: Mapping[str, Waveform] = field(default_factory=dict)
    later: Mapping[str, Irradiance] = field(default_factory=dict)

    def __repr__(self) -> str:
        """``<Irradiance: 256 × 384, 32 bands, 367.5 … 832.5 nm>``."""
        (height, width, count), nm = self.data.shape, self.wavelengths_nm
        what = "filters" if self.filters else "bands"
        size = f"{height} × {width}, {count} {what}, {nm[0]:g} … {nm[-1]:g} nm"
        texts = {name: f"{x:g}" for name, x in self.levels.items()} | dict(self.waveforms)
        levels = ", ".join(f"{name} {texts[name]}" for name in self.groups)
        return f"<Irradiance: {size}{levels and f', light groups {levels}'}>"

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on possible problems: replacements in the scene, spectra that are black, hints; without notes on light
        groups that are off."""
        of_groups = {name: light.statistics.notes for name, light in self.groups.items()}
        lit = [name for name in self.groups if self.levels.get(name, 1.0) > 0]
        return without_unlit(self.statistics.notes, of_groups, lit)

    def _repr_html_(self) -> str:
        return light_html(self)

    def with_lights(
        self,
        levels: Mapping[str, float | str | Waveform] | None = None,
        /,
        **named: float | str | Waveform,
    ) -> Irradiance:
        """Return the light of the same scene with other levels or waveforms of its lamps, without a render.

        ::

            groups = {"lamps": "lamp_*", "headlights": "headlight_*"}
            light = ms.render("night_crossing", light_groups=groups, width=96)
            dark = light.with_lights(headlights=0, lamps=0.2)
            flickering = light.with_lights(signals=ms.pwm(90, 0.3), lamps="2 mains(50)")

        levels : factor on the rendered light, or a waveform with a ``level``, by name of the light group; default 1.

        ``data`` is the mean over time, and standard errors belong to the new sum; the statistics still describe the
        render. Raises InputError for an unknown name, and for a level that is negative or not finite.
        """
        return with_levels(self, {**(levels or {}), **named})

    def of_serial(self, serial: int) -> Irradiance:
        """Return the light as rendered for this serial number of the camera."""
        known = self.rendered_for
        return replace(self, rendered_for=known and replace(known, serial=serial))

    def error_of_sum(self, region: Region = WHOLE) -> float:
        """Return the relative standard error of the sum of the light over a region and all bands.

        region : a pair of slices (rows, columns), or a mask of bool, shape (H, W).

        Neighbouring pixels of denoised light share errors, so adding their error bars in quadrature gives too small an
        error. The error of the sum is at most the error from the passes, whose pixels are independent and whose sums
        denoising keeps, and at most the error of fully correlated pixels. Pixels of infinite light are excluded.
        Raises InputError for a region without a pixel, and for light without passes.
        """
        if self.pass_error is None:
            raise InputError(
                "the error of a sum follows from the passes of a render, which this light does not hold; render it "
                "again."
            )
        width = np.ones(len(self.filters)) if self.filters else self.bandwidths_nm
        light = _part(self.data.astype(np.float64) @ width, region)
        finite = np.isfinite(light)
        light = light[finite]
        errors, passes = (
            _part(x, region)[finite] * light for x in (self.relative_error, self.pass_error)
        )
        total, of_passes = float(light.sum()), math.sqrt(float((passes**2).sum()))
        if total <= 0:
            return 0.0
        if self.statistics.denoised is None:
            return of_passes / total
        independent, correlated = math.sqrt(float((errors**2).sum())), float(errors.sum())
        return max(independent, min(correlated, of_passes)) / total

    def before_denoising(self) -> Irradiance:
        """Return the light before denoising. Raises InputError if only denoised light was kept."""
        if self.raw is None and self.statistics.denoised is not None:
            raise InputError(
                "raw_light needs undenoised light, but this light is only kept denoised; render it again with "
                "raw_light=True."
            )
        if self.raw is None:
            return self
        later = {name: light.before_denoising() for name, light in self.later.items()}
        return replace(self.raw, rendered_for=self.rendered_for, later=later)


def is_exact(light: Irradiance, camera: Camera) -> bool:
    """Return True if the light contains this camera's photoelectrons exactly, regardless of its bands."""
    known = light.in_band is not None and light.response == pixel_fingerprint(camera)
    return known or (
        light.filters is not None and light.response == response_fingerprint(camera)
    )


def _part(image: NDArray[np.floating], region: Region) -> NDArray[np.floating]:
    """Return the pixels of a map, shape (H, W), in a region. Raises InputError for a region without a pixel."""
    if isinstance(region, tuple):
        is_region = [type(x) for x in region] == [slice, slice]
    else:
        mask = np.asarray(region)
        is_region = mask.dtype == bool and mask.shape == image.shape
    if not is_region or not image[region].size:
        height, width = image.shape
        raise InputError(
            f"region is {region!r}; it must be two slices (rows, columns) or a mask of bool that select pixels of "
            f"{height} × {width}, e.g. (slice(0, {height // 2 or 1}), slice(None))."
        )
    return image[region]
