"""Random charts with known answers: a generator of (name, quantity, reference) for each image-quality instrument.

image_quality_coverage.py counts how many intervals hold them.
"""

from __future__ import annotations

from collections.abc import Iterator

import charts
import numpy as np
import scipy

from mitsuba_sensor.lab.measure.automotive.contrast import contrast_detection
from mitsuba_sensor.lab.measure.automotive.flicker import flicker
from mitsuba_sensor.lab.measure.colour_and_geometry.colour_chart import colour_chart
from mitsuba_sensor.lab.measure.colour_and_geometry.distortion import (
    distortion,
    lateral_colour,
)
from mitsuba_sensor.lab.measure.colour_and_geometry.flat_field import flat_field
from mitsuba_sensor.lab.measure.image_quality.dead_leaves import dead_leaves
from mitsuba_sensor.lab.measure.image_quality.siemens_star import siemens_star
from mitsuba_sensor.lab.measure.noise_distance import noise_divergence
from mitsuba_sensor.lab.quantity import Quantity
from mitsuba_sensor.optics import spectra

Cases = Iterator[tuple[str, Quantity, float]]


def in_patches(values: np.ndarray, side: int) -> np.ndarray:
    """Return patches of these values (P, C) next to each other, shape (side, side·P, C)."""
    return np.repeat(values, side, axis=0)[None] * np.ones((side, 1, 1))


def patch_regions(count: int, side: int) -> list[tuple[int, int, int, int]]:
    """Return the regions of :func:`in_patches`."""
    return [(0, side * number, side, side) for number in range(count)]


def colour_case(rng: np.random.Generator) -> Cases:
    """Yield figures of a ColorChecker before a camera unlike the observer, with shot noise, read noise and PRNU."""
    side, regions = 20, patch_regions(24, 20)
    matrix = np.eye(3) + rng.uniform(0, 0.3, (3, 3))
    values = spectra.color_checker_xyz() @ matrix.T
    values *= np.exp(rng.normal(0, rng.uniform(0.02, 0.1), values.shape))
    factors = values[18, 1] / values[18] * np.exp(rng.normal(0, 0.03, 3))
    electrons, read_noise = 10 ** rng.uniform(2.5, 4.5), rng.uniform(0, 0.02)
    clean = in_patches(values, side)
    counts = rng.poisson(clean * electrons * (1 + 0.005 * rng.normal(size=clean.shape)))
    planes = counts / electrons + rng.normal(0, read_noise, clean.shape)
    true = colour_chart(clean, regions, white_balance=factors)
    chart = colour_chart(planes, regions, white_balance=factors)
    yield "mean ΔE00", chart.mean, float(true.delta_e.mean())
    yield "largest ΔE00", chart.largest, float(true.delta_e.max())
    greys = (values * factors)[18:].sum(axis=0)
    for quantity, channel in zip(chart.balance, (0, 2), strict=True):
        yield "white balance", quantity, float(100 * (greys[channel] / greys[1] - 1))


def star_case(rng: np.random.Generator) -> Cases:
    """Yield figures of a star with a random number of cycles and a normal point spread, with shot and read noise."""
    side, cycles = int(rng.integers(140, 220)), int(rng.choice([60, 72, 100]))
    blur_px, contrast = rng.uniform(0.2, 0.8), rng.uniform(0.2, 1.0)
    clean = charts.blurred_star(side, cycles, contrast, blur_px)
    electrons = 10 ** rng.uniform(2, 4.5)
    noise = rng.normal(0, rng.uniform(0, 0.02), clean.shape)
    picture = rng.poisson(clean * electrons) / electrons + noise
    modulation = siemens_star(picture, cycles, contrast=contrast).modulation
    for wanted in (0.15, 0.3, 0.5, 0.7):
        nearest = int(np.abs(modulation.frequency - wanted).argmin())
        frequency = float(modulation.frequency[nearest])
        true = float(np.exp(-2 * (np.pi * blur_px * frequency) ** 2))
        yield f"MTF({wanted})", modulation.at(frequency), true
    yield "MTF50", modulation.mtf50, float(np.sqrt(np.log(2) / 2) / np.pi / blur_px)


def leaves_case(rng: np.random.Generator) -> Cases:
    """Yield figures of dead leaves with a normal point spread, shot and read noise, by both methods."""
    chart = charts.dead_leaves(256)[
        : int(rng.integers(180, 257)), : int(rng.integers(180, 257))
    ]
    blur_px = rng.uniform(0.2, 0.8)
    clean = charts.blurred(chart, blur_px)
    electrons, read_noise = 10 ** rng.uniform(2.5, 4.5), rng.uniform(0, 0.02)
    counts = rng.poisson(clean * electrons, (4, *clean.shape)) / electrons
    frames = counts + rng.normal(0, read_noise, counts.shape)
    for method in ("cross", "power"):
        modulation = dead_leaves(frames, chart, method=method).modulation
        exact = dead_leaves(np.array([clean, clean]), chart, method=method).modulation
        for frequency in (0.125, 0.25, 0.5):
            quantity = modulation.at(frequency)
            yield f"{method}({frequency})", quantity, exact.at(frequency).value


def flat_case(rng: np.random.Generator) -> Cases:
    """Yield figures of cos⁴ fall-off that differs between three channels, with shot noise and PRNU."""
    y, x = (np.arange(count) + 0.5 for count in (80, 100))
    square = ((x / 50 - 1) ** 2 + (y[:, None] / 40 - 1) ** 2) / 2
    falls = rng.uniform(0.05, 0.3) + rng.uniform(-0.02, 0.02, 3)
    clean = 10 ** rng.uniform(3, 4.5) * (1 + falls * square[..., None]) ** -2.0
    planes = rng.poisson(clean * (1 + 0.005 * rng.normal(size=clean.shape)))
    measured = flat_field(planes)
    corners = (1 + falls) ** -2.0
    yield "relative illumination", measured.illumination[0], 100 * corners[0]
    yield "colour shading", measured.shading[1], 100 * (corners[2] / corners[1] - 1)


