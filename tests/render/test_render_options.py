"""Options of a render: crops, units and lenses, and options that contradict each other or have no effect."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from helpers.scenes import (
    SCENES,
    SKY,
    scene_text,
    write_scene,
)

import mitsuba_sensor as ms
from mitsuba_sensor import expose

TABLE1, BAYER, EXPOSURE = (
    ms.load_camera("konnik_table1"),
    ms.load_camera("bayer_2mp"),
    ms.Exposure(0.02),
)
ONE_FILE = SCENES / "one_file.xml"
SMALL = {"width": 16, "height": 12}
Cli = Callable[..., Any]


def cropped(x: int, y: int) -> str:
    options = {"crop_width": 6, "crop_height": 4, "crop_offset_x": x, "crop_offset_y": y}
    return "".join(
        f'<integer name="{name}" value="{value}"/>' for name, value in options.items()
    )


@pytest.mark.parametrize("spectral", ["cube", "channels"])
def test_a_crop_of_a_mosaic_is_the_mosaic_of_the_crop(tmp_path: Path, spectral: str) -> None:
    """The frame of a crop window at odd offsets is the window of the full frame: filters, patterns and noise.

    Light without render noise: one wavelength per band would not do for three filters, so the light of the full
    render is cut by hand and both are exposed; the film's window only has to say where it lies.
    """
    options = {"spectral": spectral, "spp": 16, "variant": "scalar_spectral"}
    part = ms.render(
        write_scene(tmp_path, scene_text(SKY, film=cropped(3, 1))), BAYER, EXPOSURE, **options
    )
    assert part.origin == (1, 3)
    photons = ms.collect(part, BAYER, EXPOSURE)
    whole, in_band = np.zeros((8, 12, photons.mean.shape[2])), np.ones((8, 12))
    whole[1:5, 3:9] = photons.mean
    in_band[1:5, 3:9] = 1.0 if photons.in_band is None else photons.in_band
    full = expose(photons.changed(mean=whole, in_band=in_band, origin=(0, 0)), BAYER, EXPOSURE)
    np.testing.assert_array_equal(
        expose(photons, BAYER, EXPOSURE).digital[0], full.digital[0, 1:5, 3:9]
    )


@pytest.mark.parametrize("width", one_in(2, [1, 2, 4, 5, 6]))
@pytest.mark.parametrize(("x", "y"), [exhaustive(0, 0), (3, 1), (6, 4), exhaustive(5, 3)])
def test_the_width_is_that_of_the_image_and_its_view_stays(
    tmp_path: Path, width: int, x: int, y: int
) -> None:
    """Columns of the crop window, not of the whole film: it keeps its place, to half a pixel."""
    path = write_scene(tmp_path, scene_text(SKY, film=cropped(x, y)))
    options: dict[str, Any] = {"spp": 1, "wavelength_nm": 550, "variant": "scalar_spectral"}
    light = ms.render(path, TABLE1, EXPOSURE, width=width, **options)
    rows = max(round(4 * width / 6), 1)
    assert light.data.shape[:2] == (rows, width)
    np.testing.assert_allclose(light.origin, np.multiply((y, x), width / 6), atol=0.5)


def test_a_scene_unit_that_is_given_holds_for_the_camera_of_the_file_too() -> None:
    """Focal length and f-number are the camera's own, whatever the unit; the scene's lengths are what changes."""
    options = {
        "parameters": SMALL,
        "spp": 16,
        "wavelength_nm": 550,
        "variant": "scalar_spectral",
    }
    for unit in (None, "cm", "m"):
        found = ms.render(ONE_FILE, scene_unit=unit, **options).statistics
        assert found.intrinsics is not None
        assert found.intrinsics["focal_length_mm"] == pytest.approx(2.5, rel=1e-3)
        assert found.aperture_f_number == pytest.approx(2.8, rel=1e-3)


def test_a_camera_that_is_named_is_told_what_it_leaves_of_the_file(tmp_path: Path) -> None:
    options = {
        "parameters": SMALL,
        "spp": 16,
        "wavelength_nm": 550,
        "variant": "scalar_spectral",
    }
    given = ms.render(ONE_FILE, TABLE1.replace(**{"lens.f_number": 8.0}), **options)
    (told,) = (note for note in given.statistics.notes if "ignored the scene's" in note)
    assert "lens.transmission_curve" in told and "lens.f_number" not in told
    own = ms.render(ONE_FILE, **options)
    assert not any("not used" in note for note in own.statistics.notes)


def test_a_quantum_yield_has_bands_with_a_render_for_every_frame() -> None:
    camera = TABLE1.replace(**{"quantum_efficiency.quantum_yield": [2.0, 1.0]})
    options = {"parameters": SMALL, "spp": 16, "variant": "scalar_spectral"}
    frame = next(ms.render_frames(SCENES / "cornell_box.xml", camera, EXPOSURE, **options))
    assert frame.light.statistics.spectral == "cube"


def test_the_ratio_is_that_of_the_lit_pixels(tmp_path: Path) -> None:
    """A small ball in the dark: nine pixels of ten have no light and no error, and do not count."""
    area = '<shape type="rectangle"><transform name="to_world"><translate x="3" y="3" z="3"/></transform>'
    area += '<emitter type="area"><spectrum name="radiance" value="360:1, 830:1"/></emitter></shape>'
    ball = '<shape type="sphere"><point name="center" value="0, 0, 9"/></shape>'
    path = write_scene(tmp_path, scene_text(area, ball))
    light = ms.render(
        path, TABLE1, EXPOSURE, wavelength_nm=550, noise_ratio=0.5, variant="scalar_spectral"
    )
    lit = light.data[..., 0] > 0
    assert lit.mean() < 0.5
    assert 0 < light.statistics.noise_ratio_median <= 0.55


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"subframes": 4}, "nothing moves"),
        ({"denoise": "no"}, "denoise is 'no'"),
        ({"variant": 3}, "variant is 3"),
    ],
)
def test_options_without_an_effect_are_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ms.InputError, match=said):
        ms.render(SCENES / "flat_field.xml", TABLE1, EXPOSURE, **options)


@pytest.mark.parametrize("command", ["expose", "plan"])
def test_another_lens_comes_too_late_for_light_that_is_rendered(
    command: str, light_file: Path, tmp_path: Path, cli: Cli
) -> None:
    options = ("-o", tmp_path / "out") if command == "expose" else ()
    done = cli(command, light_file, *options, "--set", "lens.f_number=16")
    assert done.exit_code == 2 and "already passed the lens" in " ".join(done.stderr.split())


@pytest.mark.exhaustive
def test_a_prescription_by_set_takes_focal_length_and_focus_of_the_scene(
    tmp_path: Path, cli: Cli
) -> None:
    options = (
        "-D",
        "width=8",
        "-D",
        "height=6",
        "--spp",
        "16",
        "--wavelength-nm",
        "550",
        "--json",
    )
    done = cli(
        "render", ONE_FILE, "-o", tmp_path, "--set", "lens.prescription=double_gauss", *options
    )
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["render"]["intrinsics"]["focal_length_mm"] == pytest.approx(
        2.5, rel=1e-3
    )


def test_a_window_that_shows_less_than_the_scene_is_told_with_its_width() -> None:
    camera, small = (
        TABLE1.replace(**{"lens.prescription": "double_gauss"}),
        {"spp": 2, "width": 8},
    )
    light = ms.render(
        "cornell_box", camera, EXPOSURE, wavelength_nm=550, denoise=False, **small
    )
    assert "width=1900 comes closest" in light.notes[0]
