"""Metering: the time at which a percentile of the pixels is at a share of saturation."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import SCENES, SKY, scene_text, write_scene

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


def test_twice_the_light_takes_half_the_time(light: Any) -> None:
    once, twice = (
        metered(replace(light, data=factor * light.data), CAMERA, ms.Metering()).time_s
        for factor in (1, 2)
    )
    assert once == pytest.approx(
        2 * twice, rel=0.1
    )  # dark current takes its part of the longer time


def test_dark_pixels_and_infinite_ones_do_not_count(light: Any) -> None:
    data = np.concatenate([light.data, 0 * light.data, np.full_like(light.data, np.inf)])
    whole = metered(replace(light, data=data), CAMERA, ms.Metering())
    assert whole == metered(light, CAMERA, ms.Metering())


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


def test_a_converter_that_ends_below_the_full_well_is_the_saturation() -> None:
    half = CAMERA.replace(**{"adc.full_scale_v": 0.5 * 33000 * 5e-6})
    assert saturation_e(half) < 0.6 * WELL < saturation_e(CAMERA) <= WELL


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


def test_dark_frames_that_dark_current_fills_are_saved_with_the_reason(
    light: Any, tmp_path: Path
) -> None:
    """Nothing can be metered there, and of infinite light no time is short enough."""
    hot = ms.expose(np.zeros((4, 4)), CAMERA, ms.Exposure(1000.0, 400.0))
    hot.save(tmp_path / "out")
    (note,) = json.loads((tmp_path / "out" / "frame.json").read_text("utf-8"))["notes"]
    assert note.startswith(
        "100% of the pixels are saturated at 1000 s; dark current alone makes 1.03e+09 e-"
    )
    infinite = replace(
        light, data=np.where(np.arange(16)[:, None] % 2, light.data, np.inf).astype(np.float32)
    )
    metered_s = metered(infinite, CAMERA, ms.Metering()).time_s
    way_out = f"; {metered_s:g} s is metered (--exposure-s {metered_s:g})"
    for exposure, said in ((ms.Exposure(0.01), ""), (ms.Exposure(10.0), way_out)):
        notes = ms.capture(infinite, CAMERA, exposure).metadata["notes"]
        assert any(
            note.endswith(f"of the pixels are saturated at {exposure.time_s:g} s{said}")
            for note in notes
        )


def test_black_light_and_numbers_out_of_range_are_refused(light: Any) -> None:
    with pytest.raises(ms.InputError, match="darkness is at the highest code of konnik_table1"):
        metered(light, CAMERA.replace(**{"adc.black_level_dn": 4095}), ms.Metering())
    with pytest.raises(ms.InputError, match="no pixel has any light"):
        metered(replace(light, data=0 * light.data), CAMERA, ms.Metering())
    with pytest.raises(ms.InputError, match=r"1e\+30 electrons or more in 1 s.*the unit of"):
        metered(replace(light, data=1e24 + 0 * light.data), CAMERA, ms.Metering())
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


def test_frames_with_a_render_each_have_one_exposure(tmp_path: Path) -> None:
    frames = ms.render_frames(
        write_scene(tmp_path, scene_text(SKY)), CAMERA, "auto", frames=2, **SMALL
    )
    times = {one.frames.first.exposure.time_s for one in frames}
    assert len(times) == 1 and 0.3 < times.pop() < 10


def test_a_white_picture_is_told_the_time_that_metering_finds(tmp_path: Path) -> None:
    path = write_scene(tmp_path, scene_text(SKY))
    metered_s = ms.capture(path, CAMERA, **SMALL).frames.first.exposure.time_s
    white = ms.capture(path, CAMERA, ms.Exposure(10.0), **SMALL)
    way_out = f"{metered_s:g} s is metered (--exposure-s {metered_s:g})"
    assert f"100% of the pixels are saturated at 10 s; {way_out}" in white.frames.notes


def test_auto_of_the_command_line_and_of_the_scene_file(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """--exposure-s overrules the file's exposure_s, which may be "auto" or a <default> that nothing uses."""
    named = '<default name="exposure_s" value="0.02"/>'
    path, options = (
        write_scene(tmp_path, scene_text(named, SKY)),
        ("--spp", 16, "--wavelength-nm", 550),
    )
    times = []
    for more in (
        (),
        ("-D", "exposure_s=0.03"),
        ("-D", "exposure_s=auto"),
        ("--exposure-s", "auto"),
    ):
        done = cli(
            "render",
            path,
            "-o",
            tmp_path / "out",
            "--json",
            "--variant",
            "scalar_spectral",
            *options,
            *more,
        )
        times.append(json.loads(done.stdout)["exposure"]["time_s"])
    assert times[:2] == [0.02, 0.03] and times[2] == times[3] > 0.1
    assert (
        "give seconds, e.g. 0.001, or auto"
        in cli("render", path, "-o", tmp_path / "o", "--exposure-s", "1ms").stderr
    )
    wrong = cli("lint", path, "-D", "exposure_s=soon", "--variant", "scalar_spectral")
    assert wrong.exit_code == 2 and "time_s is 'soon'" in wrong.stderr


