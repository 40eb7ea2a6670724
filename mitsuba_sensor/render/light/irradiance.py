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
from ...core import Exposure, InputError
from ...core.signals import Illuminant
from ...optics.waveform import Waveform
from .light_html import light_html
from .light_sum import with_levels, without_unlit
from .statistics import RenderStatistics

Region: TypeAlias = tuple[slice, slice] | NDArray[np.bool_]
WHOLE = slice(None), slice(None)


@dataclass(frozen=True, eq=False)
class RenderedFor:
    """What an irradiance was rendered for, which an exposure of it takes unless told otherwise.

    camera : None where stages were added to it, which a file cannot keep.  serial : number of the camera.
    illuminant : of the scene, where the camera has colour filters and an emitter was found.
    """

    camera: Camera | None
    exposure: Exposure
    serial: int
    illuminant: Illuminant | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        illuminant = (
            None
            if self.illuminant is None
            else {k: x.tolist() for k, x in self.illuminant._asdict().items()}
        )
        camera = None if self.camera is None else self.camera.model_dump(mode="json")
        return {
            "camera": camera,
            "exposure": asdict(self.exposure),
            "serial": self.serial,
            "illuminant": illuminant,
        }

    def shared_with(self, camera: Camera, exposure: Exposure, serial: int | None) -> list[str]:
        """What another exposure of the light has in common with this one."""
        pairs = {
            "camera": (camera, self.camera),
            "exposure": (exposure, self.exposure),
            "serial": (serial, self.serial),
        }
        return [name for name, (other, own) in pairs.items() if other == own]

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> RenderedFor:
        """The inverse. Raises InputError for a camera that cannot be."""
        camera, light = values["camera"], values["illuminant"]
        return cls(
            None if camera is None else camera_from(camera, "of the irradiance"),
            Exposure(**values["exposure"]),
            int(values["serial"]),
            None
            if light is None
            else Illuminant(**{name: np.array(x, dtype=float) for name, x in light.items()}),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Irradiance:
    """Spectral irradiance at the focal plane, and its standard errors.

    ::

        light = ms.render("cornell_box", camera, exposure, width=64)
        print(light.data.shape, light.wavelengths_nm, light.notes)

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
    polarizers : the fingerprint of the polarisers that it was rendered for, or None: ``data`` is then for each pixel
        what unpolarised light would be that passes its polariser as this light does, S0 + c·(S1 cos 2θ + S2 sin 2θ).
    origin : (row, column) of the first pixel on the sensor: where the film's crop window begins.
    rendered_for : camera, exposure and serial number, where they are known.
    raw : the same light before it was denoised, if asked for and denoised; its statistics are its own.
    pass_error : (H, W) standard error of the photoelectrons by the spread of the passes, before denoising, over the
        photoelectrons; None where it is not known. See :meth:`error_of_sum`.
    groups : the light groups by name, each as it was rendered; empty where the light was rendered as a whole.
    levels : what each group is multiplied by in ``data``, see :meth:`with_lights`.
    waveforms : of the groups that flicker; ``data`` and its errors are the mean over time. Frames get the light of the
        time at which their rows are open.
    later : of a scene that moves, the light of the exposures that follow the first one of a frame, by the read-out that
        is exposed again; files do not hold it.
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
        said = {name: f"{level:g}" for name, level in self.levels.items()} | dict(
            self.waveforms
        )
        levels = ", ".join(f"{name} {said[name]}" for name in self.groups)
        return f"<Irradiance: {size}{levels and f', light groups {levels}'}>"

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the render that may surprise: what was replaced in the scene, what is black, hints. What only
        light groups have that are off is left out."""
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
        """The light of the same scene with other lamps on, or with lamps that flicker, without a render.

        ::

            groups = {"lamps": "lamp_*", "headlights": "headlight_*"}
            light = ms.render("night_crossing", light_groups=groups, width=96)
            dark = light.with_lights(headlights=0, lamps=0.2)
            flickering = light.with_lights(signals=ms.pwm(90, 0.3), lamps="2 mains(50)")

        levels : by the name of the light group, what it is multiplied by, from as it was rendered, or a waveform with a
            ``level``; 1 of those that are not named.
        ``data`` is the mean over time, and standard errors are those of the new sum; the statistics stay those of the
        render. Raises InputError for a name that the light does not have, and for a level that is negative or not
        finite.
        """
        return with_levels(self, {**(levels or {}), **named})

    def of_serial(self, serial: int) -> Irradiance:
        """The same, remembering this serial number of the camera."""
        return (
            self
            if self.rendered_for is None
            else replace(self, rendered_for=replace(self.rendered_for, serial=serial))
        )

    def error_of_sum(self, region: Region = WHOLE) -> float:
        """Relative standard error of the sum of the light over a region, all bands together.

        region : what indexes a map (H, W): a pair of slices (rows, columns), or a mask (H, W) of bool.

        Neighbouring pixels of denoised light have errors in common: the root of the sum of the squares of their error
        bars is too small. Their sum is at most as uncertain as that of the passes, whose pixels are independent and
        whose sums denoising keeps, or as if all pixels of the region had one error.
        Pixels of infinite light do not count. Raises InputError for a region that selects no pixel of the picture, and
        for light whose passes are not known.
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
        own, passes = (
            _part(x, region)[finite] * light for x in (self.relative_error, self.pass_error)
        )
        total, of_passes = float(light.sum()), math.sqrt(float((passes**2).sum()))
        if total <= 0:
            return 0.0
        if self.statistics.denoised is None:
            return of_passes / total
        separate, common = math.sqrt(float((own**2).sum())), float(own.sum())
        return max(separate, min(common, of_passes)) / total

    def before_denoising(self) -> Irradiance:
        """The light as it was rendered. Raises InputError where it was denoised and that was not kept."""
        if self.raw is None and self.statistics.denoised is not None:
            raise InputError(
                "raw_light is asked for and this light is denoised only; render it again with --raw-light."
            )
        if self.raw is None:
            return self
        later = {name: light.before_denoising() for name, light in self.later.items()}
        return replace(self.raw, rendered_for=self.rendered_for, later=later)


def is_exact(light: Irradiance, camera: Camera) -> bool:
    """Whether the light holds this camera's photoelectrons, whatever its bands."""
    known = light.in_band is not None and light.response == pixel_fingerprint(camera)
    return known or (
        light.filters is not None and light.response == response_fingerprint(camera)
    )


def _part(image: NDArray[np.floating], region: Region) -> NDArray[np.floating]:
    """The pixels of a map (H, W) in a region. Raises InputError where it is none, or selects no pixel."""
    is_mask = (
        isinstance(region, np.ndarray) and region.dtype == bool and region.shape == image.shape
    )
    is_window = (
        isinstance(region, tuple)
        and len(region) == 2
        and all(isinstance(x, slice) for x in region)
    )
    if not (is_mask or is_window) or not image[region].size:
        height, width = image.shape
        raise InputError(
            f"region is {region!r}; it must be two slices (rows, columns) or a mask of bool that select pixels of "
            f"{height} × {width}, e.g. (slice(0, {height // 2 or 1}), slice(None))."
        )
    return image[region]
