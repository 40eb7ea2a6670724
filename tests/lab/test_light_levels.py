"""Light that is not what is stated: a level that is off is named, photons in another unit are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.small_cameras import SmallCamera

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.emva_linear import emva_linear
from mitsuba_sensor.lab.measure.radiometric import stray_levels

CAMERA = SmallCamera()
TRUE = {"K": 0.3, "η": 0.6, "R": 0.18}


def bench_with_stack(stated: float) -> tuple[list[Stack], list[Stack]]:
    """Pairs at 30 levels and 60 frames at half saturation, whose photons are stated times a factor."""
    rng = np.random.default_rng(1)
    darks, flats = CAMERA.bench(rng, 2, (48, 48), 30)
    half = CAMERA.stack(rng, 8300.0, 60, (48, 48))
    spatial = replace(half, photons=stated * 8300.0, source="spatial.npy")
    return darks, [*flats, spatial]


@pytest.mark.parametrize("stated", [1.0, 1.04, 0.2])
def test_a_stack_of_many_frames_with_wrong_photons_rules_no_temporal_figure(
    stated: float,
) -> None:
    """Sixty frames weigh as thirty pairs; LE was 16 % instead of 0.3 in a reference set of EMVA 1288."""
    found = emva_linear(*bench_with_stack(stated))
    for symbol, true in TRUE.items():
        assert found[symbol].covers(true), str(found[symbol])
    assert found["LE"].value < 0.15
    (note,) = found.notes
    assert "spatial.npy (60 frames," in note and "% off these" in note
    if stated != 1:
        assert f"{100 / stated - 100:+.2g} % off" in note


@pytest.mark.parametrize(("level", "factor"), [(4, 1.05), (12, 0.9), (17, 1.02), (9, 3.0)])
def test_a_level_with_other_light_than_stated_is_named_and_left_out(
    level: int, factor: float
) -> None:
    darks, flats = CAMERA.bench(np.random.default_rng(2), 2, (48, 48), 30)
    flats[level] = replace(
        flats[level], photons=factor * float(flats[level].photons or 0), source="stray.npy"
    )
    found = emva_linear(darks, flats)
    for symbol in ("η", "R"):
        assert found[symbol].covers(TRUE[symbol]), str(found[symbol])
        assert "stray.npy is" in found["R"].note and "% off the others" in found["LE"].note
    assert found["LE"].value < 0.15


def test_no_level_of_light_that_scatters_or_of_a_curved_response_is_off() -> None:
    """200 sets of 25 levels: scatter of 0.01 to 3 % and curves of 0 to 5 %; light in equal and in growing steps."""
    rng = np.random.default_rng(3)
    for number in range(200):
        light = (np.linspace, np.geomspace)[number % 2](0.05, 0.7, 25)
        scatter, curve = 10 ** rng.uniform(-4, -1.5), rng.uniform(-0.05, 0.05)
        signal = 3000 * light * (1 + curve * light) * (1 + scatter * rng.normal(size=25))
        assert not stray_levels(light, signal, np.full(25, 0.1))
