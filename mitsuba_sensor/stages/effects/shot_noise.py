"""Shot noise: whole electrons, Poisson(photoelectrons) + Poisson(dark electrons).

Compensated render noise: shot noise gives way to the noise of the render where each frame has a render of its own. The
mean light of a render has an error of some variance v. Electrons are then drawn about that mean μ with variance μ − v,
so that over frames, each with its own render, the total has the variance μ of a Poisson law and no more.

Of a mean μ, light or dark, the variance s ≤ μ is compensated by drawing

    N = m + Bernoulli(f) + Poisson(μ − m − f),    m = ⌊s⌋, f = √(s − m)

whole electrons, mean μ, variance f(1 − f) + μ − m − f = μ − s: both exact at every mean. It needs m + f ≤ μ; below one
electron that is s ≤ μ², and no law of whole numbers goes further, for those about a mean μ < 1 vary by μ − μ² at least.
Of light and dark current the one whose mean allows it gives way to all of v: only their sum shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from ...core import Array, CountedElectrons, Electrons, Frame, arrays
from ..datasheet import FileTable, Positive
from ..stage import Datasheet, ElectronCounter

# Share of μ that is compensated at most; what a render has beyond stays in the frame, and is reported. The noise that
# is drawn must hide the shape of the render's. Renders should aim at half of this, v = 0.16·μ: where v comes from eight
# passes, it is measured as more than the double in one pixel of twenty. Then the total has the variance of Poisson's
# law to 1 % and its third moment to 38 %, from 1 e- up (benchmarks/compensation.py).
LIMIT = 1 / 3


def compensable(light_e: Array, dark_e: Array, variance_e2: Array) -> tuple[Array, Array]:
    """How much of the render's variance the shot noise of light and of dark current compensate, (H, W) each [e-²].

    min(v, LIMIT·(light + dark), the most that the larger of the two allows), all of it from the light where that
    allows it, else all of it from the dark current.  variance_e2 : v, of the mean light over renders [e-²].
    """
    found = arrays.minimum(variance_e2, LIMIT * (light_e + dark_e))
    found = arrays.minimum(found, largest_e2(arrays.maximum(light_e, dark_e)))
    by_light = found <= largest_e2(light_e)
    return arrays.where(by_light, found, found * 0.0), arrays.where(
        by_light, found * 0.0, found
    )


def largest_e2(mean_e: Array) -> Array:
    """The largest variance s with ⌊s⌋ + √(s − ⌊s⌋) ≤ mean: ⌊mean⌋ + (mean − ⌊mean⌋)² [e-²]."""
    whole = arrays.floor(mean_e)
    return whole + (mean_e - whole) * (mean_e - whole)


def reserved(mean_e: Array, compensated_e2: Array, frame: Frame) -> tuple[Array, Array]:
    """Whole electrons m + Bernoulli(f), and the mean of the Poisson count beside them, (H, W).

    With that count they are electrons of mean ``mean_e`` and variance ``mean_e − compensated_e2``.
    """
    whole = arrays.floor(compensated_e2)
    chance = arrays.sqrt(compensated_e2 - whole)
    rest = arrays.maximum((mean_e - whole) - chance, 0.0)
    # One stream of Bernoulli draws for all, for only one source compensates.
    return whole + frame.bernoulli("compensation", chance), rest


Share = Annotated[float, Field(gt=0, le=0.9999, strict=True)]
MOST_RESETS = 3
SOURCES = ("photon_shot", "shot_behind_reset_1", "shot_behind_reset_2", "shot_behind_reset_3")
"""Noise sources of the parts of an exposure with partial resets."""

LEFT, RIGHT = "left", "right"
"""Photodiodes of a dual pixel: of their streams of random numbers, and of their read-outs."""


class ResetFields(FileTable):
    """Partial resets of the well during the exposure."""

    partial_resets: Annotated[
        tuple[tuple[Share, Positive], ...], Field(max_length=MOST_RESETS)
    ] = Field(
        (),
        title="piecewise-linear response, knee, multi-slope, well reset",
        description="partial resets during the exposure, which make the response piecewise linear: share of the "
        "exposure time, and the electrons that the reset leaves [e-]",
        examples=[[[0.9, 8000]]],
    )

    @model_validator(mode="after")
    def _resets_follow_each_other(self) -> Self:
        resets = self.partial_resets
        for (share, level_e), (later, higher_e) in pairwise(resets):
            if later <= share or higher_e <= level_e:
                raise ValueError(
                    f"partial_resets has [{later:g}, {higher_e:g}] behind [{share:g}, {level_e:g}]; each comes later "
                    "and leaves more than the one before"
                )
        return self


@dataclass(frozen=True)
class ShotNoise(ElectronCounter):
    """Poisson(light) + Poisson(dark), in *detected* electrons (paper eq. 13, 17 corrected).

    The two are drawn as one Poisson(light + dark). Where they are needed apart, each electron of that count is a dark
    electron with chance dark/(light + dark), by a random number of its own: the count is the same.

    Thinning a Poisson stream of photons by QE leaves a Poisson stream, so var/mean = 1 here, not QE.

    Where the mean is that of a render with a known variance, one render per frame, the counts vary by that much less
    about it. Over frames with renders of their own var/mean is 1 again; about its own render less.
    """

    domain = "electrons"
    table = "pixel"
    fields = ResetFields
    terms = "photon shot noise, dark shot noise, Poisson noise"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> ShotNoise:
        """Every camera has it; with partial resets it is counted in the parts between them."""
        if camera.sensor.dual_pixel:
            return DualPixelShotNoise()
        if camera.pixel.partial_resets:
            return ShotNoiseWithResets(camera.pixel.partial_resets)
        return cls()

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons → whole electrons."""
        if electrons.variance_e2 is None:
            return self._counts(electrons, frame)
        light, dark = electrons.light, electrons.dark
        by_light, by_dark = compensable(light, dark, electrons.variance_e2)
        more_light, light = reserved(light, by_light, frame)
        more_dark, dark = (
            reserved(dark, by_dark, frame) if arrays.any_positive(dark) else (0.0, 0.0)
        )
        rest = self._counts(replace(electrons, light=light, dark=dark, variance_e2=None), frame)
        return rest.changed(
            lambda n: n + (more_light + more_dark), lambda n, d: (n + more_light, d + more_dark)
        )

    def _counts(self, mean: Electrons, frame: Frame) -> Electrons:
        """Poisson counts; of light and dark current as one, but where light is still interactions, not electrons."""
        light, dark = mean.light, mean.dark
        if not arrays.any_positive(dark):
            return replace(mean, light=frame.poisson("photon_shot", light), dark=0.0)
        if not isinstance(mean.yield_mean, float):
            return replace(
                mean,
                light=frame.poisson("photon_shot", light),
                dark=frame.poisson("dark_shot", dark),
            )
        count = frame.poisson("photon_shot", light + dark)
        return CountedElectrons(count, lambda: frame.split("dark_shot", count, light, dark))


