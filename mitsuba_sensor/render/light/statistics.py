"""Render statistics: how a render was made, its noise beside the sensor's, and whether its error bars are reliable."""

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

# Firefly fraction above which the error bars are not reliable. With 8 passes it is at most 0.10 in calm scenes, 0.14 to
# 0.29 before a caustic at every number of samples (benchmarks/error_bar_coverage.py), and 0.11 to 0.8 with glass in the
# Cornell box, until the bars hold there.
MOST_FIREFLIES = 0.12
POOLED = (
    2**20
)  # passes whose variance is known: a denoised or pooled pixel's is that of its neighbourhood
DARKEST = (
    1e-3  # of the mean of the picture: darker pixels are compared as if they were as bright
)
POOLED_PASSES_MIN = 3
SPARSE = (
    1 / 4
)  # relative variance of a mean, as of four paths that found light: neighbours know more
RELATIVE_MAX = 1e6  # standard error over the light: of pixels in which there is none


@dataclass(frozen=True)
class TimeSampling:
    """How finely the open shutter was sampled by sub-frames, and the error that is left of it.

    subframes : of each pass, in the exposure of a row; over the passes they lie at all instants of it, so that the blur
        of a steady light has no error of its own but ``blur_too_long_px``, where rows of a rolling shutter share them.
    speed_px_per_s, step_px : largest motion of the image, and from one sub-frame to the next.
    waveform_displaced_share, waveform_displaced_px : of a light that flickers, what twice as many sub-frames would
        change at most: this share of the light of a row is seen so far from its place. None of a steady light.
    """

    subframes: int
    speed_px_per_s: float
    step_px: float
    blur_too_long_px: float
    waveform_displaced_share: float | None
    waveform_displaced_px: float | None


def coarsest(parts: Iterable[TimeSampling | None]) -> TimeSampling | None:
    """Of several light groups, that with the most displaced light."""
    known = [part for part in parts if part is not None]
    return max(known, key=lambda part: part.waveform_displaced_share or 0.0, default=None)


