"""How often intervals of PRNU hold it in coarse cameras that a few lines of NumPy make, without this package's sensor.

    python benchmarks/coarse_nonuniformity.py [--cameras 1500] [--first 0]

The cameras are those of the kind "coarse" of lab_coverage.py, of other seeds: 48 × 56 pixels, 10 bits, 0.1 to 0.7 DN of
temporal dark noise; 16 dark frames and 16 of a flat field at half saturation. Printed is how many have the figure, the
share of the intervals that hold it, and how many lie below it and above it.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter

import numpy as np

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.nonuniformity import nonuniformity

ROWS, COLUMNS, FRAMES = 48, 56, 16
LARGEST_DN = 1023
FIGURES = ("prnu", "prnu_col", "prnu_pixel")


def take(number: int) -> tuple[Stack, Stack, dict[str, float]]:
    """Dark frames and a flat field of a random camera, and its PRNU [%]."""
    rng = np.random.default_rng([77, number])

    def between(low: float, high: float) -> float:
        return math.exp(rng.uniform(math.log(low), math.log(high)))

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape)

    well_e, efficiency, noise_dn = between(5e3, 4e4), rng.uniform(0.3, 0.9), between(0.1, 0.7)
    gain = 0.75 * (LARGEST_DN + 1) / well_e * between(0.8, 1.2)
    lines = between(0.1, 1.0), between(0.1, 1.0)
    row_e, column_e, read_e = noise_dn / gain / math.hypot(1, *lines) * np.array([*lines, 1.0])
    offset_e = between(0.1, 3.0) / gain
    dsnu_e = [offset_e * between(0.2, 1.0) for _ in range(3)]
    prnu, prnu_col = between(0.003, 0.02), between(0.001, 0.01)
    spread_dn = gain * math.hypot(row_e, column_e, read_e, *dsnu_e)
    black_dn = 10 + 6 * spread_dn + rng.uniform()
    half_e = 0.5 * min(well_e, (LARGEST_DN - black_dn) / gain)
    of_pixels = 1 + prnu * normal(ROWS, COLUMNS)
    of_columns = 1 + prnu_col * normal(COLUMNS)
    offsets_e = dsnu_e[0] * normal(ROWS, 1) + dsnu_e[1] * normal(COLUMNS)
    offsets_e = offsets_e + dsnu_e[2] * normal(ROWS, COLUMNS)

    def frames(mean_e: float) -> Stack:
        electrons = rng.poisson(mean_e * of_pixels, (FRAMES, ROWS, COLUMNS))
        signal_e = np.minimum(electrons, well_e) * of_columns + offsets_e
        signal_e = signal_e + row_e * normal(FRAMES, ROWS, 1)
        signal_e = signal_e + column_e * normal(FRAMES, 1, COLUMNS)
        signal_e = signal_e + read_e * normal(FRAMES, ROWS, COLUMNS)
        codes = np.clip(np.rint(black_dn + gain * signal_e), 0, LARGEST_DN).astype(np.uint16)
        return Stack(codes, 0.001, mean_e / efficiency, bits=10)

    true = 100 * math.hypot(prnu, prnu_col), 100 * prnu_col, 100 * prnu
    return frames(0.0), frames(half_e), dict(zip(FIGURES, true, strict=True))


def main() -> None:
    """Print a line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=1500)
    parser.add_argument("--first", type=int, default=0, help="number of the first camera")
    asked = parser.parse_args()
    counts: dict[str, Counter[str]] = {name: Counter() for name in FIGURES}
    for number in range(asked.first, asked.first + asked.cameras):
        dark, light, true = take(number)
        measured = nonuniformity(dark, light)
        for name, percent in true.items():
            figure = getattr(measured, name)
            if math.isfinite(figure.value):
                where = "held"
                if figure.high < percent:
                    where = "below"
                elif figure.low > percent:
                    where = "above"
                counts[name][where] += 1
    for name, found in counts.items():
        share = 100 * found["held"] / max(found.total(), 1)
        sides = f"{found['below']} below, {found['above']} above"
        print(f"{name:12}{found.total():6} cameras  {share:.1f} % held  {sides}")


if __name__ == "__main__":
    main()