@dataclass(frozen=True)
class DualPixelShotNoise(ShotNoise):
    """Poisson counts of the two photodiodes of a dual pixel, added up: each draws the electrons of its own read-out.

    The law of the sum is that of one photodiode. The dark current is half in each.
    """

    label = ShotNoise.label
    compensates: ClassVar[bool] = False

    @classmethod
    def key(cls) -> str:
        """That of the shot noise of one photodiode."""
        return ShotNoise.key()

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons of both photodiodes → whole electrons of both."""
        half, light = frame.number(0.5), electrons.light
        share = half if electrons.left_share is None else electrons.left_share
        dark = half * electrons.dark
        of_left = replace(electrons, light=share * light, dark=dark)
        of_right = replace(electrons, light=(1 - share) * light, dark=dark)
        left = self._counts(of_left, replace(frame, charge=LEFT, _blocks={}))
        right = self._counts(of_right, replace(frame, charge=RIGHT, _blocks={}))
        return CountedElectrons(
            left.total + right.total,
            lambda: (left.light + right.light, left.dark + right.dark),
        )


@dataclass(frozen=True)
class ShotNoiseWithResets(ShotNoise):
    """Poisson counts of the parts of the exposure between partial resets of the well, each of which leaves so much.

    n = min(n + Poisson(μ·Δt), level) at each reset: the response is piecewise linear, and behind the last reset the
    variance is that of the electrons since then.  resets : share of the exposure time, and level [e-], of each.
    """

    resets: tuple[tuple[float, float], ...] = ()
    label = ShotNoise.label
    compensates: ClassVar[bool] = False
    is_poisson: ClassVar[bool] = False

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons → whole electrons."""
        begin, left, mean = 0.0, 0.0, electrons.total
        for number, (share, level_e) in enumerate(self.resets):
            left = left + frame.poisson(SOURCES[number], frame.number(share - begin) * mean)
            left, begin = arrays.minimum(left, frame.number(level_e)), share
        last = SOURCES[len(self.resets)]
        count = left + frame.poisson(last, frame.number(1 - begin) * mean)
        return CountedElectrons(
            count, lambda: frame.split("dark_shot", count, electrons.light, electrons.dark)
        )


def left_by_resets(resets: tuple[tuple[float, float], ...], mean_e: float) -> float:
    """Electrons in the well at the end of an exposure with these resets, of so many mean electrons, without noise."""
    begin, left = 0.0, 0.0
    for share, level_e in resets:
        left, begin = min(left + (share - begin) * mean_e, level_e), share
    return left + (1 - begin) * mean_e
