"""The shipped real cameras: their frames have the published gain and read noise, and every number has a source."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.camera.datasheet_errors import fields_of
from mitsuba_sensor.camera.figures import saturation_e
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_noise import dark_noise

PUBLISHED = {  # K [DN/e-] and read noise [e-] as published; where, says [sources] of each camera
    "andor_marana_4_2b_11": (1 / 0.8008, 1.0763),
    "eev_44_82": (1 / 1.8586, 4.0441),
    "eso_efosc2": (1 / 1.18, 11.0),
    "eso_feros": (1 / 2.96, 4.80),
    "hamamatsu_orca_quest_2": (1 / 0.107, 0.43),
    "moravian_c1_5000": (1 / 2.8, 2.2),
    "photometrics_prime_95b": (1 / 0.7678, 1.4658),
    "proem_hs_1024b": (100 / 3.96, 36.58 / 100),  # at an EM gain of 100
    "raspberry_pi_hq": (0.47, 3.0),
    "sony_a7s2": (0.09563, np.sqrt(1.0067395**2 - 1 / 12) / 0.09563),  # sigGs [DN]
    "sony_imx174": (1 / 8.16, 6.83),
    "sony_imx990": (1 / 30, 150.0),  # its K is assumed, and says so
    "sony_imx250mzr": (1 / 2.8, 2.2),  # of the IMX250
}
EMCCDS = ("proem_hs_1024b",)
"""Whose shot noise is multiplied, too: test_em_gain.py has what their frames show."""
LADDERS = {  # K [DN/e-] and temporal dark noise without rounding [e-] of every gain setting, as published
    "eso_feros": {
        "normal": (1 / 2.96, 4.80),
        "slow": (1 / 1.03, 2.67),
        "fast": (1 / 2.56, 6.48),
    },
    "hamamatsu_orca_quest_2": {"standard": (1 / 0.107, 0.43), "ultra quiet": (1 / 0.107, 0.30)},
    "moravian_c1_5000": {"0 dB": (1 / 2.8, 2.2), "24 dB": (1 / 0.3, 2.0)},
    "raspberry_pi_hq": {"1": (0.47, 3.0), "16": (0.47 * 16, 1.5)},
}
PMN = {  # ISO → Kmax [DN/e-], sigGs, sigR [DN]: normal law of the pixels, and of the rows, instead of the file's sigTL
    "100": (0.09563, 1.0067395, 0.1391465),
    "200": (0.19126, 1.2926387, 0.22815849),
    "400": (0.38252, 2.0595572, 0.36209714),
    "800": (0.76504, 3.5475867, 0.5723769),
    "1600": (1.53008, 6.29925, 0.988786),
    "2000": (1.9126, 2.653871, 0.33124214),
    "3200": (3.06016, 3.9193838, 0.44543457),
    "6400": (6.12032, 7.1163535, 0.7218788),
    "12800": (12.24064, 14.245901, 1.2749791),
    "25600": (24.48128, 25.853043, 2.2760193),
}
LADDERS["sony_a7s2"] = {
    iso: (k, np.sqrt(g**2 + r**2 - 1 / 12) / k) for iso, (k, g, r) in PMN.items()
}
STEP = "1600", "2000"
"""Gain settings between which the α7S II changes its conversion gain."""
SHAPE = (500, 1000)
"""250 000 or more pixels of one colour: 5 standard errors are 0.7 % of σ and 1.4 % of K."""


@pytest.mark.parametrize("name", one_in(3, [name for name in PUBLISHED if name not in EMCCDS]))
def test_frames_of_a_published_camera_have_its_gain_and_read_noise(name: str) -> None:
    """Two frames in darkness and at 30 % of the well: photon transfer, K = Δσ²/Δμ, σ of darkness over K."""
    dn_per_e, read_noise_e = PUBLISHED[name]
    camera = ms.load_camera(name).replace(**{"pixel.prnu": 0.0})
    section = camera.quantum_efficiency
    qe = camera.qe([section.reference_nm])[:, 0]
    level = 0.3 * camera.pixel.full_well_e / qe.max()
    seen = camera.filter_index(SHAPE) == qe.argmax()
    mean, variance = [], []
    for light in (0.0, level):
        two = (
            ms.expose(np.full(SHAPE, light), camera, ms.Exposure(0.0), frames=2)
            .digital[:, seen]
            .astype(float)
        )
        mean.append(two.mean())
        variance.append(0.5 * np.var(two[0] - two[1]))
    rows_dn2 = (camera.readout.row_noise_e * dn_per_e) ** 2
    measured = (variance[1] - variance[0]) / (mean[1] - mean[0])
    assert measured == pytest.approx(dn_per_e, rel=0.015)
    assert np.sqrt(variance[0] - 1 / 12 - rows_dn2) / dn_per_e == pytest.approx(
        read_noise_e, rel=0.015
    )


def stack(camera: ms.Camera, share: float) -> Stack:
    """Two frames of a share of the saturation, of the pixels of one colour; noise of its own at every share."""
    photons = (
        share * saturation_e(camera) / camera.qe([camera.quantum_efficiency.reference_nm]).max()
    )
    options: Any = {"frames": 2, "seed": round(1000 * share), "engine": "numpy"}
    frames = ms.expose(
        np.full((400, 800), photons), camera, ms.Exposure(0.0), **options
    ).digital
    of_green = frames[:, ::2, 1::2] if len(camera.filter_names) > 1 else frames
    return Stack(of_green, 0.0, photons, bits=camera.adc.bits)


@pytest.mark.parametrize("name", one_in(3, LADDERS))
def test_temporal_dark_noise_at_every_setting_is_the_published_one(name: str) -> None:
    """80 000 pixels show σ to 0.25 %. At the step of the α7S II it falls from 4.17 to 1.40 e-."""
    found = {}
    for setting, (dn_per_e, noise_e) in LADDERS[name].items():
        total_dn = dark_noise([stack(ms.load_camera(name).at_gain(setting), 0.0)]).total.value
        assert total_dn == pytest.approx(
            np.sqrt((dn_per_e * noise_e) ** 2 + 1 / 12), rel=0.02
        ), setting
        found[setting] = total_dn / dn_per_e
    if name == "sony_a7s2":
        high, low = (np.hypot(*PMN[iso][1:]) / PMN[iso][0] for iso in STEP)
        assert (
            found["1600"] / found["2000"] == pytest.approx(high / low, rel=0.02)
            and high / low > 2.9
        )


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_published_camera_has_no_warnings_and_a_source_for_every_number(name: str) -> None:
    """A number that is no default has a source; one that nobody published says "assum(ed|ption)" or why it follows."""
    camera = ms.load_camera(name)
    assert not ms.check_camera(name) and bool(camera.gains) == ("gains" in camera.sources)
    for dotted in fields_of(ms.Camera):
        table, _, field = dotted.partition(".")
        if not field or "." in field or table in ("sources", "gains"):
            continue
        value = getattr(getattr(camera, table), field)
        info = type(getattr(camera, table)).model_fields[field]
        if (
            isinstance(value, int | float)
            and not isinstance(value, bool)
            and value != info.default
        ):
            assert dotted in camera.sources, dotted
