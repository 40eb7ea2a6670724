"""Report of one frame: theory of every stage, a sample of it, counts of clipped pixels, light outside the QE curve."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..camera.camera import Camera
from ..core import Array, Electrons, Frame, Photons, arrays
from ..core.backend import Backend
from ..core.types import Float64Array
from ..sensor.frame_notes import outside_qe
from ..sensor.run import Strip, strips_of
from ..stages.compensation import LIMIT, compensable
from ..stages.gains import gain_dn_per_e
from ..stages.stage import UNITS, Stage, place_of, total
from .frame_theory import FrameTheory
from .tiles import Tile


class FrameObserver:
    """Follows a frame behind every stage: counts over all pixels, sums over the sampled ones.

    theory : of every pixel, which says which ones are followed.
    """

    def __init__(self, theory: FrameTheory) -> None:
        self.theory = theory
        self.counts: Counter[str] = Counter(
            clipped_full_well=0, clipped_adc_low=0, clipped_adc_high=0
        )
        self.sums: Float64Array = np.zeros((len(theory.stages), 3))
        self.compensated: Float64Array = np.zeros(4)
        self._lock = threading.Lock()

    def strip(self, strip: Strip, frame: Frame) -> StripFollower:
        """Before a strip is computed.  frame : of all its rows."""
        if frame.window.backend.compiled:
            followed = []
        else:
            followed = self._followed(strip)
        return StripFollower(self, strip, frame, followed)

    def count(self, counts: Mapping[str, int]) -> None:
        """Pixels of the masks of one strip."""
        self.counts.update(counts)

    def sample(self, backend: Backend) -> None:
        """Follow the sampled strips on the host, if that was not done while the frame was computed."""
        if self.sums.any():
            return
        frame = self.theory.frame.on(backend)
        for strip in strips_of(self.theory.stages, frame.window):
            followed = self._followed(strip)
            if not followed:
                continue
            window = frame.window.crop_rows(strip.around)
            part = replace(frame, window=window, _blocks={})
            follower = StripFollower(self, strip, part, followed)
            signal = self.theory.light.crop_rows(strip.around).signal
            for number, stage in enumerate(self.theory.stages):
                if number:
                    signal = stage.sample(signal, part)
                follower.behind(stage, signal)

    def _followed(self, strip: Strip) -> list[FollowedPixels]:
        """Those of a strip."""
        with self._lock:  # what is expected is computed once
            parts = list(self.theory.expected_in(strip.rows))
        return [FollowedPixels(tile, strip.around.start, means) for tile, means in parts]

    def add(self, number: int, signal: Array, mean: Float64Array) -> None:
        """The signal behind a stage in some pixels, and its expected value."""
        values = np.asarray(signal, dtype=np.float64)
        with np.errstate(invalid="ignore"):
            residual = np.nan_to_num(values - mean, nan=0.0, posinf=0.0)
            if (
                getattr(signal, "dtype", None) == np.float32
            ):  # the last digit of a float32 is no noise
                residual = np.where(
                    np.abs(residual) <= np.spacing(np.abs(signal)), 0.0, residual
                )
        with self._lock:
            self.sums[number] += float(np.sum(values)), float(np.sum(residual**2)), values.size

    def add_compensation(self, mean: Electrons) -> Array:
        """The render's variance in some pixels; where it is not compensated in full."""
        by_light, by_dark = compensable(mean.light, mean.dark, mean.variance_e2)
        done = by_light + by_dark
        if arrays.is_numpy(done):
            shot = np.where(mean.variance_e2 > 0, mean.total, 0.0)
            with self._lock:
                sums = [np.sum(x, dtype=np.float64) for x in (mean.variance_e2, done, shot)]
                self.compensated += [*sums, done.size]
        return done < mean.variance_e2


class FollowedPixels(NamedTuple):
    """Pixels of a window that are followed.

    first : row of the window from which on their strip is computed.
    means : expected behind every stage, by its number.
    """

    tile: Tile
    first: int
    means: dict[int, Float64Array]

    def of_strip(self, signal: Array, shape: tuple[int, int]) -> Array:
        """Their part of the signal of the strip."""
        rows, columns = self.tile
        here = slice(rows.start - self.first, rows.stop - self.first)
        return np.broadcast_to(np.asarray(signal), shape)[here, columns]


