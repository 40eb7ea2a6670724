"""Fig. 5 and 6, Table 2: PRNU of the averaged light minus the averaged darkness, spectrograms, non-whiteness F."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from mitsuba_sensor.lab.measure.nonuniformity import Nonuniformity, nonuniformity
from mitsuba_sensor.lab.measure.spectrogram import Spectrogram, spectrograms
from mitsuba_sensor.pages.page import Drawing, Section, Table, table

from .camera import (
    COLUMN_DN,
    DARK_E_PER_S,
    EFFICIENCY,
    FRAME_S,
    FULL_PHOTONS,
    FULL_WELL_E,
    GAIN,
    NO_COLUMNS,
    PRNU,
    READ_E,
    Size,
    stack_of,
    table1,
)
from .check import Check, all_hold, c4, check_table, within_interval
from .published import (
    PRNU_MEAN_DN,
    PRNU_PERCENT,
    PRNU_SIGMA_DN,
    PRNU_SPECIFIED_PERCENT,
    TABLE_2,
    NonWhiteness,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROUNDING_E2 = 1 / 12 / GAIN**2
DARK_CV = 0.01  # Table 1, dark current FPN factor
TICKS_DN = 2, 5, 10, 20, 30
QUANTILES, BISECTIONS = 200, 40  # of the median of a spectrum
COLUMNS, WITHOUT = "with Table 1's column offsets", "without column offsets"
CAMERAS = {COLUMNS: {}, WITHOUT: NO_COLUMNS}


class MeasuredPrnu(NamedTuple):
    """The instrument's result, and the mean of the pixels' σ over the root of their mean variance."""

    result: Nonuniformity
    c4: float


def measure_prnu(size: Size) -> MeasuredPrnu:
    """Flat fields of the published mean and as many dark frames of the same time."""
    dark = stack_of(table1(), FRAME_S, 0.0, size, frames=size.frames, seed=401)
    light = stack_of(
        table1(), FRAME_S, PRNU_MEAN_DN / GAIN / EFFICIENCY, size, frames=size.frames, seed=402
    )
    ratio = float(np.sqrt(light.variance).mean() / math.sqrt(light.variance.mean()))
    return MeasuredPrnu(nonuniformity(dark, light), ratio)


def prnu_section(found: MeasuredPrnu, size: Size) -> Section:
    """Density with its normal distribution, and both factors beside the published ones."""
    raw, corrected, frames = found.result.paper_raw, found.result.paper, size.frames
    light, dark = PRNU_MEAN_DN / GAIN, DARK_E_PER_S * FRAME_S
    rest = (light + 2 * dark + 2 * READ_E**2 + 2 * ROUNDING_E2) / frames
    error = 0.5 / math.sqrt(2 * frames) / size.window
    checks = [
        within_interval("PRNU raw", 100 * math.hypot(PRNU, math.sqrt(rest) / light), raw),
        within_interval("PRNU without temporal noise", 100 * PRNU, corrected),
        Check(
            f"mean σ of {frames} frames over the root of the mean variance: c4",
            "1",
            c4(frames),
            found.c4,
            10 * error,
        ),
    ]
    finding = (
        f"PRNU: {raw.value:.4f} % raw and {corrected.value:.4f} % ({corrected.low:.4f} to {corrected.high:.4f}) "
        f"without what {frames} frames leave of temporal noise; published {PRNU_PERCENT} % (hardware) and "
        f"{PRNU_SPECIFIED_PERCENT:.2f} % (specified)."
    )
    mean, sigma = float(found.result.difference.mean()), float(found.result.difference.std())
    rows: list[tuple[object, ...]] = [
        ("mean µ", "DN", PRNU_MEAN_DN, None, mean),
        ("standard deviation σ", "DN", PRNU_SIGMA_DN, None, sigma),
        ("PRNU = σ/µ", "%", PRNU_PERCENT, checks[0].expected, raw.value),
        (
            "PRNU without temporal noise",
            "%",
            PRNU_SPECIFIED_PERCENT,
            checks[1].expected,
            corrected.value,
        ),
    ]
    note = (
        f"{frames} flat fields minus {frames} dark frames, averaged; {size.window} × {size.window} pixels of the "
        "centre."
    )
    values = table(
        "PRNU",
        "what | unit | published | closed form | measured",
        (("", row) for row in rows),
        note,
    )
    picture = Drawing(
        "Fig. 5: density of the PRNU, the mean subtracted", found.result.plot, note
    )
    return Section(
        (finding,),
        all_hold(checks),
        (picture, values, check_table("PRNU: what closed forms say", checks)),
    )


class Whiteness(NamedTuple):
    """F of every chip, and the horizontal spectrogram of the first one."""

    values: tuple[float, ...]
    first: Spectrogram

    @property
    def mean(self) -> float:
        """[1]."""
        return float(np.mean(self.values))

    @property
    def sigma(self) -> float:
        """Of one measurement [1]."""
        return float(np.std(self.values, ddof=1))


def measure_f(row: NonWhiteness, camera: str, size: Size) -> Whiteness:
    """One frame of each chip, so that patterns differ too, as in the authors' code."""
    found = []
    for chip in range(size.chips):
        options = {"serial": chip + 1, "seed": 1000 + chip}
        stack = stack_of(
            table1(**CAMERAS[camera]), row.time_s, row.share * FULL_PHOTONS, size, **options
        )
        found.append(spectrograms(stack)[0])
    return Whiteness(tuple(one.non_whiteness.value for one in found), found[0])


