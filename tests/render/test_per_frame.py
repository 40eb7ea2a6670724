"""Frames with a render each: the series, Poisson's law where render noise is compensated, and what is refused.

A floor under an even sky, seen by a telecentric lens: every pixel has the radiance ρ·L, and the noise of drawing
directions. Statistics are of 100 frames of 32 × 24 pixels in ``scalar_spectral``: 76 800 counts. The mean over the
pixels of variance over mean then has a standard error of 0.51 %: a bound of 2.6 % is five of them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers.scenes import SCENES, scene_text, skip_unless_usable, write_scene
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.photons import photons_per_irradiance
from mitsuba_sensor.render.passes.passes import FEWEST, hashed_seed
from mitsuba_sensor.render.scene.scene import Scene
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
EXPOSURE = ms.Exposure(0.001)
FRAMES, SPP = 100, 12
OPTIONS = {"wavelength_nm": 550.0, "variant": "scalar_spectral"}


@pytest.fixture(scope="module")
def floor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("floor"), scene_text(FLOOR, sensor=TELECENTRIC))


def light_e() -> float:
    """Electrons per pixel by closed form: E = π·ρ·L/(4N²), times photons per irradiance, times QE."""
    irradiance = (
        math.pi * REFLECTANCE * SKY / (4 * CAMERA.lens.f_number**2) * CAMERA.lens.transmission
    )
    photons = photons_per_irradiance(CAMERA, EXPOSURE, [550.0], [10.0])
    return float(irradiance * photons[0] * CAMERA.qe([550.0])[0, 0])


@dataclass(frozen=True)
class Series:
    """Electrons of many frames, (N, H, W), and what each frame said of itself."""

    electrons: NDArray[np.float64]
    uncompensated: float

    @property
    def variance_over_mean(self) -> float:
        """Mean over the pixels of variance over frames by mean over frames: 1 for Poisson's law."""
        return float((self.electrons.var(axis=0, ddof=1) / self.electrons.mean(axis=0)).mean())


def series(scene: Path, render_noise: Any, spp: int, frames: int) -> Series:
    frames = ms.render_frames(
        scene, CAMERA, EXPOSURE, frames=frames, render_noise=render_noise, spp=spp,
        keep=("electrons",), **OPTIONS,
    )  # fmt: skip
    found = [(frame.frames.electrons[0], frame.uncompensated) for frame in frames]
    return Series(
        np.array([electrons for electrons, _ in found]),
        float(np.mean([uncompensated for _, uncompensated in found])),
    )


@pytest.fixture(scope="module")
def compensated(floor: Path) -> Series:
    return series(floor, "compensated", SPP, FRAMES)


