"""A bench series: flat fields at several levels with the dark frames of their exposure times, as points with errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from .stack import Stack
from .temporal import Temporal, temporal

ROUNDING_DN2 = 1 / 12
"""Variance of rounding to whole codes, EMVA 1288 R4 2.2."""
COARSE_DN2 = 0.5
"""Variance [DN²] of a normal law below which rounding adds another variance than 1/12, by more than 0.1 % of it: by as
much as (4σ² + 1/π²) exp(-2π²σ²) where all pixels have one mean."""


@dataclass(frozen=True)
class Level:
    """One stack: mean [DN], variance [DN²], their standard errors, what is known of the light, what was found.

    light_error : standard error of the mean with light that drifts [DN].  freedom : of the variance.
    spread : standard deviation of the pixels' true means [DN], dark ones included.
    clipped : why the values show neither mean nor variance; nothing where they are inside of the range. The standard
    errors hold what a share of clipped values that is too small for that hides.
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


def level(stack: Stack) -> Level:
    """Of a stack whose pixels are alike."""
    found = temporal(stack)
    frames, pixels = found.frames, found.mean.size
    variance = float(found.variance.mean())
    spread = math.sqrt(max(float(found.mean.var()) - variance / frames, 0.0))
    clipping = stack.clipping
    hidden_dn = clipping.share * math.hypot(math.sqrt(variance), spread)
    noise = math.hypot(math.sqrt(variance / pixels / frames), hidden_dn)
    return Level(
        float(found.mean.mean()),
        noise,
        math.hypot(noise, found.drift_dn / math.sqrt(frames)),
        variance,
        math.hypot(found.variance_error, 2 * clipping.share * variance),
        float((frames - 1) * pixels),
        spread,
        stack.exposure_s,
        _photons(stack),
        tuple(filter(None, (_note(stack, found),))),
        f"{stack.source}: {clipping.note}" if clipping.clipped else "",
    )


def _photons(stack: Stack) -> float | None:
    if isinstance(stack.photons, np.ndarray):
        raise InputError(
            f"{stack.source}: photons are an array; a flat field has one number of photons per pixel."
        )
    return None if stack.photons is None else float(stack.photons)


def _note(stack: Stack, found: Temporal) -> str:
    return f"{stack.source}: {found.drift_note}" if found.drift_note else ""


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
        return np.array([getattr(one, name) for one in self.flats], dtype=np.float64)

    def of_darks(self, name: str) -> Float64Array:
        """The same of each flat's dark."""
        return np.array([getattr(one, name) for one in self.darks], dtype=np.float64)[
            self.dark_of
        ]

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
        """Of every flat."""
        return all(one.photons is not None for one in self.flats)

    @cached_property
    def light(self) -> Float64Array:
        """Photons per pixel where they are known, else the exposure time [s]."""
        return self.of_flats("photons" if self.photons_known else "exposure_s")

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Which flats are not clipped, nor their darks, (n,)."""
        return np.array(
            [
                not (flat.clipped or self.darks[k].clipped)
                for flat, k in zip(self.flats, self.dark_of, strict=True)
            ]
        )

    @cached_property
    def clipped_darks(self) -> str:
        """Why the dark frames show nothing, or nothing where they are inside of the range."""
        return next((self.darks[k].clipped for k in self.dark_of if self.darks[k].clipped), "")

    def why_clipped(self, levels: NDArray[np.bool_]) -> str:
        """Why the first of these levels that is clipped shows nothing, or nothing where none is."""
        clipped = (
            self.darks[k].clipped or flat.clipped
            for flat, k in zip(self.flats, self.dark_of, strict=True)
        )
        return next(
            (note for note, asked in zip(clipped, levels, strict=True) if asked and note), ""
        )

    def shared(self, errors: Float64Array) -> Float64Array:
        """Covariance (n, n) that flats have by the same dark, whose standard errors are given for each flat."""
        same = self.dark_of[:, None] == self.dark_of[None, :]
        return np.asarray(same * errors[:, None] * errors[None, :])

    @cached_property
    def dark_variance_error(self) -> Float64Array:
        """Of each flat's dark [DN²]; where its noise is rounded coarsely, by what rounding may add or not as well."""
        variance, error = self.of_darks("variance"), self.of_darks("variance_error")
        coarse = self.whole & (variance < COARSE_DN2 + ROUNDING_DN2)
        return np.asarray(np.hypot(error, np.where(coarse, ROUNDING_DN2, 0.0)))