class StripFollower:
    """Sees the signals of one strip.  followed : the pixels that count; of all others only the masks."""

    def __init__(
        self,
        observer: FrameObserver,
        strip: Strip,
        frame: Frame,
        followed: list[FollowedPixels],
    ) -> None:
        self.observer, self.frame, self.followed = observer, frame, followed
        self.strip = strip
        self.masks: dict[str, Array] = {}

    def behind(self, stage: Stage, signal: Array) -> None:
        """The signal behind a stage."""
        stages, value = self.observer.theory.stages, total(signal)
        number = place_of(stage, stages)
        self.masks |= stage.marked(value, self.frame)
        if number + 1 < len(stages):
            following = stages[number + 1]
        else:
            following = None
        if (
            following is not None
            and following.counts_electrons
            and signal.variance_e2 is not None
        ):
            self.masks["compensated_short"] = self.observer.add_compensation(signal)
        for part in self.followed:
            values = part.of_strip(value, self.frame.window.shape)
            self.observer.add(number, values, part.means[number])

    def end(self) -> dict[str, Array]:
        """Masks of the rows that the strip delivers, whose pixels are to be counted."""
        if self.strip.around == self.strip.rows:
            return self.masks
        shape, inside = self.frame.window.shape, self.strip.inside
        return {name: np.broadcast_to(mask, shape)[inside] for name, mask in self.masks.items()}


def report(camera: Camera, observer: FrameObserver) -> dict[str, Any]:
    """The report of the frame that was observed, ready for JSON.

    ``photons`` (min, median, max per pixel; of electrons where they are ``detected``), ``stages`` (below), ``counts``
    of clipped and cut pixels, photons ``outside_qe`` and ``K_dn_per_e``. Each stage has mean and σ as they must be,
    averaged over the window (σ total, temporal, spatial; the standard errors of mean, temporal and spatial σ), and as
    ``sampled_pixels`` of this frame have them: σ_frame is the rms distance of the pixels from their own means.
    ``theory`` says whether what is expected follows from the law of a pixel or was measured, and by how many samples.
    Photons with ``variance_e2`` have ``compensation`` too, and the count ``compensated_short``.
    """
    theory, photons = observer.theory, observer.theory.light.photons
    if photons.detected:
        seen = theory.light.mean_e
    else:
        seen = photons.total
    return {
        "photons": {
            "min": float(seen.min()),
            "median": float(np.median(seen)),
            "max": float(seen.max()),
            "detected": photons.detected,
        },
        "sampled_pixels": int(observer.sums[0, 2]),
        "theory": theory.origin,
        "stages": [_line(number, theory, sums) for number, sums in enumerate(observer.sums)],
        "counts": dict(observer.counts),
        **_compensation(photons, observer),
        "outside_qe": outside_qe(photons, camera),
        "K_dn_per_e": gain_dn_per_e(camera),
    }


def _compensation(photons: Photons, observer: FrameObserver) -> dict[str, Any]:
    """Averages over the window.

    ``variance_e2``, ``compensated_e2``, ``left_e2`` : of the render, compensated, and left on top of the shot noise.
    ``left_over_shot`` : the last over the mean electrons of the pixels with a render's variance: by which share their
    variance is too large.
    """
    if photons.variance_e2 is None:
        return {}
    *sums, pixels = observer.compensated
    of_render, of_frame, shot_e = (float(x / pixels) for x in sums)
    left = of_render - of_frame
    return {
        "compensation": {
            "limit": LIMIT,
            "variance_e2": of_render,
            "compensated_e2": of_frame,
            "left_e2": left,
            "left_over_shot": left / shot_e if shot_e else 0.0,
        }
    }


def _line(number: int, theory: FrameTheory, sums: Float64Array) -> dict[str, Any]:
    """One stage of the report, in its own unit.

    sums : of the followed pixels of the frame: their signals, the squares of these less what is expected, their number.
    """
    stage = theory.stages[number]
    expected = theory.averages(stage)
    mean, mean_square = sums[:2] / sums[2]
    variance = max(mean_square - theory.variance_of_expected(number), 0.0)
    return {
        "name": stage.label,
        "domain": stage.domain,
        "unit": UNITS[stage.domain],
        "mean_expected": expected.mean,
        "sigma_expected": expected.sigma,
        "sigma_temporal_expected": float(np.sqrt(expected.temporal)),
        "sigma_spatial_expected": float(np.sqrt(expected.spatial)),
        "mean_error": expected.errors[0],
        "sigma_temporal_error": _error_of_root(expected.temporal, expected.errors[1]),
        "sigma_spatial_error": _error_of_root(expected.spatial, expected.errors[2]),
        "mean_frame": float(mean),
        "sigma_frame": float(np.sqrt(variance)),
    }


def _error_of_root(variance: float, error: float) -> float:
    """Standard error of the root of a variance whose standard error may be larger than itself."""
    if error:
        return float(error / (np.sqrt(variance) + np.sqrt(variance + error)))
    return 0.0
