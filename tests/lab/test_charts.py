"""All instruments of charts alike: values that none can measure, units, drawings, and intervals that hold."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import chart_cases
import charts
import image_quality_coverage
import numpy as np
import pytest
from helpers.marks import exhaustive
from matplotlib.figure import Figure

import mitsuba_sensor as ms
from mitsuba_sensor.lab.measure.polarization import polarization

lab = ms.lab
RNG = np.random.default_rng(5)
NOISE = RNG.normal(0, 3, (96, 96))
TURNED = np.arange(96) - 48 - 0.1 * np.arange(-48, 48)[:, None]
EDGE = 100 + 800 * np.clip(TURNED, 0, 1) + NOISE
SMALL = EDGE[24:72, 24:72]
WAVE = 24 * np.arctan2(*(np.mgrid[:96, :96] - 47.5))
STAR = 500 + 300 * np.cos(WAVE) + NOISE
LEAVES = 100 + 900 * RNG.random((96, 96))
COLOURS = RNG.uniform(0.1, 0.9, (24, 3))
PATCHES = np.repeat(np.repeat(COLOURS.reshape(6, 4, 3), 16, 0), 24, 1)
REGIONS = [(16 * row, 24 * column, 16, 24) for row in range(6) for column in range(4)]
POINTS = 50 + 20 * np.stack(np.mgrid[:7, :9], axis=-1).reshape(-1, 2) + RNG.random((63, 2))
FRAMES = EDGE[:, None].reshape(96, 8, 12)
STEPS = lab.Stack(np.ones((2, 96, 96)), 0.01, bits=12)
ONES = np.ones((8, 8))


def colours(planes: Any, **options: Any) -> Any:
    return lab.colour_chart(planes, REGIONS, reference_xyz=COLOURS, **options)


INSTRUMENTS: dict[str, tuple[Callable[[Any], Any], np.ndarray]] = {
    "slanted_edge": (lab.slanted_edge, SMALL),
    "slanted_edge, flat": (
        lambda flat: lab.slanted_edge(SMALL, flat=flat),
        100 + NOISE[:48, :48],
    ),
    "siemens_star": (lambda star: lab.siemens_star(star, 24), STAR),
    "dead_leaves": (lambda frames: lab.dead_leaves(frames, LEAVES), LEAVES),
    "dead_leaves, chart": (lambda chart: lab.dead_leaves(LEAVES, chart), LEAVES),
    "flat_field": (lab.flat_field, 500 + NOISE),
    "colour_chart": (colours, PATCHES + NOISE[..., None] / 3000),
    "distortion": (lambda points: lab.distortion(points, POINTS, (200, 240)), POINTS),
    "lateral_colour": (lambda points: lab.lateral_colour(points, POINTS, (200, 240)), POINTS),
    "contrast_detection": (lambda bright: lab.contrast_detection(bright, EDGE, 0.5), EDGE),
    "flicker": (lab.flicker, FRAMES),
    "noise_divergence": (lambda noise: lab.noise_divergence(noise, NOISE), NOISE),
}


def spoil_one(value: float) -> Callable[[np.ndarray], np.ndarray]:
    """One value in the middle is this one."""
    return lambda values: np.concatenate(
        [
            values[:-1],
            np.full_like(values[-1:], value),
        ]  # the last row, for points and noise too
    )


WRONG: dict[str, tuple[Callable[[np.ndarray], Any], str]] = {
    "NaN": (spoil_one(math.nan), "NaN or infinite"),
    "infinite": (spoil_one(-math.inf), "NaN or infinite"),
    "huge": (spoil_one(1e300), "values up to"),
    "tiny": (lambda values: values * 1e-160, "largest value is from"),
    "complex": (lambda values: values + 0j, "complex"),
    "masked": (lambda values: np.ma.masked_less(values, np.median(values)), "masked"),
    "empty": (lambda values: values[:0], "has shape|has 0 values|images of 0 ×"),
    "text": (lambda values: "edge.png", "file name|name of a file"),
    "objects": (lambda values: values.astype(object), "not numeric"),
}


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_values_that_are_none_are_refused_with_one_sentence(name: str) -> None:
    measure, values = INSTRUMENTS[name]
    for spoil, said in WRONG.values():
        with pytest.raises(ms.InputError, match=said) as refused:
            measure(spoil(values))
        assert len(str(refused.value)) < 420


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_results_do_not_depend_on_the_unit_and_draw_themselves_with_named_axes(
    name: str,
) -> None:
    """A thousandth and a million times the values give the same figures, to 1e-6, where one argument has a unit."""
    measure, values = INSTRUMENTS[name]
    result = measure(values)
    if hasattr(result, "plot"):
        axes = Figure().subplots()
        result.plot(axes)
        levels = [one for one in axes.lines if one.get_linestyle() == ":"]
        assert axes.get_xlabel() and axes.get_ylabel()
        assert len(axes.texts) == len(levels), "every level has its name"
        assert len(axes.get_legend_handles_labels()[1]) <= 8
    if name in ("contrast_detection", "distortion", "lateral_colour", "noise_divergence"):
        return
    for factor in (1e-3, 1e6):
        figures = [quantity.value for quantity in measure(factor * values).quantities]
        same = [quantity.value for quantity in result.quantities]
        assert figures == pytest.approx(same, rel=1e-6, abs=1e-6, nan_ok=True)


def steps(**changes: Any) -> Any:
    given = {"regions": REGIONS, "exposure_lxs": np.arange(24.0), "black_dn": 0.0} | changes
    return lab.step_chart(STEPS, **given)


def polarised(angles: Any, shape: tuple[int, int] = (4, 4), **options: Any) -> Any:
    stack = lab.Stack(np.full((1, *shape), 100.0), 0.1)
    return polarization(stack, angles, **{"variance_dn2": 4.0, **options})


ANGLES = [[90, 45], [135, 0]]
REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: lab.slanted_edge(np.ones((40, 40))), "no edge"),
    (lambda: lab.slanted_edge(charts.slanted_edge((100, 80), 0)), "turn it"),
    (lambda: lab.slanted_edge(charts.slanted_edge((40, 8), 3)), "beside its edge"),
    (lambda: lab.slanted_edge(EDGE, flat=0 * EDGE), "positive"),
    (lambda: lab.siemens_star(STAR, 3), "cycles"),
    (lambda: lab.siemens_star(STAR[:30, :30], 144), "no ring"),
    (lambda: lab.siemens_star(STAR, 25), "no star"),
    (lambda: lab.siemens_star(STAR - 900, 24), "not brighter than black"),
    (lambda: lab.dead_leaves(LEAVES, LEAVES[:50]), "multiple"),
    (lambda: lab.dead_leaves(LEAVES[:40], LEAVES[:40]), "or more"),
    (lambda: lab.dead_leaves(LEAVES, LEAVES, method="power"), "one frame"),
    (lambda: lab.flat_field(np.ones((8, 100))), "16 × 16"),
    (lambda: colours(PATCHES[:, :, :2]), "three channels"),
    (lambda: colours(0 * PATCHES), "above 0"),
    (lambda: lab.colour_chart(PATCHES, REGIONS, reference_xyz=COLOURS[:4]), "for 24 patches"),
    (lambda: colours(PATCHES, white_balance=[1.0, 2.0]), "white_balance has shape"),
    *((lambda greys=greys: colours(PATCHES, greys=greys), "greys is") for greys in (None, "ab", (18, 18), (18, 99))),
    (lambda: lab.distortion(POINTS[:5], POINTS[:5], (200, 240)), "12 points"),
    (lambda: lab.distortion(POINTS, 0 * POINTS, (200, 240)), "on a line"),
    (lambda: lab.lateral_colour(POINTS, POINTS, (0, 0)), "shape"),
    (lambda: lab.contrast_detection(ONES[:3, :3], ONES, 0.5), "16 pixels"),
    (lambda: lab.contrast_detection(ONES, ONES, 1, kind="rms"), "weber, michelson"),
    (lambda: lab.flicker(NOISE.reshape(9, 32, 32) - NOISE.mean() + 1e-3), "dark as their noise"),
    (lambda: lab.flicker(FRAMES, off=0.0), "off is 0"),
    (lambda: lab.noise_divergence(NOISE, 100 + NOISE), "that overlap"),
    (lambda: lab.noise_divergence(NOISE, NOISE, bins=4.5), "whole number"),  # type: ignore[arg-type]
    (lambda: steps(exposure_lxs=np.arange(-1.0, 23.0)), "0 or more"),
    (lambda: steps(black_dn=2000.0), "become brighter"),
    (lambda: steps(saturation_dn=0.5), "are unclipped"),
    (lambda: polarised(ANGLES, variance_dn2=None), "one frame shows no noise"),
    (lambda: polarised([[0, 90]]), "three different angles"),
    (lambda: polarised(ANGLES, (5, 4)), "cut off"),
    (lambda: polarised(ANGLES, black_dn=np.zeros(3)), "black_dn"),
]  # fmt: skip


def test_charts_that_show_nothing_are_refused() -> None:
    for number, (call, said) in enumerate(REFUSED):
        with pytest.raises(ms.InputError, match=said):
            call()
            pytest.fail(f"row {number}, {said}")


@pytest.mark.parametrize(
    "regions", [None, 7, "abc", [None], [(0, 0, 2**70, 16)], [(0.5, 0, 8, 8)], [(-1, 0, 8, 8)]]
)
def test_patches_that_are_none_are_refused(regions: Any) -> None:
    for measure in (
        lambda: steps(regions=regions, exposure_lxs=[1.0]),
        lambda: lab.colour_chart(PATCHES, regions),
    ):
        with pytest.raises(ms.InputError, match=r"first row, first column|for 1 patches"):
            measure()


@pytest.mark.parametrize(
    ("case", "cases", "least"),
    [
        (chart_cases.colour_case, 8, 0.75),
        (chart_cases.contrast_case, 40, 0.84),
        (chart_cases.flicker_case, 40, 0.84),
        (chart_cases.distortion_case, 20, 0.82),
        (chart_cases.flat_case, 6, 0.6),
        (chart_cases.divergence_case, 60, 0.84),
        (chart_cases.star_case, 6, 0.75),
        exhaustive(image_quality_coverage.edge_case, 50, 0.89),
    ],
)
def test_intervals_cover_what_charts_were_made_with(
    case: Callable[..., Any], cases: int, least: float
) -> None:
    """2 to 6 figures of each case: shares of right 95 % intervals are smaller once in 1000 tests."""
    shares = [share for share, _ in image_quality_coverage.coverage(case, cases).values()]
    assert least < np.mean(shares) <= 1
