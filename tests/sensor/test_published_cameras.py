"""The shipped real cameras have the published gain and read noise, and every number has a source."""

from __future__ import annotations

import math

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.camera.datasheet_errors import fields_of

PUBLISHED = {  # K [DN/e-] and read noise [e-] as published, by gain setting; where, says [sources] of each camera
    "andor_marana_4_2b_11": {None: (1 / 0.8008, 1.0763)},
    "eev_44_82": {None: (1 / 1.8586, 4.0441)},
    "eso_efosc2": {None: (1 / 1.18, 11.0)},
    "eso_feros": {
        "normal": (1 / 2.96, 4.80), "slow": (1 / 1.03, 2.67), "fast": (1 / 2.56, 6.48)
    },
    "hamamatsu_orca_quest_2": {
        "standard": (1 / 0.107, 0.43), "ultra quiet": (1 / 0.107, 0.30)
    },
    "moravian_c1_5000": {"0 dB": (1 / 2.8, 2.2), "24 dB": (1 / 0.3, 2.0)},
    "photometrics_prime_95b": {None: (1 / 0.7678, 1.4658)},
    "proem_hs_1024b": {None: (100 / 3.96, 36.58 / 100)},  # at an EM gain of 100
    "raspberry_pi_hq": {"1": (0.47, 3.0), "16": (0.47 * 16, 1.5)},
    "sony_a7s2": {
        "100": (0.09563, math.sqrt(1.0067395**2 + 0.1391465**2 - 1 / 12) / 0.09563),
        "25600": (24.48128, math.sqrt(25.853043**2 + 2.2760193**2 - 1 / 12) / 24.48128),
    },
    "sony_imx174": {None: (1 / 8.16, 6.83)},
    "sony_imx990": {None: (1 / 30, 150.0)},  # its K is assumed, and says so
    "sony_imx250mzr": {None: (1 / 2.8, 2.2)},  # of the IMX250
}  # fmt: skip


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_published_camera_has_its_gain_and_read_noise_at_every_setting(name: str) -> None:
    """Frames have what emva1288() says (test_figures.py); where that is sampled, within 1.5 %."""
    for setting, (dn_per_e, read_noise_e) in PUBLISHED[name].items():
        camera = ms.load_camera(name)
        figures = (camera if setting is None else camera.at_gain(setting)).emva1288()
        assert figures.system_gain_dn_per_e == pytest.approx(dn_per_e, rel=1e-3)
        assert figures.temporal_dark_noise_e == pytest.approx(read_noise_e, rel=0.015)


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
