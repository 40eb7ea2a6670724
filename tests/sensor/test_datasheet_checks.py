"""Checks across the tables of a datasheet: what a CCD cannot have, and products of gains."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.stages.chain import ORDER
from mitsuba_sensor.stages.gains import full_scale_v, gain_dn_per_e

TABLE1, CCD = ms.load_camera("konnik_table1"), ms.load_camera("eev_44_82")
CMOS_ONLY: dict[str, Any] = {
    "readout.dsnu_col": 0.01, "readout.dsnu_row": 0.01, "pixel.dsnu_e": 330.0, "readout.prnu_col": 0.01,
    "readout.reset": "hard", "readout.ktc_residual": 0.5, "source_follower.rtn_uv": 200.0,
    "source_follower.rtn_pixel_fraction": 0.01,
}  # fmt: skip


@pytest.mark.parametrize("field", CMOS_ONLY)
def test_a_ccd_refuses_what_only_a_cmos_sensor_has_with_value_reason_and_way_out(
    field: str,
) -> None:
    """It used to leave them out: 330 e- of pixel offsets were no offsets at all."""
    value = CMOS_ONLY[field]
    with pytest.raises(ms.InputError) as caught:
        CCD.replace(**{field: value})
    message = str(caught.value)
    assert (
        f"{field} is {value!r}, and sensor.technology is 'ccd': all pixels of a CCD have one amplifier"
        in message
    )
    assert f"set {field} to " in message and message.endswith("or sensor.technology to 'cmos'.")
    assert TABLE1.replace(**{field: value}).sensor.technology == "cmos"


def test_a_soft_reset_and_several_fields_at_once_are_refused_in_one_sentence() -> None:
    with pytest.raises(
        ms.InputError,
        match=r"readout\.reset is 'soft' and readout\.dsnu_col is 0\.001, and .*true_cds'",
    ):
        TABLE1.replace(**{"sensor.technology": "ccd", "readout.reset": "soft"})


def test_the_values_that_mean_none_are_those_of_a_ccd() -> None:
    """Every refused field set to what the sentence proposes makes the chain that the shipped camera has."""
    none = {
        f"{effect.table}.{name}": value
        for effect in ORDER
        for name, value in (effect.fields.cmos_only.items() if effect.fields else ())
    }
    assert set(CMOS_ONLY) <= set(none)
    assert CCD.replace(**none).stages == CCD.stages


@pytest.mark.parametrize("name", ms.list_cameras())
def test_every_shipped_camera_is_one_that_the_checks_accept(name: str) -> None:
    assert ms.load_camera(name).stages


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            {"source_follower.gain": 1e30, "readout.cds_gain": 1e30},
            r"make 1\.65e\+59 V of a full well of 33000 e-",
        ),
        (
            {"readout.sense_gain_uv_per_e": 1e30, "source_follower.gain": 1e5},
            r"make 3\.3e\+33 V of a full well",
        ),
        (
            {"pixel.full_well_e": 1e30, "readout.sense_gain_uv_per_e": 1e7},
            r"make 1e\+31 V of a full well of 1e\+30",
        ),
        (
            {"adc.full_scale_v": 1e-30, "readout.sense_gain_uv_per_e": 1e4},
            r"make 4\.1e\+31 DN of one electron",
        ),
    ],
    ids=str,
)
def test_a_product_of_gains_beyond_1e30_is_refused_with_the_camera(
    change: dict[str, float], sentence: str
) -> None:
    """Each field is in its range. The frame was 0 or NaN, or an overflow somewhere in the theory."""
    with pytest.raises(ms.InputError, match=rf"{sentence}.*at most 1e\+30"):
        TABLE1.replace(**change)


@pytest.mark.parametrize(
    "field", ["source_follower.gain", "readout.cds_gain", "readout.sense_gain_uv_per_e"]
)
@pytest.mark.parametrize("value", [1e-30, 1e-10, 1e10, 1e30])
def test_one_gain_at_the_end_of_its_range_gives_the_frame_of_any_other(
    field: str, value: float
) -> None:
    """V_FS follows the gains, and so do noise and offsets given in electrons: codes differ by rounding at most."""
    quiet = TABLE1.replace(
        **{
            "source_follower.white_nv_per_rthz": None,
            "source_follower.read_noise_e": 6.0,
            "adc.black_level_dn": 64.0,
        }
    )
    camera, light = quiet.replace(**{field: value}), np.linspace(0, 60_000, 200)[None]
    assert (
        gain_dn_per_e(camera) == pytest.approx(gain_dn_per_e(quiet), rel=1e-12)
        and full_scale_v(camera) > 0
    )
    one, other = (
        ms.expose(light, x, ms.Exposure(0.1), precision="float64").digital.astype(int)
        for x in (camera, quiet)
    )
    assert np.abs(one - other).max() <= 1