@pytest.fixture(scope="module")
def each(floor: Path) -> Series:
    return series(floor, "per-frame", SPP, FRAMES // 2)


@pytest.mark.exhaustive
def test_compensated_frames_have_mean_and_variance_of_poissons_law(
    compensated: Series, each: Series
) -> None:
    """Mean within four standard errors (0.2 %) of the closed form; variance within 2.6 % of the mean.

    The renders' own noise, 8 % of the shot noise and more, could not be missed.
    """
    mean = light_e() + mean_dark_e(CAMERA, EXPOSURE)
    assert each.uncompensated > 0.08
    assert compensated.uncompensated < 0.01
    assert compensated.electrons.mean() == pytest.approx(
        mean, abs=4 * math.sqrt(mean / compensated.electrons.size)
    )
    assert compensated.variance_over_mean == pytest.approx(1.0, abs=0.026)


@pytest.mark.parametrize("axis", [1, 2])
def test_neighbours_of_compensated_frames_are_not_correlated(
    compensated: Series, axis: int
) -> None:
    """|ρ| < 5/√n of the n pairs of neighbours, after each pixel's own mean is taken away."""
    normal = compensated.electrons - compensated.electrons.mean(axis=0)
    one, other = (
        np.take(normal, range(k, normal.shape[axis] - 1 + k), axis=axis) for k in (0, 1)
    )
    correlation = (one * other).mean() / math.sqrt((one**2).mean() * (other**2).mean())
    assert abs(correlation) < 5 / math.sqrt(one.size)


def test_frames_that_follow_each_other_are_not_correlated(compensated: Series) -> None:
    normal = compensated.electrons - compensated.electrons.mean(axis=0)
    correlation = (normal[1:] * normal[:-1]).mean() / (normal**2).mean()
    assert abs(correlation + 1 / FRAMES) < 5 / math.sqrt(normal[1:].size)


def test_frames_without_compensation_are_too_noisy_by_what_they_say(each: Series) -> None:
    """Variance over mean is 1 + ``uncompensated`` within 3.4 %, four standard errors."""
    assert each.variance_over_mean == pytest.approx(1 + each.uncompensated, abs=0.034)


def test_a_frame_says_in_how_many_pixels_its_render_has_more_noise_than_shot_noise() -> None:
    """A dim exposure of a rough render: of some pixels, and those whose variance exceeds the mean of light and dark."""
    options = {
        "parameters": {"width": 16, "height": 16},
        "wavelength_nm": 550,
        "variant": "scalar_spectral",
    }
    scene, exposure = SCENES / "cornell_box.xml", ms.Exposure(0.02)
    frame = next(ms.render_frames(scene, CAMERA, exposure, spp=16, **options))
    variance, mean = (
        frame.photons.variance_e2,
        frame.frames.detected.mean_e + mean_dark_e(CAMERA, exposure),
    )
    shown = (mean > 0) & (mean < CAMERA.pixel.full_well_e)
    assert 0 < frame.above_shot_noise < 1
    assert frame.above_shot_noise == pytest.approx((variance > mean)[shown].mean(), abs=0.005)


def test_what_a_render_has_beyond_the_limit_stays_in_the_frame_uncompensated(
    floor: Path,
) -> None:
    """With four samples renders are often noisier than that: 1 + ``uncompensated`` within 4 %, four standard errors."""
    rough = series(floor, "compensated", 4, 60)
    assert rough.uncompensated > 0.1
    assert rough.variance_over_mean == pytest.approx(1 + rough.uncompensated, abs=0.04)


def three(scene: Path, **options: Any) -> list[RenderedFrame]:
    return list(
        ms.render_frames(
            scene, CAMERA, EXPOSURE, **{"frames": 3, "spp": SPP, **OPTIONS, **options}
        )
    )


def test_every_frame_has_a_render_of_its_own_with_a_hashed_seed(floor: Path) -> None:
    """Frame k is made from the render whose seed is the hash of the series' seed and k: no two alike."""
    lights = [frame.light.data for frame in three(floor, seed=9)]
    assert not np.array_equal(lights[0], lights[1]) and not np.array_equal(lights[1], lights[2])
    for k, light in enumerate(lights):
        alone = ms.render(
            floor,
            CAMERA,
            EXPOSURE,
            seed=hashed_seed(9, -1, k),
            spp=SPP,
            denoise=False,
            **OPTIONS,
        )
        np.testing.assert_array_equal(light, alone.data)
    assert not np.array_equal(lights[0], three(floor, seed=10)[0].light.data)


@pytest.mark.parametrize("render_noise", ["compensated", "per-frame"])
def test_a_frame_made_alone_is_that_frame_of_the_series(floor: Path, render_noise: str) -> None:
    whole = three(floor, render_noise=render_noise)
    (alone,) = three(floor, render_noise=render_noise, first_frame=2, frames=1)
    np.testing.assert_array_equal(alone.frames.digital, whole[2].frames.digital)
    np.testing.assert_array_equal(alone.light.data, whole[2].light.data)
    assert alone.uncompensated == whole[2].uncompensated
    numbered = ms.expose(alone.photons, CAMERA, EXPOSURE, first_frame=2)
    np.testing.assert_array_equal(alone.frames.digital, numbered.digital)


def test_without_samples_a_frame_is_rendered_until_it_can_be_compensated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At least 16 passes and no more than 1 % left uncompensated; a render before the first frame finds their size.

    8 × 6 pixels with about 17 000 electrons each, which need some thousand samples.
    """
    sizes: list[int] = []
    render = Scene.render
    monkeypatch.setattr(
        Scene,
        "render",
        lambda self, seed, n, *rows: sizes.append(n) or render(self, seed, n, *rows),
    )
    sensor = TELECENTRIC.replace('"32"', '"8"').replace('"24"', '"6"')
    frames = ms.render_frames(
        write_scene(tmp_path, scene_text(FLOOR, sensor=sensor)),
        CAMERA,
        ms.Exposure(0.5),
        frames=3,
        **OPTIONS,
    )
    for number, frame in enumerate(frames):
        found = frame.light.statistics
        assert found.ended_by == "compensable"
        assert frame.uncompensated <= 0.01
        assert found.passes >= FEWEST
        assert (len(sizes) == found.passes) == (number > 0), (
            "before the first frame there is a render"
        )
        assert set(sizes[-found.passes :]) == {found.samples_per_pixel // found.passes}
        sizes.clear()


@pytest.mark.exhaustive
def test_a_frame_made_alone_gets_the_samples_of_the_series() -> None:
    """Also where no number of them was asked for: the render before the first frame is that of the seed."""
    options = {
        "parameters": {"width": 12, "height": 12},
        "variant": skip_unless_usable("llvm_ad_spectral"),
        "seed": 5,
    }
    scene, exposure = SCENES / "cornell_box.xml", ms.Exposure(1e-4)
    whole = list(ms.render_frames(scene, CAMERA, exposure, frames=3, **options))
    (alone,) = ms.render_frames(scene, CAMERA, exposure, first_frame=2, frames=1, **options)
    assert alone.light.statistics.notes == whole[2].light.statistics.notes
    np.testing.assert_allclose(alone.light.data, whole[2].light.data, rtol=1e-4)


def test_the_colour_channels_are_rendered_unless_bands_are_asked_for(floor: Path) -> None:
    options = {"frames": 1, "spp": SPP, "variant": "scalar_spectral"}
    (usual,) = ms.render_frames(floor, CAMERA, EXPOSURE, **options)
    (cube,) = ms.render_frames(
        floor, CAMERA, EXPOSURE, spectral="cube", bandwidth_nm=100, **options
    )
    assert usual.light.statistics.spectral == "channels" and usual.light.filters == ("mono",)
    assert cube.light.statistics.spectral == "cube"


def test_progress_names_the_frame(floor: Path) -> None:
    told: list[tuple[int, int]] = []
    list(ms.render_frames(floor, CAMERA, EXPOSURE, first_frame=5, frames=2, spp=SPP, **OPTIONS,
               progress=lambda step: told.append((step.frame, step.done))))  # fmt: skip
    assert told == [(frame, done) for frame in (5, 6) for done in range(SPP + 1)]


YIELDING = CAMERA.replace(**{"quantum_efficiency.quantum_yield": [2.0, 1.0]})
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "another name": (
        {"render_noise": "shared"},
        "render_noise is 'shared'; it must be one of compensated, per-frame",
    ),
    "a denoiser": (
        {"denoise": True},
        "denoise and a render for every frame exclude each other",
    ),
    "a quantum yield": ({"camera": YIELDING, "wavelength_nm": 450.0}, "has a quantum_yield"),
    "no frames": ({"frames": 0}, "frames"),
    "a frame before the first": ({"first_frame": -1}, "first_frame"),
    "samples and a ratio": ({"spp": 4, "noise_ratio": 0.1}, "give one"),
    "a seed that is no number": ({"seed": "one"}, "seed"),
    "a serial that is no number": ({"serial": 1.5}, "serial"),
}


@pytest.mark.parametrize(("options", "says"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_compensated_is_refused_before_any_render(
    floor: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], says: str
) -> None:
    """By the call itself, before the first frame is asked for."""
    monkeypatch.setattr(Scene, "render", lambda *_: pytest.fail("it was rendered first"))
    given = {"camera": CAMERA, "exposure": EXPOSURE, **OPTIONS, **options}
    with pytest.raises(ms.InputError, match=says):
        ms.render_frames(floor, **given)


def test_a_quantum_yield_has_frames_without_compensation(floor: Path) -> None:
    (frame,) = ms.render_frames(
        floor, YIELDING, EXPOSURE, render_noise="per-frame", spp=SPP, **OPTIONS
    )
    assert frame.photons.variance_e2 is None and frame.frames.digital.any()


def pages(folder: Path) -> Iterator[NDArray[Any]]:
    with tifffile.TiffFile(folder / "frame.tiff") as tiff:
        yield from (page.asarray() for page in tiff.pages)


@pytest.mark.exhaustive
def test_the_command_line_compensates(
    floor: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """Three pages that differ, those of ``render_frames``; the report says how, and what was left uncompensated."""
    options = "--camera konnik_table1 --exposure-s 0.001 --wavelength-nm 550 --frames 3 --render-noise compensated"
    options += f" --spp {SPP}"
    done = cli(
        "render",
        floor,
        "-o",
        tmp_path / "out",
        *options.split(),
        "--variant",
        "scalar_spectral",
    )
    assert done.exit_code == 0, done.stderr
    camera = ms.load_camera("konnik_table1")
    frames = ms.render_frames(floor, camera, EXPOSURE, frames=3, spp=SPP, **OPTIONS)
    for page, frame in zip(pages(tmp_path / "out"), frames, strict=True):
        np.testing.assert_array_equal(page, frame.frames.digital[0])
    report = json.loads((tmp_path / "out" / "frame.json").read_text(encoding="utf-8"))
    assert report["origin"]["render_noise"] == "compensated"
    assert report["origin"]["uncompensated"] < 0.05