def series(darks: Sequence[Stack], flats: Sequence[Stack], window: int | None = None) -> Series:
    """Reduce stacks to a series. A window takes that many rows and columns about the centre.

    Flats without a dark of their own exposure time take the one of the nearest, and a note says so.

    Raises InputError where stacks are missing, have one frame, a mosaic, or differ in size, gain or bits.
    """
    _check([*darks, *flats], len(darks), len(flats))
    if window is not None:
        darks, flats = ([centre(one, window) for one in stacks] for stacks in (darks, flats))
    levels = [level(one) for one in flats]
    dark_levels = tuple(level(one) for one in darks)
    known = all(one.photons is not None for one in levels)
    if not known and any(one.photons is not None for one in levels):
        raise InputError(
            "Some flat fields have photons and some have None; give all of them or none."
        )
    times = np.array([one.exposure_s for one in dark_levels])
    varied = len({one.exposure_s for one in levels}) > 1
    levels.sort(
        key=lambda one: (
            (one.photons or 0.0) if known else one.exposure_s if varied else one.mean
        )
    )
    dark_of = np.array([int(np.argmin(abs(times - one.exposure_s))) for one in levels])
    bits = next((one.bits for one in (*flats, *darks) if one.bits), None)
    whole = all(_whole(one) for one in (*darks, *flats))
    notes = [note for one in (*dark_levels, *levels) for note in one.notes]
    notes += [one.clipped for one in dark_levels if one.clipped] + _notes(
        darks, levels, times, whole
    )
    return Series(
        tuple(levels),
        dark_levels,
        dark_of,
        None if bits is None else 2**bits - 1,
        whole,
        tuple(notes),
    )


def _notes(
    darks: Sequence[Stack], flats: Sequence[Level], times: Float64Array, whole: bool
) -> list[str]:
    found = []
    far = [
        one.exposure_s
        for one in flats
        if not np.isclose(times, one.exposure_s, rtol=1e-6).any()
    ]
    if far:
        found.append(
            f"no dark frames at {far[0]:g} s ({len(far)} of {len(flats)} levels): those nearest were taken"
        )
    found += coarse_codes(darks)
    if not whole:
        found.append("the frames have fractions of codes: no rounding was subtracted")
    return found


def coarse_codes(darks: Sequence[Stack]) -> list[str]:
    """A note where the codes of the first dark frames are multiples of more than 1, as of 12 bits shifted to 16."""
    codes = np.unique(np.concatenate([one.frames[0].ravel() for one in darks]))
    if codes.dtype.kind == "f" and (codes != np.round(codes)).any():
        return []
    step = int(np.gcd.reduce((codes - codes[0]).astype(np.int64)))
    if step < 2 or len(codes) < 3:
        return []
    return [
        f"dark codes differ by multiples of {step}: divide the frames by {step}, or rounding counts as noise"
    ]


def centre(stack: Stack, side: int) -> Stack:
    """The rows and columns about the centre, at most as many as there are."""
    rows, columns = ((max(0, (size - side) // 2), min(size, side)) for size in stack.shape)
    return stack.window(slice(rows[0], sum(rows)), slice(columns[0], sum(columns)))


def _whole(stack: Stack) -> bool:
    return stack.frames.dtype.kind in "ui" or bool(
        (stack.frames == np.round(stack.frames)).all()
    )


def _check(stacks: Sequence[Stack], darks: int, flats: int) -> None:
    if not darks or not flats:
        raise InputError(
            f"{darks} dark stacks and {flats} flat stacks; pass at least one of each."
        )
    for one in stacks:
        if one.bits is not None and one.frames.max() > 2**one.bits - 1:
            raise InputError(
                f"{one.source}: code {one.frames.max():g} is beyond {one.bits} bits; pass the bits of the file."
            )
    for name in ("shape", "gain", "bits"):
        found = {getattr(one, name): one.source for one in stacks}
        if len(found) > 1:
            given = ", ".join(
                f"{value!r} ({source})" for value, source in list(found.items())[:3]
            )
            raise InputError(
                f"The stacks differ in {name}: {given}; measure each {name} apart."
            )