def normal_share(means: np.ndarray, sigmas: np.ndarray, ratio: float) -> float:
    """Return the fraction of pairs of normal values whose quotient exceeds a ratio, with a positive second value."""
    return float(
        scipy.special.ndtr(
            (means[0] - ratio * means[1]) / np.hypot(sigmas[0], ratio * sigmas[1])
        )
    )


def contrast_case(rng: np.random.Generator) -> Cases:
    """Yield figures of two patches in four frames with normal noise that is partly fixed pattern."""
    contrast, side = rng.uniform(0.05, 1), int(rng.integers(12, 40))
    means = np.array([1 + contrast, 1.0])
    sigmas = rng.uniform(0.02, 0.2) * np.sqrt(means)
    fixed = rng.uniform(0, 0.7)
    patches = [
        mean
        + sigma * np.sqrt(fixed) * rng.normal(size=(side, side))
        + sigma * np.sqrt(1 - fixed) * rng.normal(size=(4, side, side))
        for mean, sigma in zip(means, sigmas, strict=True)
    ]
    measured = contrast_detection(*patches, contrast)
    ends = [normal_share(means, sigmas, 1 + contrast * bound) for bound in (0.5, 1.5)]
    if 0.002 < ends[0] - ends[1] < 0.998:
        yield "CTA", measured.accuracy, ends[0] - ends[1]
    if ends[0] < 0.998:
        yield "CDP", measured.detection, ends[0]
    yield "contrast", measured.mean, contrast


def flicker_case(rng: np.random.Generator) -> Cases:
    """Yield figures of sine, pulse, triangle or steady light at random phases, with noise and PRNU."""
    count, side = int(rng.choice([4, 16, 60, 240])), int(rng.choice([4, 12, 20]))
    phase = rng.random(count)
    depth, duty, share = rng.uniform(0.05, 0.9), rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.8)
    waves = {
        "sine": 1 + depth * np.sin(2 * np.pi * phase),
        "pulse": 1 - depth + 2 * depth * (phase < duty),
        "triangle": 1 + depth * (2 * np.abs(2 * phase - 1) - 1),
        "steady": np.ones(count),
    }
    name = str(rng.choice(list(waves)))
    level = 10 ** rng.uniform(2, 4) * waves[name]
    clean = level[:, None, None] * (1 + 0.01 * rng.normal(size=(side, side)))
    frames = rng.poisson(clean) + rng.normal(0, 5, clean.shape)
    off = share * float(np.median(level))
    measured = flicker(frames, off=off)
    yield f"FMI {name}", measured.modulation, float(np.ptp(level) / (level.max() + level.min()))
    if name == "pulse":
        bright, dark = level.max() / off, level.min() / off
        if min(abs(bright - 1.1), abs(dark - 1.1)) > 0.1:
            yield "FDI", measured.detection, duty * (bright > 1.1) + (1 - duty) * (dark > 1.1)


def distortion_case(rng: np.random.Generator) -> Cases:
    """Yield figures of a turned and tilted grid through a lens with two coefficients; errors of 0.01 to 0.2 px."""
    k1, k2 = rng.uniform(-0.1, 0.1), rng.uniform(-0.02, 0.02)
    rows, columns = 1080, 1920
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 17), np.linspace(-0.44, 0.44, 10))
    plane = np.stack([x, y], axis=-1).reshape(-1, 2)
    angle, tilt = rng.uniform(-0.05, 0.05), rng.uniform(-0.03, 0.03, 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    ideal = (plane @ turn + rng.uniform(-0.02, 0.02, 2)) / (1 + plane @ tilt)[:, None]
    square = np.square(ideal).sum(axis=1, keepdims=True)
    corner = np.hypot(rows, columns) / 2
    real = ideal * (1 + k1 * square + k2 * square**2)
    points = np.array([columns, rows]) / 2 + corner * real
    noise = 10 ** rng.uniform(-2, -0.7)
    points_px = points + noise * rng.normal(size=points.shape)
    measured = distortion(points_px, plane, (rows, columns))
    yield "local distortion", measured.local, 100 * (k1 + k2)
    top = (rows / 2 / corner) ** 2
    yield "TV distortion", measured.tv, 100 * ((1 + k1 + k2) / (1 + k1 * top + k2 * top**2) - 1)
    for line, side in zip(measured.lines, (rows, columns), strict=True):
        middle = (side / 2 / corner) ** 2
        yield "line distortion", line, 50 * (k1 * (1 - middle) + k2 * (1 - middle**2))
    first, third = rng.uniform(-1, 1, 2)
    other = points + real * (first + third * np.square(real).sum(axis=1, keepdims=True))
    other = other + 0.3 + noise * rng.normal(size=points.shape)
    yield "lateral colour", lateral_colour(other, points, (rows, columns)), first + third


def divergence_case(rng: np.random.Generator) -> Cases:
    """Yield the divergence of normal noise from normal noise with another, or the same, mean and σ."""
    size = int(10 ** rng.uniform(3.5, 4.5))
    shift, sigma = rng.uniform(0, 0.3), rng.uniform(0.8, 1.25)
    name = str(rng.choice(["KL", "KL of one law"]))
    if name != "KL":
        shift, sigma = 0.0, 1.0
    quantity = noise_divergence(rng.normal(size=size), rng.normal(shift, sigma, size))
    true = np.log(sigma) + (1 + shift**2) / (2 * sigma**2) - 0.5
    yield name, quantity, float(true)
