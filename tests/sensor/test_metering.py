"""Metering: the time at which a percentile of the pixels is at a share of saturation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.camera.figures import saturation_e
from mitsuba_sensor.render.light.photons import metered
from mitsuba_sensor.sensor.metering import PERCENTILE, SHARE
from mitsuba_sensor.stages.effects.dark_current import mean_dark_e

CAMERA = ms.load_camera("konnik_table1")
WELL = CAMERA.pixel.full_well_e
SMALL = {"spp": 16, "wavelength_nm": 550, "variant": "scalar_spectral"}


def photosensor(film: str) -> str:
    """A scene whose film names the camera, and this."""
    text = scene_text(SKY, film=f'<string name="camera" value="konnik_table1"/>{film}')
    return text.replace("hdrfilm", "photosensor")


def electrons(light: Any, camera: ms.Camera, exposure: ms.Exposure) -> np.ndarray:
    """Mean electrons of light and dark current."""
    frames = ms.expose(ms.collect(light, camera, exposure), camera, exposure)
    return frames.detected.mean_e + mean_dark_e(camera, exposure)


@pytest.mark.parametrize(
    ("percentile", "share"), [(PERCENTILE, SHARE), (50.0, 0.3), (100.0, 1.0)]
)
def test_the_percentile_of_the_pixels_stands_at_the_share_of_saturation(
    light: Any, percentile: float, share: float
) -> None:
    """Times have three digits: within 0.5 %."""
    exposure = metered(light, CAMERA, ms.Metering(percentile=percentile, share=share))
    level = np.percentile(electrons(light, CAMERA, exposure), percentile)
    assert level == pytest.approx(share * saturation_e(CAMERA), rel=0.005)
    assert float(f"{exposure.time_s:.3g}") == exposure.time_s


def test_dark_current_fills_the_well_too(light: Any) -> None:
    """At 400 K, in light a million times weaker: what light and dark current make together is at the share."""
    dim, hot = (
        replace(light, data=light.data * np.float32(1e-6)),
        ms.Metering(temperature_k=400.0),
    )
    exposure = metered(dim, CAMERA, hot)
    frames = ms.expose(
        ms.collect(dim, CAMERA, exposure),
        CAMERA,
        exposure,
        keep=("electrons", "dark_electrons"),
    )
    assert frames.dark_electrons.mean() > 0.9 * frames.electrons.mean()
    assert np.median(frames.electrons) == pytest.approx(SHARE * WELL, rel=0.1)


@pytest.mark.parametrize(
    "curves",
    [
        {"readout.ve_nonlinearity": 0.4, "readout.v_ref_v": 0.2},
        {"source_follower.vv_nonlinearity": 0.9},
        {"source_follower.vv_nonlinearity": 1.1},
        {"adc.gamma": 1.1, "adc.full_scale_v": 0.12},
    ],
)
def test_saturation_is_where_the_codes_end_also_of_a_curved_response(
    curves: dict[str, float],
) -> None:
    """The median of 4096 pixels: 1 % below it under the highest code, 1 % above it there; its error is 0.02 %."""
    camera = CAMERA.replace(**{"adc.full_scale_v": 0.1, **curves})
    photons = saturation_e(camera) / float(camera.qe(np.array([550.0]), np.ones(1))[0, 0])
    below, above = (
        np.median(
            ms.expose(
                np.full((64, 64), factor * photons),
                camera,
                ms.Exposure(0.0),
                wavelengths_nm=550,
            ).digital
        )
        for factor in (0.99, 1.01)
    )
    highest = 2**camera.adc.bits - 1
    assert above == highest and 0.97 * highest < below < highest


def test_black_light_and_numbers_out_of_range_are_refused(light: Any) -> None:
    with pytest.raises(ms.InputError, match="black level of konnik_table1 is at or above"):
        metered(light, CAMERA.replace(**{"adc.black_level_dn": 4095}), ms.Metering())
    with pytest.raises(ms.InputError, match="no pixel has any light"):
        metered(replace(light, data=0 * light.data), CAMERA, ms.Metering())
    with pytest.raises(ms.InputError, match=r"1e\+30 electrons or more in 1 s.*the unit of"):
        metered(replace(light, data=1e24 + 0 * light.data), CAMERA, ms.Metering())
    assert ms.Metering(50, 0.3) == ms.Metering(percentile=50.0, share=0.3)
    for wrong in ({"percentile": 101.0}, {"share": 0.0}, {"temperature_k": -1.0}):
        with pytest.raises(ms.InputError, match="it must be"):
            ms.Metering(**wrong)
    with pytest.raises(ms.InputError, match="exposure is 'bright'"):
        ms.capture(light, CAMERA, "bright")  # type: ignore[arg-type]


def test_a_scene_that_names_no_exposure_is_metered_however_bright(tmp_path: Path) -> None:
    """A sky of 3 W/(m² sr nm), which is white at 0.1 s: 0.7 of saturation, and frame.json says so."""
    sky = '<emitter type="constant"><spectrum name="radiance" value="3"/></emitter>'
    path = write_scene(tmp_path, scene_text(sky))
    found = ms.capture(path, CAMERA, **SMALL)
    level = electrons(found.light, CAMERA, found.frames.first.exposure)
    assert np.percentile(level, PERCENTILE) == pytest.approx(
        SHARE * saturation_e(CAMERA), rel=0.01
    )
    record = found.metadata["origin"]["metering"]
    assert record == found.light.statistics.metering
    assert (
        record["exposure_s"]
        == found.metadata["exposure"]["time_s"]
        == found.frames.first.exposure.time_s
    )
    assert record["percentile"] == PERCENTILE and record["share_of_saturation"] == SHARE
    assert not any("saturated" in note for note in found.metadata["notes"])
    again = ms.capture(found.light, CAMERA, "auto")
    assert (again.frames.digital == found.frames.digital).all()
    given = ms.capture(path, CAMERA, ms.Exposure(record["exposure_s"]), **SMALL)
    assert (given.frames.digital == found.frames.digital).all() and given.metadata["origin"][
        "metering"
    ] is None
    assert given.light.statistics.noise_ratio_p95 == pytest.approx(
        found.light.statistics.noise_ratio_p95, rel=1e-3
    )


@pytest.mark.parametrize(
    "more",
    [
        {"noise_ratio": 10.0, "spp": None},
        {"motion": {"camera": {"velocity_m_per_s": [1, 0, 0]}}},
    ],
)
def test_where_the_exposure_decides_what_is_rendered_a_short_render_is_metered_first(
    tmp_path: Path, more: dict[str, Any]
) -> None:
    path = write_scene(
        tmp_path,
        scene_text(
            SKY, '<shape type="sphere"><point name="center" z="4" x="0" y="0"/></shape>'
        ),
    )
    still = ms.capture(path, CAMERA, "auto", **SMALL).metadata["exposure"]["time_s"]
    found = ms.capture(path, CAMERA, "auto", **{**SMALL, **more})
    assert found.metadata["exposure"]["time_s"] == pytest.approx(still, rel=0.05)
