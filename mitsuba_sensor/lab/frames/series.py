"""A series of flat fields at several exposure levels, with the dark frames of their exposure times."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from .clipping import SAMPLED_VALUES
from .stack import Stack, merged, rounding_error_dn2
from .temporal import flicker_dn, flicker_note, temporal, temporal_within_rows

Report = Callable[[int, int], object]
"""Called with the number of stacks that are measured and the number of all stacks."""


@dataclass(frozen=True)
class Level:
    """One stack as a point: mean [DN] and variance [DN²] with standard errors, light and notes.

    light_error : standard error of the mean, including drifting light [DN].  freedom : degrees of freedom of the
    variance.  spread : standard deviation of the pixels' true means, including the dark pattern [DN].
    clipped : reason why clipped values show neither mean nor variance, or an empty text. The standard errors include
    the effect of smaller fractions of clipped values.
    coarse : reason why rounding hides the temporal noise, or an empty text.  source : file or folder.
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
    """Return mean and variance of a uniformly lit stack.  lit : True to remove rows that flicker together."""
    if isinstance(stack.photons, np.ndarray):
        raise InputError(
            f"{stack.source}: photons is an array of shape {stack.photons.shape}; pass one number for a flat field."
        )
    shared_dn = flicker_dn(stack) if lit and len(stack) > 1 else 0.0
    flicker = flicker_note(shared_dn, "it is removed from the variance, with the row noise")
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
        coarse=stack.coarse_at(variance),
        source=stack.source,
    )