def test_the_percentile_and_share_asked_for_are_those_of_the_picture(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """Of command line, scene file and Python alike; --meter overrules a time in the scene file."""
    timed = scene_text('<default name="exposure_s" value="0.02"/>', SKY)
    film = photosensor('<string name="meter" value="20:0.3"/>')
    options = ("--spp", 16, "--wavelength-nm", 550, "--variant", "scalar_spectral", "--json")
    found = []
    for text, more in ((film, ()), (timed, ("--meter", "20:0.3"))):
        path = write_scene(tmp_path, text)
        done = cli("render", path, "-o", tmp_path / "out", *options, *more)
        found.append(json.loads(done.stdout)["origin"]["metering"])
    light = ms.render(path, CAMERA, ms.Metering(percentile=20, share=0.3), **SMALL)
    assert found[0] == found[1] == light.statistics.metering
    time_s = found[0]["exposure_s"]
    level = electrons(light, CAMERA, ms.Exposure(time_s))
    assert np.percentile(level, 20) == pytest.approx(0.3 * saturation_e(CAMERA), rel=0.01)
    again = cli(
        "expose",
        tmp_path / "out" / "irradiance.exr",
        "-o",
        tmp_path / "b",
        "--meter",
        "20:0.15",
        "--json",
    )
    assert json.loads(again.stdout)["exposure"]["time_s"] == pytest.approx(time_s / 2, rel=0.01)


def test_auto_is_metered_as_the_scene_says_and_at_its_temperature(tmp_path: Path) -> None:
    """In Python as on the command line, and of light at the temperature that it was rendered for; Metering() of one's
    own overrules both."""
    settings = '<string name="meter" value="20:0.3"/><float name="temperature_k" value="250"/>'
    path = write_scene(tmp_path, photosensor(settings))
    by_scene, auto, own = (
        ms.render(path, None, asked, **SMALL) for asked in (None, "auto", ms.Metering())
    )
    assert auto.statistics.metering == by_scene.statistics.metering
    assert (
        auto.statistics.metering["percentile"] == 20
        and own.statistics.metering["percentile"] == PERCENTILE
    )
    assert (
        auto.rendered_for.exposure == by_scene.rendered_for.exposure
        and auto.rendered_for.exposure.temperature_k == 250
    )
    assert ms.expose(auto, exposure="auto").first.exposure.temperature_k == 250
    assert ms.expose(auto, exposure=ms.Metering()).first.exposure.temperature_k == 298.15


@pytest.mark.parametrize(
    ("flags", "film", "says"),
    [
        (("--meter", "95"), "", "meter is '95'; give PERCENTILE:SHARE"),
        (("--meter", "95:0.7:1"), "", "e.g. 95:0.7"),
        (("--meter", "101:0.7"), "", "percentile"),
        (("--meter", "95:70"), "", "share"),
        (("--meter", "0.95:0.7"), "", "percentile is 0.95; it must be from 1 to 100"),
        (("--meter", "nan:0.7"), "", "percentile"),
        (
            ("--meter", "95:0.7", "--exposure-s", "0.1"),
            "",
            "--exposure-s 0.1 gives the time that --meter 95:0.7",
        ),
        ((), '<string name="meter" value="soon"/>', "meter is 'soon'"),
        (
            (),
            '<string name="meter" value="95:0.7"/><float name="exposure_s" value="0.1"/>',
            "leave one of them out",
        ),
        ((), '<float name="meter" value="95"/>', "meter is 95.0"),
    ],
)
def test_a_metering_that_cannot_be_is_refused(
    tmp_path: Path, cli: Callable[..., Any], flags: tuple[str, ...], film: str, says: str
) -> None:
    path = write_scene(tmp_path, photosensor(film))
    done = cli("render", path, "-o", tmp_path / "out", "--variant", "scalar_spectral", *flags)
    assert done.exit_code == 2 and says in done.stderr and not (tmp_path / "out").exists()


def test_every_shipped_scene_names_its_exposure() -> None:
    """The first frame of the README is metered; a street at night is exposed as by hand."""
    for path in sorted(SCENES.glob("*.xml")):
        others = {"first_frame": "auto", "night_crossing": "0.025", "polarisation": "0.01"}
        time_s = others.get(path.stem, "0.1")
        assert f'name="exposure_s" value="{time_s}"' in path.read_text(encoding="utf-8"), (
            path.name
        )