def expected_f(row: NonWhiteness, camera: str, size: Size) -> float:
    """1/median of S²/σ²; 1/ln 2 for columns alone, M/median of a gamma variable for white noise of M lines."""
    light, dark = row.share * FULL_WELL_E, DARK_E_PER_S * row.time_s
    white = light + dark + READ_E**2 + ROUNDING_E2 + (PRNU * light) ** 2 + (DARK_CV * dark) ** 2
    share = white / (white + (COLUMN_DN / GAIN) ** 2) if camera == COLUMNS else 1.0
    return 1 / median_power(share, size.window)


def median_power(white: float, lines: int) -> float:
    """Median of S² over frequencies, of noise whose variance is 1 and of which this share is white.

    Columns give a, exponential over frequencies with mean 1 − w; white noise of M lines makes 2M/w·S² a noncentral χ²
    variable with 2M degrees of freedom and noncentrality 2M/w·a.
    """
    columns = -(1 - white) * np.log1p(-(np.arange(QUANTILES) + 0.5) / QUANTILES)
    low, high, scale = 0.0, 2.0, 2 * lines / white
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        below = float(scipy.special.chndtr(scale * middle, 2 * lines, scale * columns).mean())
        low, high = (middle, high) if below < 0.5 else (low, middle)
    return high


def f_section(found: dict[tuple[NonWhiteness, str], Whiteness], size: Size) -> Section:
    """Spectrograms, Table 2 with ours beside, and what must hold."""
    checks = []
    for (row, camera), one in found.items():
        # the mean of 1/median exceeds the inverse of the median by the median's relative variance
        allowed = 5 * one.sigma / math.sqrt(len(one.values)) + 2 * one.sigma**2 + 2e-4
        name = f"F, {row.name}, {row.time_s:g} s, {camera}"
        checks.append(Check(name, "1", expected_f(row, camera, size), one.mean, allowed))
    values = {
        camera: [one.mean for (_, other), one in found.items() if other == camera]
        for camera in CAMERAS
    }
    darkest = [found[row, COLUMNS].mean for row in TABLE_2 if not row.share]
    finding = (
        f"Non-whiteness F without column offsets: {min(values[WITHOUT]):.4f} to {max(values[WITHOUT]):.4f} ± "
        f"{max(one.sigma for (_, c), one in found.items() if c == WITHOUT):.4f}; published 0.999 and 0.998 ± 0.002. "
        f"With Table 1's column offsets F in darkness is {min(darkest):.3f} to {max(darkest):.3f}, and cannot be "
        "0.999."
    )
    pictures = tuple(
        Drawing(
            f"Fig. 6b: spectrograms {camera}",
            partial(_draw, found, camera),
            "Along the rows, of one frame.",
        )
        for camera in (WITHOUT, COLUMNS)
    )
    return Section(
        (finding,),
        all_hold(checks),
        (
            *pictures,
            _table_2(found, size),
            check_table("Table 2: what closed forms say", checks),
        ),
    )


def _table_2(found: dict[tuple[NonWhiteness, str], Whiteness], size: Size) -> Table:
    rows = []
    for row in TABLE_2:
        ours = [
            number
            for camera in (WITHOUT, COLUMNS)
            for number in (found[row, camera].mean, found[row, camera].sigma)
        ]
        rows.append(("", (row.name, row.time_s, *row.hardware, *row.simulated, *ours)))
    return table(
        "Table 2: non-whiteness F",
        "light | time [s] | published, hardware [1] | ± [1] | published, simulated [1] | ± [1] | ours without "
        "column offsets [1] | ± [1] | ours with Table 1's column offsets [1] | ± [1]",
        rows,  # type: ignore[arg-type]
        f"Mean and standard deviation over {size.chips} chips, one frame of {size.window} × {size.window} pixels "
        "each. In darkness column offsets of 4.1 DN stand beside 1.4 to 1.8 DN of other noise.",
    )


def _draw(found: dict[tuple[NonWhiteness, str], Whiteness], camera: str, axes: Axes) -> None:
    for row in TABLE_2:
        if row.time_s == FRAME_S or row.share:
            one = found[row, camera].first
            axes.plot(
                one.frequency, one.amplitude, lw=0.8, label=f"{row.name}, {row.time_s:g} s"
            )
    axes.set(xlabel="spatial frequency [cycles/pixel]", ylabel="amplitude S [DN]", yscale="log")
    axes.set_yticks(TICKS_DN, map(str, TICKS_DN))
    axes.set_yticks((), minor=True)
