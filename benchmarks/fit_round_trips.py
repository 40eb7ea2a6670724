"""Fit frames of random cameras, and compare every parameter with its true value.

    python benchmarks/fit_round_trips.py --seeds 200

Prints for each parameter the median and largest relative error, and the coverage of the 95 % intervals. One camera in
four has Tukey-lambda read noise.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.quantity import Quantity
from mitsuba_sensor.lab.twin import fit
from mitsuba_sensor.stages.gains import gain_dn_per_e

KELVIN = 298.15
LEVELS = (0.01, 0.03, 0.06, *np.arange(0.12, 0.95, 0.07), 1.0, 1.1, 1.25)
"""Of the flat fields, over the signal that ends the range."""
FLAT_S = 0.01


@dataclass(frozen=True)
class Trip:
    """A camera, the serial number of its frames, and the number of frames in a stack."""

    camera: ms.Camera
    serial: int
    frames: int

    @property
    def end_e(self) -> float:
        """Electrons at the end of the range: the full well, or the full-scale code."""
        camera = self.camera
        codes = 2**camera.adc.bits - 1 - camera.adc.black_level_dn
        return float(min(camera.pixel.full_well_e, codes / gain_dn_per_e(camera)))

    def stack(self, photons: float, time_s: float, frames: int, seed: int) -> Stack:
        """Return frames of uniform illumination."""
        exposure = ms.Exposure(time_s, KELVIN)
        made = ms.expose(
            photons, self.camera, exposure, frames=frames, serial=self.serial, seed=seed
        )
        name = "flat" if photons else "dark"
        return Stack(
            made.digital,
            time_s,
            photons,
            KELVIN,
            bits=self.camera.adc.bits,
            source=f"{name}_{time_s:g}s",
        )

    def bench(self) -> Bench:
        """Return bias frames, dark frames of three exposure times, and flat fields, one of them with more frames."""
        first, rate = 1000 * self.serial, self.camera.dark_current.rate_e_per_s
        longest = min(0.1 * self.end_e / rate, 600.0)
        bias = self.stack(0.0, 0.0, self.frames, first)
        times = (FLAT_S, 0.3 * longest, longest)
        darks = [
            self.stack(0.0, time, self.frames, first + 1 + k) for k, time in enumerate(times)
        ]
        half = LEVELS[int(np.argmin(np.abs(np.array(LEVELS) - 0.5)))]
        flats = [
            self.stack(
                level * self.end_e / 0.6,
                FLAT_S,
                self.frames if level == half else 4,
                first + 10 + k,
            )
            for k, level in enumerate(LEVELS)
        ]
        return Bench((bias,), tuple(darks), tuple(flats))

    def put_in(self) -> dict[str, float]:
        """Return the true figures; black level and dark current are those of this sensor unit."""
        camera, gain = self.camera, gain_dn_per_e(self.camera)
        maps = ms.fpn_maps(camera, serial=self.serial)
        offsets = sum(
            float(maps[name].mean()) for name in ("dsnu_col_e", "dsnu_row_e", "dsnu_pixel_e")
        )
        follower, readout, pixel = camera.source_follower, camera.readout, camera.pixel
        found = {
            "K": gain,
            "black": camera.adc.black_level_dn + gain * offsets,
            "σ_read": follower.read_noise_e,
            "σ_row": readout.row_noise_e,
            "σ_col": readout.column_noise_e,
            "PRNU_pixel": pixel.prnu,
            "PRNU_col": readout.prnu_col,
            "DSNU_pixel": pixel.dsnu_e,
            "DSNU_row": readout.dsnu_row * pixel.full_well_e,
            "DSNU_col": readout.dsnu_col * pixel.full_well_e,
            "µ_I": camera.dark_current.rate_e_per_s * float(maps["dark_fpn"].mean()),
            "D_N": camera.dark_current.cv,
        }
        if follower.read_noise_shape is not None:
            found["λ"] = follower.read_noise_shape
        well = pixel.full_well_e * gain + camera.adc.black_level_dn < 2**camera.adc.bits - 1
        return found | ({"µ_e.end": pixel.full_well_e} if well else {})


def random_trip(seed: int, size: int = 80, frames: int = 24) -> Trip:
    """Return a camera whose parameters can be measured in its frames."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    bits, well, read = int(rng.choice([10, 12, 14])), between(5e3, 6e4), between(1.5, 12.0)
    gain = max(0.8 * 2**bits / well * between(0.6, 1.6), 0.8 / read)
    sense_uv = 1e6 / well
    full_scale_v = sense_uv * 1e-6 * 2**bits / gain
    changes = {
        "sensor.rows": size,
        "sensor.columns": size + 16,
        "quantum_efficiency.value": 0.6,
        "quantum_efficiency.wavelengths_nm": [300.0, 1100.0],
        "quantum_efficiency.tile": None,
        "pixel.full_well_e": well,
        "pixel.prnu": between(0.004, 0.02),
        "pixel.dsnu_e": between(0.3, 1.5) * read,
        "dark_current.rate_e_per_s": between(5, 200),
        "dark_current.doubling_k": None,
        "dark_current.cv": between(0.1, 0.5),
        "dark_current.distribution": str(
            rng.choice(["lognormal", "gamma", "gaussian", "wald"])
        ),
        "source_follower.read_noise_e": read,
        "source_follower.read_noise_cv": between(0.1, 0.4),
        "readout.sense_gain_uv_per_e": sense_uv,
        "readout.row_noise_e": between(0.1, 0.5) * read,
        "readout.column_noise_e": between(0.1, 0.5) * read,
        "readout.dsnu_row": between(0.2, 1.0) * read / well,
        "readout.dsnu_col": between(0.2, 1.0) * read / well,
        "readout.prnu_col": between(0.001, 0.005),
        "adc.bits": bits,
        "adc.full_scale_v": full_scale_v,
        "adc.black_level_dn": float(math.ceil(8 * gain * read + 4)),
    }
    if rng.random() < 0.25:
        changes["source_follower.vv_nonlinearity"] = 1 + between(0.01, 0.08) * (-1) ** int(
            rng.integers(2)
        )
    if rng.random() < 0.25:
        changes["source_follower.read_noise_distribution"] = "tukey_lambda"
        changes["source_follower.read_noise_shape"] = float(rng.uniform(-0.2, 0.0))
    return Trip(ms.load_camera("bayer_2mp").replace(**changes), seed + 1, frames)