@dataclass(frozen=True)
class RenderStatistics:
    """How an irradiance came about, and how much of its noise is the renderer's.

    noise_ratio_* : render variance over the sensor's own temporal variance, both as electrons at the input: median,
        95th percentile and largest of the lit pixels. Above 1 the noise is more the renderer's than the sensor's.
    noise_ratio_asked, ended_by : the ratio that it worked towards (None if none), and what ended it: "spp",
        "sensor_noise" (95 % of the lit pixels have less render noise than sensor noise), "noise_ratio",
        "max_seconds" or "max_spp".
    reliable, firefly_fraction : whether the error bars can be trusted, which NaN rules out, and the share of the lit
        pixels that owe more than three quarters of their variance to one bright pass: rare paths (caustics) that others
        have not seen yet.
    spectral : "cube", "single" or "channels".
    negative, non_finite : values of single passes that were set to 0 (+inf is kept: it saturates its pixel).
    notes : what was replaced in the scene, what is black, hints.
    scene_sha256 : of the scene file, its includes and its parameters.
    aperture_f_number : what the scene's own thin-lens aperture means on this sensor, None where it has none. It makes
        the blur; the camera's f-number makes the light.
    intrinsics : how the picture is a projection of the world, see :func:`optics.intrinsics.intrinsics`.
    camera_to_world : pose of the camera when the first row opens, four rows of four numbers: its columns are left,
        up and forward, with the scale of the scene's to_world, and the position [m]; None for light from elsewhere.
    denoised : what the denoiser did, or None; raw_noise_ratio_* : before, raw_weight : mean weight of the render,
        sum_corrected_by : share of the light that was moved to have the render's sums.
    seconds_per_sample : of one sample in every pixel, by the passes after the first one, which compiles.
    beyond_data : what part of the photoelectrons rests on what was assumed where data of the scene end, see
        :class:`lint.electron_share.ElectronShare`.
    sum_error : relative standard error of the sum of the photoelectrons of all pixels, denoised or not; for regions
        see :meth:`light.irradiance.Irradiance.error_of_sum`. None where it is not known.
    motion : how finely an exposure of moving things was sampled; None where nothing moves.
    metering : the exposure time that was found and how, see :class:`sensor.metering.Metering`; None where it was given.
    brightness : brightest_lamp_cd_per_m2 (of area lights), median_cd_per_m2 (luminance of the picture),
        illuminance_lx (mean of the sensor), each None where it is not known, and light_scale, what all emitters were
        multiplied by; None for light from elsewhere.
    facts : what was replaced in the scene and changes nothing in the frame.
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
        """Plain values, ready for JSON."""
        return {
            **asdict(self),
            "notes": list(self.notes),
            "facts": list(self.facts),
            "beyond_data": list(self.beyond_data),
        }

    @classmethod
    def from_dict(cls, values: object) -> RenderStatistics:
        """The inverse of :meth:`to_dict`. Raises ValueError for a value that is not of its type."""
        try:
            return TypeAdapter(cls).validate_python(values)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            name = ".".join(map(str, first["loc"])) or "the render statistics"
            raise ValueError(f"{name} is {shown(first['input'])}") from None


class NoiseRatios(TypedDict):
    """Noise ratio of the lit pixels: median, 95th percentile, largest."""

    noise_ratio_median: float
    noise_ratio_p95: float
    noise_ratio_max: float


def summary_of(ratio: NDArray[np.float64], lit: NDArray[np.bool_], passes: int) -> NoiseRatios:
    """Of the lit pixels, without those of infinite light. A variance that was measured with few degrees of freedom has
    a median below its mean (χ²), which is corrected."""
    finite = ratio[np.isfinite(ratio) & lit]
    median, p95, most = (
        np.percentile(finite, (50, 95, 100), overwrite_input=True).tolist()
        if finite.size
        else (0.0, 0.0, 0.0)
    )
    median *= median_bias(passes)
    return {"noise_ratio_median": median, "noise_ratio_p95": p95, "noise_ratio_max": most}


def sum_error(mean: NDArray[np.float64], variance: NDArray[np.float64]) -> float:
    """Relative standard error of the sum over the picture; pixels are independent. mean, variance : (H, W) of the
    passes and of that mean."""
    finite = np.isfinite(mean) & np.isfinite(variance)
    total = float(mean[finite].sum())
    return float(np.sqrt(variance[finite].sum())) / total if total > 0 else 0.0


def median_bias(passes: int) -> float:
    """Mean over median of a variance that was measured by so many passes: of χ² with one degree of freedom less."""
    freedom = max(passes - 1, 1)
    return freedom / float(scipy.special.chdtri(freedom, 0.5))


def pooled(
    mean: NDArray[np.floating], variance: NDArray[np.floating], passes: int
) -> NDArray[np.floating]:
    """Return (d·v + d₀·v₀)/(d + d₀) for the variance v of the mean of few passes; all (H, W) or (H, W, B).

    d : degrees of freedom of v, the pixel's own.  v₀ : at the relative variance of 3 × 3 pixels.  d₀ : for how many
    degrees of freedom v₀ counts, from how far log v and log v₀ differ over the picture, beyond what d explains
    (Smyth 2004, doi 10.2202/1544-6115.1027).
    With 7 degrees of freedom the pixel's own variance is off by half, so that its error bar holds for 88 % of the
    pixels at two standard errors, where a known one holds for 95 %. Where few paths find the light, a pixel that none
    has found, or few, has too small a variance, by chance too: there both mean and variance are those of 3 × 3 pixels.
    """
    if passes < POOLED_PASSES_MIN:
        return variance
    least = DARKEST * mean.mean(axis=(0, 1)) + np.finfo(np.float32).tiny
    level, around = np.maximum(mean, least), np.maximum(near_mean(mean), least)
    own, freedom = variance / level / level, passes - 1
    near = near_mean(own)
    sparse = np.minimum((near / SPARSE) ** 2, 1)
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
    """Return means over 3 × 3 pixels, (H, W) or (H, W, B); beyond the picture lies its mirror image."""
    for axis in (0, 1):
        values = np.moveaxis(values, axis, 0)
        wide = np.concatenate([values[:1], values, values[-1:]])
        values = np.moveaxis((wide[:-2] + wide[1:-1] + wide[2:]) / 3, 0, axis)
    return values


def relative_errors(
    mean: NDArray[np.floating], variance: NDArray[np.floating], infinite: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Return standard errors over the light, all (H, W): 0 without light, inf where it is infinite."""
    found = np.sqrt(variance)
    least = found / RELATIVE_MAX + np.finfo(float).tiny
    found /= np.maximum(mean, least, out=least)
    found[mean <= 0], found[infinite] = 0.0, np.inf
    return np.asarray(found, np.float32)


def why_not_trusted(passes: int, fireflies: float, lost: int = 0) -> str:
    """One line that says why the error bars are not reliable, and what helps; empty if they are.

    lost : values of single passes that were NaN.
    """
    if lost:
        why = f"{lost} values of single passes were NaN and count as 0"
        helps = "correct the texture, environment map or material that they come from"
        return f"the light is too dark by an unknown amount: {why}; {helps}"
    if passes < PASSES_MIN:
        return f"error bars are guesses: {passes} passes of at least {PASSES_MIN}; take more samples (--spp)"
    if fireflies <= MOST_FIREFLIES:
        return ""
    why = f"{fireflies:.1%} of the lit pixels owe most of their noise to one pass (rare paths, e.g. caustics)"
    helps = "more samples help slowly, a larger light or a rougher surface helps at once"
    return f"error bars are too small: {why}; {helps}"
