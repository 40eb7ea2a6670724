"""The shipped real cameras: their frames have the published gain and read noise, and every number has a source."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import ROOT

import mitsuba_sensor as ms
from mitsuba_sensor.sensor.datasheet_errors import fields_of
from mitsuba_sensor.sensor.gains import gain_dn_per_e

PUBLISHED = {  # K [DN/e-] and read noise [e-] as published; where, says [sources] of each camera
    "andor_marana_4_2b_11": (1 / 0.8008, 1.0763),
    "eev_44_82": (1 / 1.8586, 4.0441),
    "eso_efosc2": (1 / 1.18, 11.0),
    "eso_feros": (1 / 2.96, 4.80),
    "hamamatsu_orca_quest_2": (1 / 0.107, 0.43),
    "moravian_c1_5000": (1 / 2.8, 2.2),
    "photometrics_prime_95b": (1 / 0.7678, 1.4658),
    "raspberry_pi_hq": (0.47, 3.0),
    "sony_a7s2": (0.09563, np.sqrt(1.0067395**2 - 0.1391465**2 - 1 / 12) / 0.09563),  # sigGs and sigR [DN]
    "sony_imx174": (1 / 8.16, 6.83),
}
NOT_REAL = {"konnik_table1", "bayer_2mp", "rgbir_2mp"}
"""A sensor of a paper, and two plausible cameras."""
SHAPE = (500, 1000)
"""250 000 or more pixels of one colour: 5 standard errors are 0.7 % of σ and 1.4 % of K."""


def test_every_shipped_camera_is_in_this_list_or_not_real() -> None:
    assert set(ms.list_cameras()) == PUBLISHED.keys() | NOT_REAL and len(PUBLISHED) >= 8


@pytest.mark.parametrize("name", PUBLISHED)
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
        two = ms.expose(np.full(SHAPE, light), camera, ms.Exposure(0.0), frames=2).digital[:, seen].astype(float)
        mean.append(two.mean())
        variance.append(0.5 * np.var(two[0] - two[1]))
    rows_dn2 = (camera.readout.row_noise_e * dn_per_e) ** 2
    measured = (variance[1] - variance[0]) / (mean[1] - mean[0])
    assert measured == pytest.approx(dn_per_e, rel=0.015)
    assert np.sqrt(variance[0] - 1 / 12 - rows_dn2) / dn_per_e == pytest.approx(read_noise_e, rel=0.015)


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_published_camera_has_no_warnings_and_a_source_for_every_number(name: str) -> None:
    """A number that is no default has a source; one that nobody published says "assum(ed|ption)" or why it follows."""
    camera = ms.load_camera(name)
    assert not ms.check_camera(name)
    for dotted in fields_of(ms.Camera):
        table, _, field = dotted.partition(".")
        if not field or "." in field or table in ("sources", "gains"):
            continue
        value = getattr(getattr(camera, table), field)
        info = type(getattr(camera, table)).model_fields[field]
        if isinstance(value, int | float) and not isinstance(value, bool) and value != info.default:
            assert dotted in camera.sources, dotted


def row(name: str) -> str:
    """A line of the table in docs/published-cameras.md."""
    camera = ms.load_camera(name)
    where, noise = camera.sources["adc.full_scale_v"].partition(": ")[0], camera.source_follower.read_noise_e
    numbers = f"{gain_dn_per_e(camera):.4g} | {noise:.4g} | {camera.pixel.full_well_e:.6g} | {camera.adc.bits}"
    return f"| `{name}` | {camera.description} | {numbers} | {where} |"


def test_the_page_of_published_cameras_has_their_numbers() -> None:
    """The table of docs/published-cameras.md is made of the camera files; this prints it when it is not."""
    head = "| camera | what it is | K [DN/e-] | read noise [e-] | full well [e-] | bits | K from |"
    head += "\n|---|---|---|---|---|---|---|"
    table = "\n".join((head, *map(row, sorted(PUBLISHED))))
    page = (ROOT / "docs" / "published-cameras.md").read_text(encoding="utf-8")
    assert table in page, f"\n{table}"
