"""Frames with a render each: their renders, their noise, and what is refused.

A floor under an even sky, seen by a telecentric lens: every pixel has the radiance ρ·L, and the noise of drawing
directions. Statistics are of 50 frames of 32 × 24 pixels in ``scalar_spectral``: 38 400 counts. The mean over the
pixels of variance over mean then has a standard error of 0.73 %.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.photons import photons_per_irradiance
from mitsuba_sensor.render.load.scene import Scene
from mitsuba_sensor.render.samples import hashed_seed
from mitsuba_sensor.render_frames import RenderedFrame
from mitsuba_sensor.stages.effects.dark_current import mean_dark_e

REFLECTANCE, SKY = 0.5, 2.5e-3
"""Of the floor; and of the sky [W m⁻² sr⁻¹ nm⁻¹]."""
FLOOR = (
    f'<shape type="rectangle"><transform name="to_world"><scale value="9"/></transform><bsdf type="diffuse">'
    f'<spectrum name="reflectance" value="360:{REFLECTANCE}, 830:{REFLECTANCE}"/></bsdf></shape>'
    f'<emitter type="constant"><spectrum name="radiance" value="360:{SKY}, 830:{SKY}"/></emitter>'
    '<integrator type="path"><integer name="max_depth" value="2"/></integrator>'
)
TELECENTRIC = """<sensor type="orthographic">{more}
<transform name="to_world"><lookat origin="0, 0, 3" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/>{film}</film></sensor>"""
CAMERA = ms.load_camera("konnik_table1").replace(**{"pixel.prnu": 0.0, "dark_current.cv": 0.0})
EXPOSURE, SPP = ms.Exposure(0.001), 12
OPTIONS = {"wavelength_nm": 550.0, "variant": "scalar_spectral"}


@pytest.fixture(scope="module")
def floor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("floor"), scene_text(FLOOR, sensor=TELECENTRIC))


def series(scene: Path, **options: Any) -> list[RenderedFrame]:
    asked = {"frames": 3, "spp": SPP, **OPTIONS, **options}
    return list(ms.render_frames(scene, CAMERA, EXPOSURE, **asked))


def test_the_noise_of_the_renders_is_noise_of_the_frames(floor: Path) -> None:
    """Mean within four standard errors of the closed form E = π·ρ·L/(4N²); variance over mean is 1 plus the variance
    that the renders say of themselves, within four standard errors (4.9 %)."""
    frames = series(floor, frames=24, keep=("electrons",))
    electrons = np.array([frame.frames.electrons[0] for frame in frames])
    lens = CAMERA.lens
    irradiance = math.pi * REFLECTANCE * SKY / (4 * lens.f_number**2) * lens.transmission
    photons = photons_per_irradiance(CAMERA, EXPOSURE, [550.0], [10.0])[0]
    light_e = float(irradiance * photons * CAMERA.qe([550.0])[0, 0])
    mean_e = light_e + mean_dark_e(CAMERA, EXPOSURE)
    own = np.mean([(light_e * frame.light.relative_error) ** 2 for frame in frames]) / mean_e
    assert own > 0.08
    error = math.sqrt(mean_e * (1 + own) / electrons.size)
    assert electrons.mean() == pytest.approx(mean_e, abs=4 * error)
    over_mean = (electrons.var(axis=0, ddof=1) / electrons.mean(axis=0)).mean()
    assert over_mean == pytest.approx(1 + own, abs=0.049)


def test_every_frame_has_a_render_of_its_own_with_a_hashed_seed(floor: Path) -> None:
    """Frame k is made from the render whose seed is the hash of the series' seed and k: no two alike."""
    whole = series(floor, seed=9)
    for number, frame in enumerate(whole):
        seed = hashed_seed(9, -1, number)
        alone = ms.render(floor, CAMERA, EXPOSURE, seed=seed, spp=SPP, denoise=False, **OPTIONS)
        np.testing.assert_array_equal(frame.light.data, alone.data)
    assert (
        len({frame.light.data.tobytes() for frame in [*whole, series(floor, seed=10)[0]]}) == 4
    )


def test_a_frame_made_alone_is_that_frame_of_the_series(floor: Path) -> None:
    whole = series(floor)
    (alone,) = series(floor, first_frame=2, frames=1)
    np.testing.assert_array_equal(alone.frames.digital, whole[2].frames.digital)
    np.testing.assert_array_equal(alone.light.data, whole[2].light.data)
    numbered = ms.expose(alone.photons, CAMERA, EXPOSURE, first_frame=2)
    np.testing.assert_array_equal(alone.frames.digital, numbered.digital)


def test_the_colour_channels_are_rendered_unless_bands_are_asked_for(floor: Path) -> None:
    options = {"frames": 1, "wavelength_nm": None}
    (usual,) = series(floor, **options)
    (cube,) = series(floor, spectral="cube", bandwidth_nm=100, **options)
    assert usual.light.statistics.spectral == "channels" and usual.light.filters == ("mono",)
    assert cube.light.statistics.spectral == "cube"


def test_progress_names_the_frame(floor: Path) -> None:
    told: list[tuple[int, int]] = []
    asked = {"first_frame": 5, "frames": 2}
    series(floor, progress=lambda step: told.append((step.frame, step.done)), **asked)
    assert told == [(frame, done) for frame in (5, 6) for done in range(SPP + 1)]


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "a denoiser": ({"denoise": True}, "denoise"),
    "no frames": ({"frames": 0}, "frames"),
    "a frame before the first": ({"first_frame": -1}, "first_frame"),
    "samples and a ratio": ({"noise_ratio": 0.1}, "noise_ratio"),
    "a seed that is no number": ({"seed": "one"}, "seed"),
    "frames in time": ({"fps": 10.0}, "fps"),
}


@pytest.mark.parametrize(("options", "says"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_is_refused_before_any_render(
    floor: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], says: str
) -> None:
    """By the call itself, before the first frame is asked for."""
    monkeypatch.setattr(Scene, "render", lambda *_: pytest.fail("it was rendered first"))
    with pytest.raises(ms.InputError, match=says):
        ms.render_frames(floor, CAMERA, EXPOSURE, **{"spp": SPP, **OPTIONS, **options})
