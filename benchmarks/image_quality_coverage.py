"""Measure the coverage of the 95 % intervals of the image-quality instruments.

    python benchmarks/image_quality_coverage.py --cases 400 [--seed 1] [--only slanted_edge]

Every case is a chart with another place, direction, contrast, exposure and noise. Prints for each figure the share of
the intervals that hold it, and the median of half their width over the value.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator

import chart_cases
import charts
import numpy as np

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.image_quality.slanted_edge import slanted_edge
from mitsuba_sensor.lab.measure.image_quality.step_chart import step_chart
from mitsuba_sensor.lab.quantity import Quantity

Case = Callable[[np.random.Generator], Iterator[tuple[str, Quantity, float]]]


def noisy(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a picture with shot noise of an SNR of 15 to 300 at 1, and read noise of 0 to 1 %."""
    electrons = 10 ** rng.uniform(2.35, 4.95)
    read_noise = rng.uniform(0, 0.01)
    return rng.poisson(picture * electrons) / electrons + rng.normal(
        0, read_noise, picture.shape
    )


def edge_case(rng: np.random.Generator) -> Iterator[tuple[str, Quantity, float]]:
    """Yield figures of an edge of any direction in uneven light."""
    angle_deg = rng.choice([0, 90, 180, 270]) + rng.choice([-1, 1]) * rng.uniform(2, 22)
    shape = int(rng.integers(60, 120)), int(rng.integers(60, 120))
    picture = charts.slanted_edge(shape, angle_deg, rng.uniform(-3, 3), rng.uniform(0.02, 0.4))
    rows, columns = np.mgrid[: shape[0], : shape[1]] / 100
    light = 1 + rng.uniform(-0.1, 0.1) * rows + rng.uniform(-0.1, 0.1) * columns
    modulation = slanted_edge(noisy(picture * light, rng)).modulation
    for frequency in (0.1, 0.25, 0.5, 0.8):
        true = float(charts.pixel_modulation(np.array(frequency), angle_deg))
        yield f"MTF({frequency})", modulation.at(frequency), true
    fine = np.linspace(0.4, 0.8, 4001)
    crossing = np.interp(0.5, -charts.pixel_modulation(fine, angle_deg) + 1, fine)
    yield "MTF50", modulation.mtf50, float(crossing)


def step_case(rng: np.random.Generator) -> Iterator[tuple[str, Quantity, float]]:
    """Yield figures of a step chart before a linear camera with read noise and PRNU, and closed forms."""
    gain, read_e, prnu = rng.uniform(0.1, 2), rng.uniform(6, 30), rng.uniform(0.001, 0.008)
    per_lxs, black_dn, largest = 10 ** rng.uniform(3, 5), 64.0, 4095 - 64
    steps = np.concatenate([[0.0], np.geomspace(0.003, 0.9, 15)])
    exposures = steps * largest / gain / per_lxs
    side, frames = 24, int(rng.integers(2, 9))
    means_e = np.repeat(exposures * per_lxs, side)[None, :] * np.ones((side, 1))
    electrons = means_e * (1 + prnu * rng.normal(size=means_e.shape))
    counts = rng.poisson(electrons, (frames, *means_e.shape))
    noise_e = read_e * rng.normal(size=counts.shape)
    codes = np.clip(np.round(black_dn + gain * (counts + noise_e)), 0, 4095)
    regions = [(0, side * k, side, side) for k in range(steps.size)]
    chart = step_chart(Stack(codes, 0.01, bits=12), regions, exposures, black_dn=black_dn)
    constant, slope = (gain * read_e) ** 2 + 1 / 12, gain * per_lxs
    yield "response", chart.slope, slope
    yield "S_sat", chart.saturation_speed, 78 * slope / largest
    for ratio, speed in ((40, chart.noise_speed_40), (10, chart.noise_speed_10)):
        if not np.isnan(speed.value):
            rest = 1 - (ratio * prnu) ** 2
            linear = ratio**2 * gain
            root = np.sqrt(linear**2 + 4 * rest * ratio**2 * constant)
            yield f"S_noise{ratio}", speed, 10 * slope * 2 * rest / (linear + root)
    smallest = (gain + np.sqrt(gain**2 + 4 * constant)) / 2
    yield "DR", chart.dynamic_range, 20 * np.log10(largest / smallest)


CASES: dict[str, Case] = {
    "slanted_edge": edge_case,
    "step_chart": step_case,
    "colour_chart": chart_cases.colour_case,
    "siemens_star": chart_cases.star_case,
    "dead_leaves": chart_cases.leaves_case,
    "flat_field": chart_cases.flat_case,
    "contrast_detection": chart_cases.contrast_case,
    "flicker": chart_cases.flicker_case,
    "distortion": chart_cases.distortion_case,
    "noise_divergence": chart_cases.divergence_case,
}


def coverage(case: Case, count: int, seed: int = 1) -> dict[str, tuple[float, float]]:
    """Return the fraction of intervals that contain the true value, and the median relative half width, by figure."""
    held: dict[str, list[bool]] = {}
    widths: dict[str, list[float]] = {}
    for number in range(count):
        for name, quantity, true in case(np.random.default_rng([seed, number])):
            if np.isnan(quantity.value):
                continue
            held.setdefault(name, []).append(quantity.covers(true))
            half = (quantity.high - quantity.low) / 2
            widths.setdefault(name, []).append(half / max(abs(true), 1e-12))
    return {name: (float(np.mean(held[name])), float(np.median(widths[name]))) for name in held}


def main() -> None:
    """Print a line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1, help="other charts for another one")
    parser.add_argument("--only", choices=CASES)
    given = parser.parse_args()
    for title, case in CASES.items():
        if given.only in (None, title):
            for name, (share, width) in coverage(case, given.cases, given.seed).items():
                print(
                    f"{title:18} {name:14} {100 * share:5.1f} %   ± {100 * width:.2g} %",
                    flush=True,
                )


if __name__ == "__main__":
    main()
