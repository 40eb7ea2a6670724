"""Clipped values are counted, and neither quiet nor small stacks are taken for clipped ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.small_cameras import SmallCamera
from scipy import special

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_noise import dark_noise
from mitsuba_sensor.lab.measure.defects import defects
from mitsuba_sensor.lab.measure.emva_linear import emva_linear
from mitsuba_sensor.lab.measure.line_noise import line_noise
from mitsuba_sensor.lab.measure.nonuniformity import nonuniformity
from mitsuba_sensor.lab.measure.photon_transfer import photon_transfer_of_scene
from mitsuba_sensor.lab.measure.rts_pixels import rts_pixels

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_values_at_the_largest_code_are_counted_whether_the_bits_are_known_or_not(
    bits: int,
) -> None:
    top = 2**bits - 1
    values = np.minimum(top - 20 + 12 * RNG.normal(size=(4, 50, 60)), top).round()
    at_top = np.mean(values == top)
    for frames, known in ((values.astype(np.uint16), bits), (values.astype(np.float32), None)):
        found = Stack(frames, 0.1, bits=known).clipping
        assert found.saturated == at_top > 0.03 and not found.usable
        assert f"largest code {top}" in found.note


@pytest.mark.parametrize("pedestal", [1, 100])
@pytest.mark.parametrize("share", [0.02, 0.26, 0.58])
@pytest.mark.parametrize("kind", ["uint16", "float32"])
def test_a_smallest_code_that_is_not_0_clips_where_noise_piles_up_at_it(
    pedestal: int, share: float, kind: str
) -> None:
    noise = np.random.default_rng(2).normal(size=(8, 96, 96))
    values = np.rint(2.4 * (noise - special.ndtri(share)))
    frames = (np.maximum(values, 0) + pedestal).astype(kind)
    frames[:, 0, :4] = 900  # hot pixels
    found = Stack(frames, 0.1).clipping
    assert found.black == np.mean(frames == pedestal) and f"are {pedestal}:" in found.note


def truth_in_the_dark(camera: SmallCamera) -> dict[str, float]:
    sigma_dn = camera.gain * camera.read_noise_e
    total = math.hypot(sigma_dn, 12**-0.5)
    return {
        "σ_y.dark": total,
        "K·σ_d": sigma_dn,
        "σ_pixel": sigma_dn,
        "DSNU1288": camera.dsnu_dn,
    }


def test_what_clipped_darks_still_show_has_intervals_that_hold_the_truth() -> None:
    """70 cameras of which 0.1 to 60 % of the dark values, or fewer, are at code 0: of the intervals of 95 % that are
    printed fewer than 87 % would hold it once in 1000 times, were they independent."""
    covered, printed = 0, 0
    for number in range(70):
        rng = np.random.default_rng(number)
        share = 10 ** rng.uniform(-5, math.log10(0.6))
        gain, read_noise_e, dsnu_dn = rng.uniform((0.2, 4, 0.5), (1.2, 9, 3))
        black_dn = 0.5 - special.ndtri(share) * math.hypot(gain * read_noise_e, dsnu_dn)
        camera = SmallCamera(
            gain, read_noise_e=read_noise_e, black_dn=black_dn, dsnu_dn=dsnu_dn
        )
        dark = camera.stack(rng, 0.0, 8, (40, 40))
        light = camera.stack(rng, 3000.0, 2, (40, 40))
        figures = [*dark_noise([dark]).quantities, *line_noise(dark).quantities]
        for figure in (*figures, nonuniformity(dark, light).dsnu):
            true = truth_in_the_dark(camera).get(figure.symbol)
            if true is not None and math.isnan(figure.value):
                assert figure.clipped and "black level is too low" in figure.note
            elif true is not None:
                printed, covered = printed + 1, covered + figure.covers(true)
    assert printed > 80 and 0.87 < covered / printed <= 0.99


def test_levels_that_the_adc_clips_are_left_out_of_k_and_of_the_linearity() -> None:
    """A PRNU of 12 % takes the brightest pixels over the end at 70 % of saturation."""
    camera, rng = SmallCamera(gain=0.5, full_well_e=1e5, prnu=0.12), np.random.default_rng(7)
    levels = [camera.stack(rng, photons, 4, (48, 48)) for photons in np.linspace(0, 16_000, 21)]
    found = emva_linear(levels[:1], levels[1:])
    assert found["K"].covers(0.5) and found["LE"].covers(0.0)
    assert "levels with clipped values are left out" in found["LE"].note


def test_hot_pixels_at_the_largest_code_are_counted_as_hot_and_hide_the_noise() -> None:
    dark = SmallCamera(gain=1.0, black_dn=100.0).stack(RNG, 0.0, 8, (64, 64))
    hot = np.random.default_rng(3).random((64, 64)) < 0.004
    seen = Stack(np.where(hot, 4095, dark.frames), 0.01, 0.0, bits=12)
    assert defects(seen).hot_share.value == pytest.approx(100 * hot.mean())
    assert dark_noise([seen]).total.clipped and rts_pixels(seen).fraction.clipped


@pytest.mark.parametrize("sigma", [0.05, 0.3, 1.0, 30.0])
@pytest.mark.parametrize("size", [(1, 4, 5), (2, 20, 24), (8, 96, 96)])
def test_tails_hot_pixels_and_quiet_frames_are_not_clipped(
    sigma: float, size: tuple[int, ...]
) -> None:
    rng = np.random.default_rng(4)
    for level in (200.1, 200.5, 200.9):
        hot = rng.exponential(20, size[1:]) * (rng.random(size[1:]) < 0.02)
        frames = np.rint(level + hot + sigma * rng.normal(size=size)).astype(np.uint16)
        for given in (frames, 16 * frames, 0.5 * frames + 0.25):
            assert Stack(given, 0.1).clipping.share == 0


def test_darkness_that_is_clipped_shows_nothing_unless_longer_exposures_do() -> None:
    """No K of a scene; dark signal lifts longer exposures off code 0, whose variances lead to σ at exposure time 0."""
    camera, rng = SmallCamera(black_dn=1.0), np.random.default_rng(5)
    light = np.linspace(0, 20_000, 160) * np.ones((80, 1))
    scene, black = (camera.stack(rng, photons, 4, (80, 160)) for photons in (light, 0.0))
    for dark in (None, black):
        gain = photon_transfer_of_scene(scene, dark).gain
        assert math.isnan(gain.value) and gain.clipped and "are 0" in gain.note
    camera = SmallCamera(gain=0.5, read_noise_e=9.0, efficiency=1.0, black_dn=3.0)
    stacks = [
        replace(camera.stack(rng, 400.0 * t, 8, (64, 64)), exposure_s=t, photons=0.0)
        for t in (0.0, 1.0, 2.0, 3.0)
    ]
    found = dark_noise(stacks)
    assert found.analogue.covers(4.5) and "0 s left out" in found.analogue.note
    assert dark_noise(stacks[:3]).analogue.clipped
