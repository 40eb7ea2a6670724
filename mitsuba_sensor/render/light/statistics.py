"""Render statistics: how a render was made, its noise relative to the sensor, and whether its error bars are
reliable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, TypedDict

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from ...core.errors import shown
from ..samples import PASSES_MIN

FIREFLIES_MAX = 0.12
"""Firefly fraction above which error bars are not reliable. With 8 passes it is at most 0.10 in calm scenes, 0.14 to
0.29 before a caustic at every number of samples (benchmarks/error_bar_coverage.py), and 0.11 to 0.8 with glass in the
Cornell box."""
POOLED = 2**20  # number of passes of a known variance: denoised or pooled over a neighbourhood
LEVEL_MIN = 1e-3  # of the mean of the image; darker pixels are compared at this level
POOLED_PASSES_MIN = 3
SPARSE_VARIANCE = 1 / 4  # relative variance of a mean, as of four paths that found light
RELATIVE_ERROR_MAX = 1e6  # of pixels without light


@dataclass(frozen=True)
class TimeSampling:
    """How finely the open shutter was sampled by sub-frames, and the remaining error.

    subframes : sub-frames in each pass and exposure of a row. Over the passes they cover all instants, so the blur of a
        steady light has only the error ``blur_too_long_px``, if rows of a rolling shutter share sub-frames.
    speed_px_per_s, step_px : largest motion of the image, and the motion between two sub-frames.
    waveform_displaced_share, waveform_displaced_px : largest change by twice as many sub-frames under a flickering
        light: the fraction of the light of a row that is displaced, and by how much. None for a steady light.
    """

    subframes: int
    speed_px_per_s: float
    step_px: float
    blur_too_long_px: float
    waveform_displaced_share: float | None
    waveform_displaced_px: float | None


def coarsest(parts: Iterable[TimeSampling | None]) -> TimeSampling | None:
    """Return the time sampling of the light group with the most displaced light."""
    known = [part for part in parts if part is not None]
    return max(known, key=lambda part: part.waveform_displaced_share or 0.0, default=None)


@dataclass(frozen=True)
class RenderStatistics:
    """How an irradiance was rendered, and how much noise the renderer added.

    noise_ratio_* : render variance over the sensor's temporal variance, both as electrons at the input: median, 95th
        percentile and maximum of the lit pixels. Above 1 the renderer adds more noise than the sensor.
    noise_ratio_asked, ended_by : the requested ratio (None without one), and what ended the render: "spp",
        "sensor_noise" (95 % of the lit pixels have less render noise than sensor noise), "noise_ratio", "max_seconds"
        or "max_spp".
    reliable : True if the error bars can be trusted; NaN values make them unreliable.
    firefly_fraction : fraction of the lit pixels in which one bright pass causes more than three quarters of the
        variance: rare paths (caustics) that other passes have not found yet.
    spectral : "cube", "single" or "channels".
    negative, non_finite : number of values of single passes that were set to 0 (+inf is kept and saturates its pixel).
    notes : replacements in the scene, spectra that are black, hints.
    scene_sha256 : hash of the scene file, its includes and its parameters.
    aperture_f_number : f-number of the scene's thin-lens aperture on this sensor; None without one. It determines the
        blur; the camera's f-number determines the light.
    intrinsics : projection of the world onto the image, see :func:`optics.intrinsics.intrinsics`.
    camera_to_world : pose of the camera when the first row opens, four rows of four numbers: left, up, forward (with
        the scale of the scene's to_world) and position [m]; None for light from elsewhere.
    denoised : record of the denoiser, or None; raw_noise_ratio_* : before denoising, raw_weight : mean weight of the
        render, sum_corrected_by : fraction of the light that was moved to keep the sums of the render.
    seconds_per_sample : time of one sample in every pixel, without the first pass, which compiles.
    beyond_data : photoelectrons that depend on assumptions where data of the scene end, see
        :class:`lint.spectrum_checks.ElectronShare`.
    sum_error : relative standard error of the sum of the photoelectrons of all pixels, denoised or not; None if
        unknown. For regions see :meth:`light.irradiance.Irradiance.error_of_sum`.
    motion : time sampling of moving objects; None without motion.
    metering : record of the metered exposure time, see :class:`sensor.metering.Metering`; None if the time was given.
    brightness : brightest_lamp_cd_per_m2 (of area lights), median_cd_per_m2 (luminance of the image), illuminance_lx
        (mean over the sensor), each None if unknown, and light_scale, the factor on all emitters; None for light from
        elsewhere.
    facts : replacements in the scene that change nothing in the frame.
    """

    passes: int
    samples_per_pixel: int
    seconds: float
    variant: str
    sampler: str
    spectral: str
    noise_ratio_median: float
    noise_ratio_p95: float
    noise_ratio_max: float
    noise_ratio_asked: float | None
    ended_by: str
    reliable: bool
    firefly_fraction: float
    negative: int
    non_finite: int
    notes: tuple[str, ...]
    scene_sha256: str
    aperture_f_number: float | None
    intrinsics: dict[str, Any] | None = None
    camera_to_world: list[list[float]] | None = None
    denoised: dict[str, Any] | None = None
    metering: dict[str, float] | None = None
    seconds_per_sample: float = 0.0
    sum_error: float | None = None
    beyond_data: tuple[Mapping[str, object], ...] = ()
    motion: TimeSampling | None = None
    brightness: dict[str, float | None] | None = None
    facts: tuple[str, ...] = ()

    def __repr__(self) -> str:
        taken = f"{self.samples_per_pixel} samples per pixel in {self.seconds:.3g} s"
        noise = f"render noise {self.noise_ratio_median:.3g} × sensor noise (variance, median)"
        return f"<RenderStatistics: {taken}, {noise}>"

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            **asdict(self),
            "notes": list(self.notes),
            "facts": list(self.facts),
            "beyond_data": list(self.beyond_data),
        }

    @classmethod
    def from_dict(cls, values: object) -> RenderStatistics:
        """Return the statistics of such values, the inverse of :meth:`to_dict`. Raises ValueError for a wrong type."""
        try:
            return TypeAdapter(cls).validate_python(values)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            name = ".".join(map(str, first["loc"])) or "the render statistics"
            raise ValueError(f"{name} is {shown(first['input'])}") from None


class NoiseRatios(TypedDict):
    """Noise ratio of the lit pixels: median, 95th percentile, maximum."""

    noise_ratio_median: float
    noise_ratio_p95: float
    noise_ratio_max: float


def summary_of(ratio: NDArray[np.float64], lit: NDArray[np.bool_], passes: int) -> NoiseRatios:
    """Return the noise ratios of the lit pixels with finite light. The median of a variance measured with few degrees
    of freedom is below its mean (χ²), which is corrected."""
    finite = ratio[np.isfinite(ratio) & lit]
    median, p95, most = (
        np.percentile(finite, (50, 95, 100), overwrite_input=True).tolist()
        if finite.size
        else (0.0, 0.0, 0.0)
    )
    median *= median_bias(passes)
    return {"noise_ratio_median": median, "noise_ratio_p95": p95, "noise_ratio_max": most}


def sum_error(mean: NDArray[np.float64], variance: NDArray[np.float64]) -> float:
    """Return the relative standard error of the sum over the image, whose pixels are independent.

    mean, variance : mean of the passes and variance of this mean, shape (H, W).
    """
    finite = np.isfinite(mean) & np.isfinite(variance)
    total = float(mean[finite].sum())
    return float(np.sqrt(variance[finite].sum())) / total if total > 0 else 0.0


def median_bias(passes: int) -> float:
    """Return mean over median of a variance measured by this many passes: of χ² with one degree of freedom less."""
    freedom = max(passes - 1, 1)
    return freedom / float(scipy.special.chdtri(freedom, 0.5))


def pooled(
    mean: NDArray[np.floating], variance: NDArray[np.floating], passes: int
) -> NDArray[np.floating]:
    """Return (d·v + d₀·v₀)/(d + d₀) for the variance v of the mean of few passes, shape (H, W) or (H, W, B).

    d : degrees of freedom of the pixel's variance v.  v₀ : variance at the relative variance of 3 × 3 pixels.
    d₀ : degrees of freedom of v₀, from the spread of log v − log v₀ over the image beyond the part explained by d
    (Smyth 2004, doi 10.2202/1544-6115.1027).

    With 7 degrees of freedom the pixel's variance is uncertain by half, so its error bar holds for 88 % of the pixels
    at two standard errors, compared with 95 % for a known variance. If few paths find the light, a pixel with no or few
    paths has too small a variance; there both mean and variance are averages over 3 × 3 pixels.
    """
    if passes < POOLED_PASSES_MIN:
        return variance
    least = LEVEL_MIN * mean.mean(axis=(0, 1)) + np.finfo(np.float32).tiny
    level, around = np.maximum(mean, least), np.maximum(near_mean(mean), least)
    own, freedom = variance / level / level, passes - 1
    near = near_mean(own)
    sparse = np.minimum((near / SPARSE_VARIANCE) ** 2, 1)
    near += sparse * (near_mean(variance) / around / around - near)
    near = np.maximum(near, own / 9)
    lit = (own > 0) & np.isfinite(near)
    apart = np.log(own[lit] / near[lit])
    most = 9 * freedom
    prior = float(most)
    if apart.size:
        beyond = float(apart.var()) - float(scipy.special.polygamma(1, freedom / 2))
        prior = min(2 / beyond, most) if beyond > 2 / most else most
    squared = np.where(mean > 0, (1 - sparse) * level**2, 0) + sparse * around**2
    return np.asarray((freedom * variance + prior * near * squared) / (freedom + prior))


def near_mean(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return means over 3 × 3 pixels, shape (H, W) or (H, W, B); the image is mirrored at its edges."""
    for axis in (0, 1):
        values = np.moveaxis(values, axis, 0)
        wide = np.concatenate([values[:1], values, values[-1:]])
        values = np.moveaxis((wide[:-2] + wide[1:-1] + wide[2:]) / 3, 0, axis)
    return values


def relative_errors(
    mean: NDArray[np.floating], variance: NDArray[np.floating], infinite: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Return standard errors over the light, shape (H, W): 0 without light, inf for infinite light."""
    error = np.sqrt(variance)
    least = error / RELATIVE_ERROR_MAX + np.finfo(float).tiny
    error /= np.maximum(mean, least, out=least)
    error[mean <= 0], error[infinite] = 0.0, np.inf
    return np.asarray(error, np.float32)


def why_not_trusted(passes: int, fireflies: float, lost: int = 0) -> str:
    """Return one line on why the error bars are not reliable, and what helps; empty if they are reliable.

    lost : number of NaN values of single passes.
    """
    if lost:
        why = f"{lost} values of single passes were NaN and count as 0"
        helps = "correct the texture, environment map or material that they come from"
        return f"the light is too dark by an unknown amount: {why}; {helps}"
    if passes < PASSES_MIN:
        why = f"{passes} passes of at least {PASSES_MIN}"
        return f"error bars are guesses: {why}; render again with more samples (spp=)"
    if fireflies <= FIREFLIES_MAX:
        return ""
    why = f"in {100 * fireflies:.1f} % of the lit pixels, one pass causes most of the noise (rare paths, e.g. caustics)"
    helps = "enlarge the light or roughen the surface (more samples help slowly)"
    return f"error bars are too small: {why}; {helps}"
