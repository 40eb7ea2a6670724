"""A bench series: flat fields at several levels with the dark frames of their exposure times, as points with errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from .clipping import MOST_VALUES
from .stack import Stack, coarse_note, merged, rounding_error_dn2
from .temporal import flicker_note, temporal, temporal_within_rows

Report = Callable[[int, int], object]
"""Told how many of all stacks are measured."""


@dataclass(frozen=True)
class Level:
    """One stack: mean [DN], variance [DN²], their standard errors, what is known of the light, what was found.

    light_error : standard error of the mean with light that drifts [DN].  freedom : of the variance.
    spread : standard deviation of the pixels' true means [DN], dark ones included.
    clipped : why the values show neither mean nor variance; nothing where they are inside of the range. The standard
    errors hold what a share of clipped values that is too small for that hides.
    coarse : why rounding hides the temporal noise, or nothing.
    source : the file or folder.
    """

    mean: float
    mean_error: float
    light_error: float
    variance: float
    variance_error: float
    freedom: float
    spread: float
    exposure_s: float
    photons: float | None
    notes: tuple[str, ...]
    clipped: str = ""
    coarse: str = ""
    source: str = ""


def measure_level(stack: Stack, lit: bool = False) -> Level:
    """Mean and variance of a stack whose pixels are alike, with their errors.

    lit : whether rows that fluctuate together are taken out, for they do so by the light.
    """
    if isinstance(stack.photons, np.ndarray):
        raise InputError(
            f"{stack.source}: photons are an array; a flat field has one number of photons per pixel."
        )
    flicker = (
        flicker_note(stack, "taken out of the variance, with the row noise") if lit else ""
    )
    statistics = temporal_within_rows(stack) if flicker else temporal(stack)
    frames, pixels = statistics.frames, statistics.pixels
    variance, spread = statistics.variance, statistics.spread_dn
    clipping = stack.clipping
    hidden_dn = clipping.share * math.hypot(math.sqrt(variance), spread)
    mean_error = math.hypot(math.sqrt(variance / pixels / frames), hidden_dn)
    notes = filter(None, (flicker, statistics.drift_note))
    stack.release()
    return Level(
        mean=statistics.mean,
        mean_error=mean_error,
        light_error=math.hypot(mean_error, statistics.drift_dn / math.sqrt(frames)),
        variance=variance,
        variance_error=math.hypot(statistics.variance_error, 2 * clipping.share * variance),
        freedom=float((frames - 1) * pixels),
        spread=spread,
        exposure_s=stack.exposure_s,
        photons=stack.photons,
        notes=tuple(f"{stack.source}: {note}" for note in notes),
        clipped=f"{stack.source}: {clipping.note}" if clipping.clipped else "",
        coarse=coarse_note(variance) if stack.whole_codes else "",
        source=stack.source,
    )


@dataclass(frozen=True, eq=False)
class Series:
    """Flat fields in ascending order of light, each with the dark level of its exposure time.

    flats, darks : levels.  dark_of : for each flat the index of its dark.  top_code : of the ADC, or None.
    whole : whether all values are whole codes, so that rounding is part of the variance.  notes : what was found.
    """

    flats: tuple[Level, ...]
    darks: tuple[Level, ...]
    dark_of: NDArray[np.intp]
    top_code: int | None
    whole: bool
    notes: tuple[str, ...]

    def of_flats(self, name: str) -> Float64Array:
        """A field of all flats, NaN for None."""
        return np.array([getattr(flat, name) for flat in self.flats], dtype=np.float64)

    def of_darks(self, name: str) -> Float64Array:
        """A field of the dark level that belongs to each flat."""
        values = np.array([getattr(dark, name) for dark in self.darks], dtype=np.float64)
        return values[self.dark_of]

    @cached_property
    def signal(self) -> Float64Array:
        """Mean minus dark mean [DN]."""
        return self.of_flats("mean") - self.of_darks("mean")

    @cached_property
    def excess(self) -> Float64Array:
        """Variance minus dark variance [DN²]."""
        return self.of_flats("variance") - self.of_darks("variance")

    @property
    def photons_known(self) -> bool:
        """Whether the photons of every flat are known."""
        return all(flat.photons is not None for flat in self.flats)

    @cached_property
    def light(self) -> Float64Array:
        """Photons per pixel where they are known, else the exposure time [s]."""
        return self.of_flats("photons" if self.photons_known else "exposure_s")

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Which flats are not clipped, nor their darks, (n,)."""
        return np.array([not note for note in self._clipped_notes])

    @cached_property
    def clipped_darks(self) -> str:
        """Why the dark frames show nothing, or nothing where they are inside of the range."""
        return next(filter(None, (self.darks[k].clipped for k in self.dark_of)), "")

    @cached_property
    def _clipped_notes(self) -> list[str]:
        """For each flat why it or its dark shows nothing, or nothing."""
        darks = [self.darks[k] for k in self.dark_of]
        return [
            dark.clipped or flat.clipped for flat, dark in zip(self.flats, darks, strict=True)
        ]

    def why_clipped(self, levels: NDArray[np.bool_]) -> str:
        """Why the first of these levels that is clipped shows nothing, or nothing where none is."""
        asked = zip(self._clipped_notes, levels, strict=True)
        return next((note for note, is_asked in asked if is_asked and note), "")

    def shared(self, errors: Float64Array) -> Float64Array:
        """Covariance (n, n) that flats have by the same dark, whose standard errors are given for each flat."""
        same = self.dark_of[:, None] == self.dark_of[None, :]
        return np.asarray(same * errors[:, None] * errors[None, :])

    @cached_property
    def dark_variance_error(self) -> Float64Array:
        """Standard error of the variance of each flat's dark, with what rounding may add to it [DN²]."""
        rounding = [
            rounding_error_dn2(dark.variance) if self.whole else 0.0 for dark in self.darks
        ]
        return np.asarray(
            np.hypot(self.of_darks("variance_error"), np.array(rounding)[self.dark_of])
        )

    @cached_property
    def coarse(self) -> NDArray[np.bool_]:
        """Which flats have temporal noise that rounding hides, (n,)."""
        return np.array([bool(flat.coarse) for flat in self.flats])