def results(
    seeds: range, size: int = 80, frames: int = 24
) -> Iterator[tuple[int, str, float, Quantity]]:
    """Yield (seed, symbol, true value, figure) of every parameter of every camera."""
    for seed in seeds:
        trip = random_trip(seed, size, frames)
        figures = fit(trip.bench()).figures()
        found = {name: figure.quantity for name, figure in figures.items()}
        for symbol, value in trip.put_in().items():
            if symbol in found:
                yield seed, symbol, value, found[symbol]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--size", type=int, default=80, help="rows; 16 columns more")
    parser.add_argument("--frames", type=int, default=24, help="frames of a stack")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    rows: dict[str, list[tuple[float, bool, int]]] = {}
    for seed, symbol, value_in, one in results(seeds, asked.size, asked.frames):
        rows.setdefault(symbol, []).append(
            (one.value / value_in - 1, one.covers(value_in), seed)
        )
    print(f"{'':12}  n    covered  median |error|  95 %  largest (seed)")
    for symbol, some in rows.items():
        errors = np.abs([one[0] for one in some])
        worst = some[int(np.argmax(errors))][2]
        covered = sum(one[1] for one in some) / len(some)
        print(
            f"{symbol:12} {len(some):3d}   {100 * covered:5.1f} %   {100 * np.median(errors):8.3f} %   "
            f"{100 * np.quantile(errors, 0.95):8.3f} %  {100 * errors.max():8.3f} % ({worst})",
            flush=True,
        )


if __name__ == "__main__":
    main()
