"""Measure the coverage of the 95 % intervals of the laboratory for random cameras, by kind of camera.

    python benchmarks/lab_coverage.py [--cameras 400] [--first 0] [--kinds linear curved …] [--json]

Every camera is another chip of 48 × 56 pixels: 16 dark frames, 13 flat fields of 2 frames, one of 16 at half
saturation.

linear : 1 to 6 DN of read noise.
curved : the same, with a source follower whose gain at full well is 0.96 to 1.04 times that at zero.
few : the same, with 0.7 to 1.3 times the gain at full well, and 5 to 10 flat fields.
coarse : 0.1 to 0.7 DN of temporal dark noise.
lines : the same as linear, with row and column noise and fixed rows and columns of up to the read noise.
hot : the same as linear; 0.1 % of the pixels have offsets of 500 to 3500 DN of 4095.
dark : the same as linear, with 20 to 2000 e-/s of dark current and dark frames of three exposures up to 1 s.

A figure that is not printed is not counted as wrong: "printed" is the share of the cameras in which it has a value.
"""

from __future__ import annotations

import argparse
import json
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.measurement import measure_bench
from mitsuba_sensor.lab.quantity import Quantity
from mitsuba_sensor.stages.gains import gain_dn_per_e

KINDS = ("linear", "curved", "coarse", "lines", "hot", "few", "dark")
EXPOSURE = ms.Exposure(0.001)
LEVELS = (*np.linspace(0.03, 0.93, 11), 1.1, 1.3)
"""Of the light that fills the range."""
HALF = 0.5
SHAPE = (48, 56)
HOT_SHARE = 1e-3


@dataclass(frozen=True)
class Sample:
    """A camera of one kind and its true figures, in the units of the laboratory."""

    kind: str
    number: int
    camera: ms.Camera
    true: dict[str, float]

    @property
    def photons_at_end(self) -> float:
        """Photons per pixel at the full well or the full-scale code."""
        camera, gain = self.camera, gain_dn_per_e(self.camera)
        codes_e = ((1 << camera.adc.bits) - 1 - camera.adc.black_level_dn) / gain
        return min(camera.pixel.full_well_e, codes_e) / self.true["η"]

    def stack(
        self, photons: float, frames: int, seed: int, exposure: ms.Exposure = EXPOSURE
    ) -> Stack:
        """Return frames of uniform illumination."""
        taken = ms.expose(
            np.full(SHAPE, photons),
            self.camera,
            exposure,
            frames=frames,
            serial=10_000 * KINDS.index(self.kind) + self.number,
            seed=seed,
        )
        codes = taken.digital.astype(np.int64)
        if self.kind == "hot":
            rng = np.random.default_rng([self.number, 7])
            hot = rng.choice(codes[0].size, max(1, round(HOT_SHARE * codes[0].size)), False)
            codes.reshape(frames, -1)[:, hot] += rng.integers(500, 3500, len(hot))
        top = (1 << self.camera.adc.bits) - 1
        return Stack(
            np.minimum(codes, top).astype(np.uint16),
            exposure.time_s,
            photons,
            bits=self.camera.adc.bits,
            source=f"{photons:.4g} photons",
        )

    def bench(self) -> Bench:
        """Return dark frames and flat fields."""
        end, levels = self.photons_at_end, LEVELS
        if self.kind == "few":
            levels = (*np.linspace(0.05, 0.95, 4 + self.number % 6), 1.2)
        flats = [self.stack(level * end, 2, 2 + k) for k, level in enumerate(levels)]
        flats.append(self.stack(HALF * end, 16, 1))
        darks = [self.stack(0.0, 16, 0)]
        if self.kind == "dark":
            darks += [
                self.stack(0.0, 8, 50 + k, ms.Exposure(t)) for k, t in enumerate((0.3, 1.0))
            ]
        return Bench((), tuple(darks), tuple(flats))


