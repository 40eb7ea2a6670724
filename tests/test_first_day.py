"""What a stranger types in Python on his first day: names in place of objects, words of his own, shapes, printing."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.marks import exhaustive, one_in
from helpers.scenes import SCENES
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.render.light.statistics import RenderStatistics
from mitsuba_sensor.render.variants import mitsuba

NAME, EXPOSURE = "sony_imx174", ms.Exposure(0.01)
CAMERA = ms.load_camera(NAME)
PHOTONS = np.full((4, 6), 300.0)
FLAT = SCENES / "flat_field.xml"
QUICK: Any = {"spp": 2, "width": 8, "wavelength_nm": 550, "denoise": False}

CALLS: dict[str, Callable[[Any], Any]] = {
    "expose": lambda camera: ms.expose(PHOTONS, camera, EXPOSURE).digital,
    "stream": lambda camera: next(ms.stream(PHOTONS, camera, EXPOSURE)),
    "Sensor": lambda camera: ms.Sensor(camera).expose(PHOTONS, EXPOSURE).digital,
    "plan": lambda camera: ms.plan(camera, EXPOSURE, PHOTONS).to_dict()["stages"],
    "fpn_maps": lambda camera: ms.fpn_maps(camera, (3, 4))["prnu"],
    "collect": lambda camera: ms.collect(PHOTONS * 1e-6, camera, EXPOSURE).mean,
    "light_from_rgb": lambda camera: (
        ms.light_from_rgb(np.ones((2, 2, 3)), camera, unit="cd_per_m2").data
    ),
    "render": lambda camera: ms.render(FLAT, camera, EXPOSURE, **QUICK).data,
    "capture": lambda camera: ms.capture(FLAT, camera, EXPOSURE, **QUICK).frames.digital,
}


@pytest.mark.parametrize("name", one_in(3, CALLS))
def test_the_name_of_a_camera_stands_for_it(name: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(CAMERA.to_toml(), encoding="utf-8")
    by_object, by_name, by_file = (CALLS[name](camera) for camera in (CAMERA, NAME, file))
    np.testing.assert_array_equal(by_name, by_object)
    np.testing.assert_array_equal(by_file, by_object)


def facts_of(frames: ms.Frames) -> dict[str, Any]:
    """What is compared of frames that have no metadata."""
    return {"K_dn_per_e": frames.camera.system_gain_dn_per_e, "notes": frames.notes}


def test_a_named_camera_is_that_camera_everywhere_and_tells_what_the_scene_had(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """`first_frame` sets the full scale of the converter of bayer_2mp: K is 5.016 DN/e- there, and 0.1253 of the camera
    by its name, from the scene or from its light, in Python and on the command line."""
    out, name, changed = tmp_path / "out", "bayer_2mp", {"adc.full_scale_v": 0.5}
    small: Any = {"width": 8, "spp": 2, "denoise": False}
    own = ms.capture("first_frame", **small)
    own.save(out)
    light = out / "irradiance.exr"
    camera = ms.load_camera(name)
    found = {
        "scene": ms.capture("first_frame", name, **small).metadata,
        "light": ms.capture(light, name).metadata,
        "expose": facts_of(ms.expose(own.light, name)),
    }
    own.save(out)
    argv = ("expose", light, "-o", tmp_path / "again", "--camera", name, "--json")
    found["expose -"] = json.loads(cli(*argv).stdout)
    for how, report in found.items():
        assert report["K_dn_per_e"] == camera.system_gain_dn_per_e, how
        told = [n for n in report["notes"] if n.startswith("ignored the scene's adc.full_sc")]
        assert len(told) == 1, (how, report["notes"])
    assert own.frames.camera.system_gain_dn_per_e > 30 * camera.system_gain_dn_per_e
    asked = ms.capture(light, camera.replace(**changed))
    for one in (own, ms.capture(light), asked):
        assert not any("ignored the scene's" in note for note in one.frames.notes)


def test_a_named_camera_leaves_view_exposure_and_seeds_to_the_scene() -> None:
    """`one_file` is exposed 0.1 s, chip 1, through f/2.8; eev_44_82 is f/2 and has another pixel."""
    with warnings.catch_warnings(action="ignore", category=ms.SensorWarning):
        found = ms.capture("one_file", "eev_44_82", width=8, spp=2, denoise=False)
    assert found.metadata["exposure"] == {"time_s": 0.1, "temperature_k": 298.15}
    assert found.frames.camera.lens == ms.load_camera("eev_44_82").lens
    own = ms.capture("one_file", width=8, spp=2, denoise=False)
    assert own.frames.camera.lens.f_number == 2.8
    assert found.light.data.shape[:2] == own.light.data.shape[:2]


@pytest.mark.parametrize(("share", "stops"), [(0.9, 0), (0.3, 0), (0.1, 2), (0.01, 5)])
def test_a_dark_frame_has_a_picture_beside_it_that_is_brighter_and_says_by_how_much(
    share: float, stops: int, tmp_path: Path
) -> None:
    """Half of white is passed by less than a stop: 0.5/0.1 = 5, 2 stops. The caption is below the picture."""
    frames = ms.expose(np.full((40, 90), 1.0), CAMERA, EXPOSURE)
    white_dn, black_dn = 4095, frames.stages[-1].black_level_dn
    code = round(black_dn + share * (white_dn - black_dn))
    frames = replace(frames, digital=np.full((1, 40, 90), code, np.uint16))
    frames.save(tmp_path)
    summary = json.loads((tmp_path / "frame.json").read_text("utf-8"))["summary"]
    assert summary["brightened"] == 2**stops
    assert summary["black_level_dn"] == black_dn and summary["white_level_dn"] == white_dn
    brightened = tmp_path / "frame_brightened.png"
    assert brightened.exists() == (stops > 0)
    if stops:
        picture = np.asarray(Image.open(brightened))
        np.testing.assert_array_equal(picture[:40], frames.preview(gain=2.0**stops))
        assert picture.shape == (68, 90) and picture[40:].max() > 200 > picture[40:].mean()


def test_a_page_explains_every_key_of_frame_json() -> None:
    """The keys of the file, those of its tables but options, versions and the camera, and all that can end a render."""
    page = (ROOT / "docs" / "frames.md").read_text("utf-8")
    metadata = ms.capture(FLAT, NAME, EXPOSURE, **QUICK).metadata
    explained = set(re.findall(r"`([A-Za-z_0-9]+)…?`", page))
    inside = {*metadata["counts"], *metadata["bands"]} - {"wavelengths_nm", "bandwidths_nm"}
    assert {*metadata, *inside} - explained == set()
    told = str(RenderStatistics.__doc__).split("ended_by :")[1].split("reliable")[0]
    ends = set(re.findall(r'"(\w+)"', told))
    assert len(ends) > 4 and ends - explained == set()


@pytest.mark.parametrize("name", ["capture", "render", "render_frames", "expose"])
def test_a_docstring_names_arguments_and_no_flags(name: str) -> None:
    described = getattr(ms, name).__doc__
    assert "instead of fps" in described or "instead of a fixed spp" in described
    assert not re.search(r"--[a-z]|Repeatable\.|\(repeatable\)", described)


def test_everything_that_is_returned_prints_on_one_line() -> None:
    frames = ms.expose(PHOTONS, NAME, EXPOSURE)
    captured = ms.capture(FLAT, NAME, EXPOSURE, aovs=True, **QUICK)
    budget = frames.noise_budget()
    returned = (
        CAMERA,
        frames,
        frames.theory,
        frames.light,
        budget,
        budget.entries[0],
        captured,
        captured.light,
        captured.light.statistics,
        captured.aovs,
        ms.plan(NAME, EXPOSURE, PHOTONS),
        ms.Sensor(NAME),
        CAMERA.emva1288(EXPOSURE),
    )
    for one in returned:
        assert len(repr(one)) <= 160 and "\n" not in repr(one), type(one)


@pytest.mark.parametrize(
    "rgb", ["scalar_rgb", *([] if backend_problem("llvm") else [exhaustive("llvm_ad_rgb")])]
)
def test_a_notebook_in_an_rgb_variant_and_then_in_a_spectral_one_runs(
    rgb: str, scene_file: Path
) -> None:
    """A path, text or dict is rendered in a spectral variant and the user's is set again, also after an error; what was
    loaded in the rgb variant is refused in one sentence."""
    mi, quick = mitsuba(), {"width": 8, "spp": 16, "seed": 1, "denoise": False}
    take = partial(ms.render, camera=CAMERA, exposure=EXPOSURE, **quick)
    mi.set_variant(rgb)
    try:
        scene = mi.load_file(str(scene_file))
        text, box = scene_file.read_text(encoding="utf-8"), mi.cornell_box()
        lights = [take(given) for given in (scene_file, text, box)]
        capture = ms.capture(scene_file, CAMERA, EXPOSURE, aovs=True, **quick)
        assert all(light.statistics.variant.endswith("_spectral") for light in lights)
        assert all(np.isfinite(light.data).all() for light in (*lights, capture.light))
        for wrong, sentence in (
            (scene, f"loaded in variant '{rgb}', which keeps no spectra"),
            ({**box, "ball": mi.load_dict({"type": "sphere"})}, "call mitsuba.set_variant"),
            ("<scene version='3.0.0'/>", "no sensor"),
        ):
            with pytest.raises(ms.InputError, match=re.escape(sentence)):
                take(wrong)
        assert mi.variant() == rgb and np.isfinite(mi.render(scene, spp=1)).all()
        mi.set_variant(lights[0].statistics.variant)
        again = take(mi.load_file(str(scene_file)))
        np.testing.assert_allclose(again.data.mean(), lights[0].data.mean(), rtol=1e-3)
    finally:
        mi.set_variant("scalar_spectral")
