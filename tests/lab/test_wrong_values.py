"""Values that no instrument can measure: each is refused with one sentence, or has no value and a note says why."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.correlation import correlation
from mitsuba_sensor.lab.measure.dark_noise import dark_noise

RNG = np.random.default_rng(5)
NOISE = RNG.normal(0, 3, (96, 96))
TURNED = np.arange(96) - 48 - 0.1 * np.arange(-48, 48)[:, None]
EDGE = 100 + 800 * np.clip(TURNED, 0, 1) + NOISE
WAVE = 24 * np.arctan2(*(np.mgrid[:96, :96] - 47.5))
STAR = 500 + 300 * np.cos(WAVE) + NOISE
LEAVES = 100 + 900 * RNG.random((96, 96))
COLOURS = RNG.uniform(0.1, 0.9, (24, 3))
PATCHES = np.repeat(np.repeat(COLOURS.reshape(6, 4, 3), 16, 0), 24, 1)
REGIONS = [(16 * row, 24 * column, 16, 24) for row in range(6) for column in range(4)]
POINTS = 50 + 20 * np.stack(np.mgrid[:7, :9], axis=-1).reshape(-1, 2) + RNG.random((63, 2))

INSTRUMENTS: dict[str, tuple[Callable[[Any], Any], np.ndarray]] = {
    "slanted_edge": (ms.lab.slanted_edge, EDGE),
    "slanted_edge, flat": (lambda flat: ms.lab.slanted_edge(EDGE, flat=flat), 100 + NOISE),
    "siemens_star": (lambda star: ms.lab.siemens_star(star, 24), STAR),
    "dead_leaves": (lambda frames: ms.lab.dead_leaves(frames, LEAVES), LEAVES),
    "dead_leaves, chart": (lambda chart: ms.lab.dead_leaves(LEAVES, chart), LEAVES),
    "flat_field": (ms.lab.flat_field, 500 + NOISE),
    "colour_chart": (
        lambda planes: ms.lab.colour_chart(planes, REGIONS, reference_xyz=COLOURS),
        PATCHES + NOISE[..., None] / 3000,
    ),
    "distortion": (lambda points: ms.lab.distortion(points, POINTS, (200, 240)), POINTS),
    "lateral_colour": (
        lambda points: ms.lab.lateral_colour(points, POINTS, (200, 240)),
        POINTS,
    ),
    "contrast_detection": (lambda bright: ms.lab.contrast_detection(bright, EDGE, 0.5), EDGE),
    "flicker": (ms.lab.flicker, EDGE[:, None].reshape(96, 8, 12)),
    "noise_divergence": (lambda noise: ms.lab.noise_divergence(noise, NOISE), NOISE),
}


def spoil_one(value: float) -> Callable[[np.ndarray], np.ndarray]:
    """One value in the middle is this one."""

    def spoil(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[len(values) // 2] = value
        return values

    return spoil


WRONG: dict[str, tuple[Callable[[np.ndarray], Any], str]] = {
    "NaN": (spoil_one(math.nan), "is NaN or infinite in [0-9]+ place"),
    "infinite": (spoil_one(-math.inf), "is NaN or infinite in [0-9]+ place"),
    "huge": (spoil_one(1e300), r"has values up to 1e\+300; pass .*, in a unit in which"),
    "tiny": (lambda values: values * 1e-160, "in a unit in which the largest is from 1e-30"),
    "complex": (lambda values: values + 0j, "is complex"),
    "masked": (lambda values: np.ma.masked_less(values, np.median(values)), "masked value"),
    "empty": (lambda values: values[:0], "has shape|has 0 values|pictures of 0 ×"),
    "text": (lambda values: "edge.png", "is the name of a file"),
    "objects": (lambda values: values.astype(object), "is not numeric"),
}


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_values_that_are_none_are_refused_with_one_sentence(name: str) -> None:
    measure, values = INSTRUMENTS[name]
    for spoil, said in WRONG.values():
        with pytest.raises(ms.InputError, match=said) as refused:
            measure(spoil(values))
        assert len(str(refused.value)) < 420


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_figures_do_not_depend_on_the_unit_of_the_values(name: str) -> None:
    """A thousandth and a million times the values give the same figures, to 1e-6."""
    if name in ("contrast_detection", "distortion", "lateral_colour", "noise_divergence"):
        pytest.skip("compares two arguments of one unit")
    measure, values = INSTRUMENTS[name]

    def figures(factor: float) -> list[float]:
        return [quantity.value for quantity in measure(factor * values).quantities]

    assert figures(1e-3) == pytest.approx(figures(1.0), rel=1e-6, abs=1e-6, nan_ok=True)
    assert figures(1e6) == pytest.approx(figures(1.0), rel=1e-6, abs=1e-6, nan_ok=True)


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_results_draw_themselves_with_named_axes(name: str) -> None:
    measure, values = INSTRUMENTS[name]
    result = measure(values)
    if hasattr(result, "plot"):
        axes = Figure().subplots()
        result.plot(axes)
        assert axes.get_xlabel() and axes.get_ylabel() and not axes.texts
        assert len(axes.get_legend_handles_labels()[1]) <= 8


@pytest.mark.parametrize(
    "regions", [None, 7, "abc", [None], [(0, 0, 2**70, 16)], [(0.5, 0, 8, 8)]]
)
def test_patches_that_are_none_are_refused(regions: Any) -> None:
    stack = Stack(np.ones((2, 40, 40)), 0.01)
    with pytest.raises(ms.InputError, match="first row, first column, rows, columns"):
        ms.lab.step_chart(stack, regions, [1.0], black_dn=0.0)
    with pytest.raises(ms.InputError, match=r"first row, first column|for 1 patches"):
        ms.lab.colour_chart(PATCHES, regions)


def test_patches_that_do_not_become_brighter_are_refused() -> None:
    frames = 100 + 10 * RNG.normal(size=(2, 16, 96))
    regions = [(0, 16 * number, 16, 16) for number in range(6)]
    with pytest.raises(ms.InputError, match="patches that become brighter"):
        ms.lab.step_chart(Stack(frames, 0.01), regions, np.arange(6), black_dn=2000.0)


@pytest.mark.parametrize("greys", [None, 7, "ab", (18, 18), (18, 99), (18.5, 19), [[18], [19]]])
def test_greys_that_are_no_patches_are_refused(greys: Any) -> None:
    with pytest.raises(ms.InputError, match="pass numbers of two patches or more"):
        ms.lab.colour_chart(PATCHES, REGIONS, greys=greys)


def test_frames_that_are_all_alike_have_no_correlation() -> None:
    frames = np.repeat(RNG.integers(10, 30, (1, 8, 8)), 8, axis=0)
    found = correlation(Stack(frames, 0.01))
    assert all(math.isnan(figure.value) and figure.note for figure in found.quantities)


def test_codes_below_zero_are_not_clipped_at_zero() -> None:
    """0.6 DN of noise about −20 DN is measured as it is about 20 DN."""
    codes = np.rint(RNG.normal(RNG.normal(0, 1, (24, 24)), 0.6, (32, 24, 24))).astype(np.int16)
    above, below = (dark_noise([Stack(codes + level, 0.01)]).analogue for level in (20, -20))
    assert below.value == pytest.approx(above.value, rel=1e-6)
    assert below.covers(0.6)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"photons": math.nan}, "photons is NaN or infinite"),
        (
            {"photons": -1.0},
            "photons has shape .* and values from -1; pass photons per pixel of 0",
        ),
        ({"photons": np.ones(3)}, r"photons has shape \(3,\)"),
        ({"photons": "many"}, "photons is not numeric"),
        ({"bits": 12.5}, "bits is 12.5; it must be a whole number from 1 to 32"),
        ({"bits": 0}, "bits is 0; it must be from 1 to 32"),
        ({"bits": 10**5000}, "bits is a whole number of 16610 bits"),
    ],
)
def test_facts_of_a_stack_that_are_none_are_refused(facts: dict[str, Any], said: str) -> None:
    with pytest.raises(ms.InputError, match=said):
        Stack(np.ones((2, 4, 4)), 0.01, **facts)


def test_a_bench_of_frames_of_zeros_has_no_figure_but_notes() -> None:
    """Levels of 2 frames and one of 8, all 0, which are neither signal nor noise."""
    flats = tuple(
        Stack(np.zeros((count, 8, 8), np.uint16), 0.01, photons, bits=8)
        for count, photons in ((2, 100.0), (2, 200.0), (2, 400.0), (8, 300.0))
    )
    dark = Stack(np.zeros((8, 8, 8), np.uint16), 0.01, 0, bits=8)
    (measured,) = ms.lab.measure_bench(Bench((), (dark,), flats))
    for figure in measured.figures.values():
        assert math.isnan(figure.value) and figure.note