def random_sample(kind: str, number: int) -> Sample:
    """Return the camera of a kind with this number; equal numbers give equal cameras."""
    rng = np.random.default_rng([1288, KINDS.index(kind), number])

    def between(low: float, high: float) -> float:
        return math.exp(rng.uniform(math.log(low), math.log(high)))

    bits, well, efficiency = 12, between(5e3, 4e4), rng.uniform(0.3, 0.9)
    gain = 0.75 * 2**bits / well * between(0.8, 1.2)
    noise_dn = between(1.0, 6.0)
    if kind == "coarse":
        bits, noise_dn = 10, between(0.1, 0.7)
        gain = 0.75 * 2**bits / well * between(0.8, 1.2)
    read_e = noise_dn / gain
    row_e = column_e = 0.0
    if kind in ("lines", "coarse"):
        row_e, column_e = read_e * between(0.1, 1.0), read_e * between(0.1, 1.0)
    if kind == "coarse":
        read_e /= math.hypot(1, row_e / read_e, column_e / read_e)
    offset_dn = noise_dn if kind != "coarse" else between(0.1, 3.0)
    dsnu_e = [offset_dn / gain * between(0.2, 1.0) for _ in range(3)]
    if kind not in ("lines", "coarse"):
        dsnu_e[:2] = 0.0, 0.0
    prnu, prnu_col = between(0.003, 0.02), 0.0
    if kind in ("lines", "coarse"):
        prnu_col = between(0.001, 0.01)
    curvature = 0.0
    if kind == "curved":
        curvature = rng.uniform(0.005, 0.04) * rng.choice([-1, 1])
    if kind == "few":
        curvature = rng.uniform(-0.3, 0.3)
    rate = between(20.0, 2000.0) if kind == "dark" else 0.0
    spread_dn = gain * math.hypot(read_e, row_e, column_e, *dsnu_e)
    camera = ms.load_camera("bayer_2mp").replace(
        **{
            "sensor.rows": SHAPE[0],
            "sensor.columns": SHAPE[1],
            "quantum_efficiency.value": efficiency,
            "quantum_efficiency.wavelengths_nm": [300.0, 1100.0],
            "quantum_efficiency.tile": None,
            "pixel.full_well_e": well,
            "pixel.prnu": prnu,
            "pixel.dsnu_e": dsnu_e[2],
            "dark_current.rate_e_per_s": rate,
            "dark_current.at_temperature_k": EXPOSURE.temperature_k,
            "dark_current.cv": 0.0,
            "source_follower.read_noise_e": read_e,
            "source_follower.read_noise_cv": None,
            "source_follower.vv_nonlinearity": 1 + curvature,
            "readout.row_noise_e": row_e,
            "readout.column_noise_e": column_e,
            "readout.dsnu_row": dsnu_e[0] / well,
            "readout.dsnu_col": dsnu_e[1] / well,
            "readout.prnu_col": prnu_col,
            "readout.sense_gain_uv_per_e": 5.0,
            "adc.bits": bits,
            "adc.full_scale_v": 5e-6 * 2**bits / gain,
            "adc.black_level_dn": 10.0 + 6 * spread_dn + rng.uniform(),
        }
    )
    shot_e = math.sqrt(rate * EXPOSURE.time_s)
    true = {
        "K": gain,
        "η": efficiency,
        "σ_d": math.hypot(read_e, row_e, column_e, shot_e),
        "DSNU1288": math.hypot(*dsnu_e),
        "DSNU1288_row": dsnu_e[0],
        "DSNU1288_col": dsnu_e[1],
        "DSNU1288_pixel": dsnu_e[2],
        "PRNU1288": 100 * math.hypot(prnu, prnu_col),
        "PRNU1288_col": 100 * prnu_col,
        "PRNU1288_pixel": 100 * prnu,
        "σ_row": row_e,
        "σ_col": column_e,
        "σ_pixel": math.hypot(read_e, shot_e),
    }
    if rate:
        true |= {"µ_I.mean": rate, "µ_I.var": rate}
    return Sample(kind, number, camera, true)


@dataclass
class Coverage:
    """Coverage of one figure: cameras, values, intervals with the true value, and relative errors."""

    cameras: int = 0
    printed: int = 0
    covered: int = 0
    errors: list[float] = field(default_factory=list)

    def add(self, value: float, low: float, high: float, true: float) -> None:
        """Add one camera's figure."""
        self.cameras += 1
        if math.isnan(value):
            return
        self.printed += 1
        self.covered += low <= true <= high
        if true:
            self.errors.append(value / true - 1)


def measured_samples(
    kind: str, count: int, first: int = 0
) -> Iterator[tuple[Sample, dict[str, Quantity]]]:
    """Yield every camera with its figures."""
    for number in range(first, first + count):
        sample = random_sample(kind, number)
        (measured,) = measure_bench(sample.bench())
        yield sample, measured.figures


def coverage(kind: str, count: int, first: int = 0) -> dict[str, Coverage]:
    """Return the coverage of every figure over cameras of one kind."""
    found: dict[str, Coverage] = {}
    for sample, figures in measured_samples(kind, count, first):
        for symbol, true in sample.true.items():
            figure = figures[symbol]
            found.setdefault(symbol, Coverage()).add(
                figure.value, figure.low, figure.high, true
            )
    return found


def table(kind: str, found: dict[str, Coverage]) -> str:
    """Return a table with one row for each figure."""
    lines = [f"{kind:16}printed  covered  median |error|"]
    for symbol, one in found.items():
        held = "–"
        error = "–"
        if one.printed:
            held = f"{100 * one.covered / one.printed:.1f} %"
        if one.errors:
            error = f"{100 * float(np.median(np.abs(one.errors))):.2g} %"
        lines.append(
            f"{symbol:16}{100 * one.printed / one.cameras:5.0f} %  {held:>7}  {error:>8}"
        )
    return "\n".join(lines)


def main() -> None:
    """Print a table for each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="number of the first camera")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    warnings.simplefilter(
        "ignore", ms.SensorWarning
    )  # flat fields above saturation are asked for
    for kind in asked.kinds:
        found = coverage(kind, asked.cameras, asked.first)
        if asked.json:
            print(json.dumps({kind: {name: vars(one) for name, one in found.items()}}))
        else:
            print(table(kind, found), flush=True)


if __name__ == "__main__":
    main()