def series(
    darks: Sequence[Stack],
    flats: Sequence[Stack],
    window: int | None = None,
    report: Report | None = None,
) -> Series:
    """Reduce stacks to a series. A window takes that many rows and columns about the centre.

    report : called with the stacks that are measured, and all of them, after each.

    Flats without a dark of their own exposure time take the one of the nearest, and a note says so.

    Raises InputError where stacks are missing, have one frame, a mosaic, or differ in size, gain or bits.
    """
    if not darks or not flats:
        raise InputError(
            f"{len(darks)} dark stacks and {len(flats)} flat stacks; pass at least one of each."
        )
    _check_stacks([*darks, *flats])
    if window is not None:
        darks, flats = ([stack.centre(window) for stack in some] for some in (darks, flats))
    of_stacks: list[Level] = []
    for number, stack in enumerate((*darks, *flats)):
        of_stacks.append(measure_level(stack, lit=number >= len(darks)))
        if report is not None:
            report(len(of_stacks), len(darks) + len(flats))
    dark_levels = tuple(of_stacks[: len(darks)])
    levels = _sort_levels(of_stacks[len(darks) :])
    times = np.array([dark.exposure_s for dark in dark_levels])
    dark_of = np.array([int(np.argmin(abs(times - flat.exposure_s))) for flat in levels])
    notes = [note for level in (*dark_levels, *levels) for note in level.notes]
    notes += [dark.clipped for dark in dark_levels if dark.clipped]
    notes += _note_far_darks(levels, times)
    notes += coarse_codes(darks)
    whole = all(stack.whole_codes for stack in (*darks, *flats))
    if not whole:
        notes.append("the frames have fractions of codes: no rounding was subtracted")
    bits = flats[0].bits
    return Series(
        flats=tuple(levels),
        darks=dark_levels,
        dark_of=dark_of,
        top_code=None if bits is None else 2**bits - 1,
        whole=whole,
        notes=tuple(merged(notes)),
    )


def _sort_levels(levels: list[Level]) -> list[Level]:
    """Levels by photons where these are known, else by exposure time where it varies, else by mean.

    Raises InputError where the photons of some levels are known and those of others are not.
    """
    known = [level.photons is not None for level in levels]
    if all(known):
        return sorted(levels, key=lambda level: level.photons or 0.0)
    if any(known):
        raise InputError(
            "Some flat fields have photons and some have None; give all of them or none."
        )
    if len({level.exposure_s for level in levels}) > 1:
        return sorted(levels, key=lambda level: level.exposure_s)
    return sorted(levels, key=lambda level: level.mean)


def _note_far_darks(flats: Sequence[Level], times: Float64Array) -> list[str]:
    """A note where flats have no dark frames of their exposure time."""
    of_flats = [flat.exposure_s for flat in flats]
    far_s = [time for time in of_flats if not np.isclose(times, time, rtol=1e-6).any()]
    if not far_s:
        return []
    levels = f"{len(far_s)} of {len(flats)} levels"
    return [f"no dark frames at {far_s[0]:g} s ({levels}): those nearest were taken"]


def coarse_codes(darks: Sequence[Stack]) -> list[str]:
    """A note where the codes of the first dark frames are multiples of more than 1, as of 12 bits shifted to 16."""
    codes = np.unique(
        np.concatenate([stack.frames[0].ravel()[:MOST_VALUES] for stack in darks])
    )
    if codes.dtype.kind == "f" and (codes != np.round(codes)).any():
        return []
    step = int(np.gcd.reduce((codes - codes[0]).astype(np.int64)))
    if step < 2 or len(codes) < 3:
        return []
    return [
        f"dark codes differ by multiples of {step}: divide the frames by {step}, or rounding counts as noise"
    ]


def _check_stacks(stacks: Sequence[Stack]) -> None:
    """Raises InputError for codes beyond the bits of the ADC, and for stacks that differ in size, gain or bits."""
    for stack in stacks:
        largest = stack.clipping.largest
        if stack.bits is not None and largest > 2**stack.bits - 1:
            raise InputError(
                f"{stack.source}: code {largest:g} is beyond {stack.bits} bits; pass the bits of the file."
            )
    for name in ("shape", "gain", "bits"):
        sources = {getattr(stack, name): stack.source for stack in stacks}
        if len(sources) > 1:
            first_three = list(sources.items())[:3]
            values = ", ".join(f"{value!r} ({source})" for value, source in first_three)
            raise InputError(
                f"The stacks differ in {name}: {values}; measure each {name} apart."
            )