@dataclass(frozen=True, eq=False)
class Series:
    """Flat fields in ascending order of light, each with the dark level of its exposure time.

    flats, darks : levels.  dark_of : index of the dark level of each flat field.  top_code : full-scale code, or None.
    whole : True if all values are whole codes, so the variance includes rounding.  notes : remarks on the frames.
    """

    flats: tuple[Level, ...]
    darks: tuple[Level, ...]
    dark_of: NDArray[np.intp]
    top_code: int | None
    whole: bool
    notes: tuple[str, ...]

    def of_flats(self, name: str) -> Float64Array:
        """Return a field of all flat fields, NaN for None."""
        return np.array([getattr(flat, name) for flat in self.flats], dtype=np.float64)

    def of_darks(self, name: str) -> Float64Array:
        """Return a field of the dark level of each flat field."""
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
        """Return True if the photons of every flat field are known."""
        return all(flat.photons is not None for flat in self.flats)

    @cached_property
    def light(self) -> Float64Array:
        """Photons per pixel or, if unknown, exposure time [s]."""
        return self.of_flats("photons" if self.photons_known else "exposure_s")

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Mask of the flat fields that are not clipped and whose dark frames are not, shape (n,)."""
        return np.array([not note for note in self._clipped_notes])

    @cached_property
    def clipped_darks(self) -> str:
        """Reason why clipped dark frames show nothing, or an empty text."""
        return next(filter(None, (self.darks[k].clipped for k in self.dark_of)), "")

    @cached_property
    def _clipped_notes(self) -> list[str]:
        """Reasons why each flat field or its dark frames are clipped, or empty texts."""
        darks = [self.darks[k] for k in self.dark_of]
        return [
            dark.clipped or flat.clipped for flat, dark in zip(self.flats, darks, strict=True)
        ]

    def why_clipped(self, levels: NDArray[np.bool_]) -> str:
        """Return why the first clipped one of these levels shows nothing, or an empty text."""
        pairs = zip(self._clipped_notes, levels, strict=True)
        return next((note for note, chosen in pairs if chosen and note), "")

    def shared(self, errors: Float64Array) -> Float64Array:
        """Return the covariance (n, n) of flat fields that share dark frames with these standard errors."""
        same = self.dark_of[:, None] == self.dark_of[None, :]
        return np.asarray(same * errors[:, None] * errors[None, :])

    @cached_property
    def dark_variance_error(self) -> Float64Array:
        """Standard error of the dark variance of each flat field, including rounding [DN²]."""
        rounding = self._rounding_error(self.darks)[self.dark_of]
        return np.asarray(np.hypot(self.of_darks("variance_error"), rounding))

    @cached_property
    def flat_rounding_error(self) -> Float64Array:
        """Standard error that rounding adds to the variance of each flat field [DN²]."""
        return self._rounding_error(self.flats)

    def _rounding_error(self, levels: Sequence[Level]) -> Float64Array:
        """Return how far the variance of rounding may differ from 1/12 DN² at each of these levels [DN²]."""
        return np.array(
            [rounding_error_dn2(level.variance) if self.whole else 0.0 for level in levels]
        )

    @cached_property
    def coarse(self) -> NDArray[np.bool_]:
        """Mask of the flat fields whose temporal noise is hidden by rounding, shape (n,)."""
        return np.array([bool(flat.coarse) for flat in self.flats])


def series(
    darks: Sequence[Stack], flats: Sequence[Stack], report: Report | None = None
) -> Series:
    """Reduce stacks to a series.

    report : called after each stack with the number of measured and of all stacks.
    A flat field without dark frames of its exposure time uses those of the nearest time, and a note reports it.

    Raises InputError if stacks are missing, have one frame or a mosaic, or differ in size, gain or bits.
    """
    if not darks or not flats:
        raise InputError(
            f"series has {len(darks)} dark stacks and {len(flats)} flat stacks; pass at least one of each."
        )
    _check_stacks([*darks, *flats])
    measured: list[Level] = []
    for number, stack in enumerate((*darks, *flats)):
        measured.append(measure_level(stack, lit=number >= len(darks)))
        if report is not None:
            report(len(measured), len(darks) + len(flats))
    dark_levels = tuple(measured[: len(darks)])
    levels = _sort_levels(measured[len(darks) :])
    times = np.array([dark.exposure_s for dark in dark_levels])
    dark_of = np.array([int(np.argmin(abs(times - flat.exposure_s))) for flat in levels])
    notes = [note for level in (*dark_levels, *levels) for note in level.notes]
    notes += [dark.clipped for dark in dark_levels if dark.clipped]
    notes += _note_far_darks(levels, times)
    notes += coarse_codes(darks)
    whole = all(stack.whole_codes for stack in (*darks, *flats))
    if not whole:
        notes.append("the frames have fractions of codes, so no rounding is subtracted")
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
    """Sort levels by photons or, if unknown, by exposure time or, if equal, by mean.

    Raises InputError if photons are known for only some levels.
    """
    counts = [level.photons for level in levels]
    if None not in counts:
        return sorted(levels, key=lambda level: level.photons or 0.0)
    if any(count is not None for count in counts):
        raise InputError(
            f"photons is None for {counts.count(None)} of {len(counts)} flat fields; pass all of them or none."
        )
    if len({level.exposure_s for level in levels}) > 1:
        return sorted(levels, key=lambda level: level.exposure_s)
    return sorted(levels, key=lambda level: level.mean)


def _note_far_darks(flats: Sequence[Level], times: Float64Array) -> list[str]:
    """Return a note if flat fields have no dark frames of their exposure time."""
    of_flats = [flat.exposure_s for flat in flats]
    far_s = [time for time in of_flats if not np.isclose(times, time, rtol=1e-6).any()]
    if not far_s:
        return []
    levels = f"{len(far_s)} of {len(flats)} levels"
    return [f"no dark frames at {far_s[0]:g} s ({levels}): those of the nearest time are used"]


def coarse_codes(darks: Sequence[Stack]) -> list[str]:
    """Return a note if the dark codes are multiples of more than 1, e.g. 12 bits shifted to 16."""
    codes = np.unique(
        np.concatenate([stack.frames[0].ravel()[:SAMPLED_VALUES] for stack in darks])
    )
    if codes.dtype.kind == "f" and (codes != np.round(codes)).any():
        return []
    step = int(np.gcd.reduce((codes - codes[0]).astype(np.int64)))
    if step < 2 or len(codes) < 3:
        return []
    return [
        f"dark codes are multiples of {step}, so rounding is taken for noise; divide the frames by {step}"
    ]


def _check_stacks(stacks: Sequence[Stack]) -> None:
    """Raise InputError for codes above the bits of the ADC, and for stacks that differ in size, gain or bits."""
    for stack in stacks:
        largest = stack.clipping.largest
        if stack.bits is not None and largest > 2**stack.bits - 1:
            raise InputError(
                f"{stack.source}: code {largest:g} is above {stack.bits} bits; pass the bits of the file."
            )
    for name in ("shape", "gain", "bits"):
        sources = {getattr(stack, name): stack.source for stack in stacks}
        if len(sources) > 1:
            first_three = list(sources.items())[:3]
            values = ", ".join(f"{value!r} ({source})" for value, source in first_three)
            raise InputError(
                f"the stacks differ in {name}: {values}; measure each {name} individually."
            )
