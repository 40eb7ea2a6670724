"""The night crossing: what its script writes, groups of emitters, illuminances, about 130 dB, the car that moves."""

from __future__ import annotations

import importlib
import sys
from fnmatch import fnmatch
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from helpers.scenes import SCENES
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.files.openexr import whole_exr
from mitsuba_sensor.optics import spectra
from mitsuba_sensor.render.scene.motion import read_motion

SCENE, PARTS = SCENES / "night_crossing.xml", SCENES / "parts" / "night_crossing"
GROUPS = {
    "sky": ("sky*", "moon"),
    "lamps": ("lamp_*",),
    "headlights": ("headlight_*",),
    "signals": ("signal_*",),
    "windows": ("window_*",),
}
TREE = ElementTree.parse(SCENE).getroot()
EMITTERS = {emitter.get("id", ""): emitter for emitter in TREE.iter("emitter")}
FINE_NM = np.arange(360.0, 831.0)


def level(name: str) -> float:
    """Luminance [cd/m²], or luminous intensity [cd], of an emitter with a table."""
    (spectrum,) = EMITTERS[name].iter("spectrum")
    table = np.array(
        [pair.split(":") for pair in spectrum.attrib["value"].split(",")], dtype=float
    )
    return spectra.luminous(FINE_NM, np.interp(FINE_NM, *table.T, left=0.0, right=0.0))


def luminance(light: ms.Irradiance) -> np.ndarray:
    """Luminance [cd/m²] before the lens, of f/1.4 and without its cos⁴, (H, W)."""
    weight = spectra.LUMENS_PER_WATT * spectra.photopic(light.wavelengths_nm)
    illuminance = (light.data * light.bandwidths_nm * weight).sum(axis=-1)
    return illuminance * 4 * 1.4**2 / np.pi


def vertices(path: Path) -> np.ndarray:
    """Points of a PLY file of ours, (N, 3)."""
    head, body = path.read_bytes().split(b"end_header\n", 1)
    count = int(head.split(b"element vertex ")[1].split()[0])
    return np.frombuffer(body, "<f4", 3 * count).reshape(-1, 3)


@pytest.mark.exhaustive
def test_the_files_are_what_their_script_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1 to 2 s for 45 files: text to the byte, points to a tenth of a millimetre, pictures to a level."""
    monkeypatch.syspath_prepend(str(SCENES))
    importlib.import_module("make_night_crossing").write(tmp_path)
    for name in [
        name for name in sys.modules if "night_crossing" in name and "test" not in name
    ]:
        monkeypatch.delitem(sys.modules, name)
    for file in (SCENE, SCENE.with_suffix(".toml")):
        assert (tmp_path / file.name).read_text("utf-8") == file.read_text("utf-8")
    new = tmp_path / PARTS.relative_to(SCENES)
    assert {file.name for file in new.iterdir()} == {file.name for file in PARTS.iterdir()}
    for file in PARTS.glob("*.ply"):
        np.testing.assert_allclose(vertices(new / file.name), vertices(file), atol=1.1e-4)
    for file in PARTS.glob("*.png"):
        here, there = (np.asarray(Image.open(f), float) for f in (file, new / file.name))
        assert np.abs(here - there).max() <= 1
    with (
        whole_exr(PARTS / "sky.exr", "") as (_, here),
        whole_exr(new / "sky.exr", "") as (_, there),
    ):
        for name, image in here.items():
            np.testing.assert_allclose(there[name], image, rtol=2e-3)


def test_every_emitter_is_in_one_group_by_its_id_and_no_group_is_empty() -> None:
    """No shape without light has an id like that of a group, so that a pattern may be of either."""
    assert "" not in EMITTERS and len(EMITTERS) == len(list(TREE.iter("emitter"))) <= 25
    groups = {
        name: {g for g, patterns in GROUPS.items() if any(fnmatch(name, p) for p in patterns)}
        for name in EMITTERS
    }
    assert all(len(of_one) == 1 for of_one in groups.values())
    assert set.union(*groups.values()) == set(GROUPS)
    patterns = [pattern for of_group in GROUPS.values() for pattern in of_group]
    for shape in TREE.iter("shape"):
        if any(fnmatch(shape.attrib["id"], pattern) for pattern in patterns):
            assert shape.find("emitter") is not None, shape.attrib["id"]


def test_it_renders_with_130_dB_from_the_brightest_emitter_to_the_darkest_surfaces() -> None:
    """20·log10 of the headlights' luminance over that of the darkest hundredth of the pixels."""
    light = ms.render(
        "night_crossing", width=48, spp=32, denoise=False, variant="scalar_spectral"
    )
    dark = np.percentile(luminance(light), 1)
    bright = max(level(name) for name in EMITTERS if name != "sky" and "beam" not in name)
    assert bright == level("headlight_1")
    assert 125 < 20 * np.log10(bright / dark) < 140


@pytest.mark.exhaustive
def test_another_camera_sees_it_too() -> None:
    """Its film does not depend on one camera; metered, because the gain differs."""
    options = {"width": 24, "spp": 16, "variant": "scalar_spectral", "denoise": False}
    captured = ms.capture("night_crossing", "konnik_table1", exposure="auto", **options)
    assert captured.frames.digital.std() > 0


def test_everything_of_the_car_moves_at_one_speed_and_its_wheels_roll() -> None:
    """At the lowest point of a wheel, 0.33 m below its axle, it stands still on the road."""
    motion = read_motion("night_crossing")
    ids = {element.get("id", "") for element in (*TREE.iter("shape"), *TREE.findall("emitter"))}
    assert set(motion.objects) == {x for x in ids if x.startswith(("car_", "headlight_"))}
    for name, one in motion.objects.items():
        place = np.array([0, 0, 0, 1.0])
        if one.pivot_m is not None:
            place[:3] = np.array(one.pivot_m) - (0, 0.33, 0)
        moved = (one.displacement(1e-5) @ place - place)[:3] / 1e-5
        expected = (0, 0, 4)
        if "tyre" in name or "rim" in name:
            expected = (0, 0, 0)
        np.testing.assert_allclose(moved, expected, atol=1e-2)
