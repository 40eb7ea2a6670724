"""DNGs as LibRaw, tifffile and this package's own importer read them: pixels, levels, mosaic, colours, noise."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest
import rawpy
import tifffile
from helpers.marks import exhaustive
from helpers.patches import MIDDLES, OBSERVER, PATCHES, SHAPE, WHITE, distances, lit_by, seen
from scipy import constants

import mitsuba_sensor as ms
from mitsuba_sensor.files.raw_files import dng_tags, read_raw
from mitsuba_sensor.output import dng
from mitsuba_sensor.output.dng import calibrations
from mitsuba_sensor.output.importers.import_camera import import_camera
from mitsuba_sensor.render.load.scene import Scene

BAYER, RGBIR = ms.load_camera("bayer_2mp"), ms.load_camera("rgbir_2mp")
MONO, EXPOSURE, SIZE = ms.load_camera("konnik_table1"), ms.Exposure(0.01), (41, 53)
EIGHT_BITS, SIXTEEN_BITS = MONO.replace(**{"adc.bits": 8}), ms.load_camera("eev_44_82")
LADDER, EMCCD = ms.load_camera("sony_a7s2"), ms.load_camera("proem_hs_1024b")


def saved(path: Path, camera: ms.Camera, photons: Any = 5000.0, **more: Any) -> ms.Frames:
    """One noisy frame, and its DNG at this path."""
    frames = ms.expose(np.broadcast_to(photons, SIZE), camera, EXPOSURE, **more)
    frames.save_dng(path)
    return frames


@pytest.mark.parametrize("origin", [(0, 0), (0, 1), (1, 0), (3, 5)])
def test_libraw_reads_every_pixel_of_a_mosaic_behind_its_own_filter(
    tmp_path: Path, origin: tuple[int, int]
) -> None:
    """Of an odd number of rows and columns, from an odd place of the sensor on."""
    rng = np.random.default_rng(1)
    frames = saved(tmp_path / "a.dng", BAYER, rng.uniform(0.0, 70_000.0, SIZE), origin=origin)
    names = np.array(BAYER.filter_names)[BAYER.filter_index(SIZE, origin)]
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        np.testing.assert_array_equal(raw.raw_image, frames.digital[0])
        np.testing.assert_array_equal(np.array(list("RGBG"))[raw.raw_colors], names)
        assert raw.color_desc == b"RGBG" and raw.sizes.flip == 0
        # 4σ of read noise; the last code
        assert raw.black_level_per_channel == [4] * 4 and raw.white_level == 4095
        assert (raw.other.shutter_speed, raw.other.aperture) == pytest.approx((0.01, 2.8))
        assert raw.postprocess().shape == (*SIZE, 3)
        sizes = raw.sizes
        assert (sizes.crop_left_margin, sizes.crop_top_margin) == (2, 2)
        assert (sizes.crop_height, sizes.crop_width) == (SIZE[0] - 4, SIZE[1] - 4)
    back = read_raw(tmp_path / "a.dng")
    np.testing.assert_array_equal(back.frames, frames.digital)
    assert back.tile == tuple(map(tuple, names[:2, :2]))
    assert back.exposure_s == pytest.approx(0.01)


@pytest.mark.parametrize(
    "camera", [EIGHT_BITS, MONO, SIXTEEN_BITS], ids=["8 bit", "12 bit", "16 bit"]
)
def test_libraw_reads_every_pixel_of_a_camera_without_filters(
    tmp_path: Path, camera: ms.Camera
) -> None:
    photons = np.random.default_rng(1).uniform(0.0, 2 * camera.pixel.full_well_e, SIZE)
    frames = saved(tmp_path / "a.dng", camera, photons)
    assert frames.digital.dtype == (np.uint8 if camera is EIGHT_BITS else np.uint16)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        np.testing.assert_array_equal(raw.raw_image, frames.digital[0])
        assert raw.num_colors == 1 and raw.postprocess().shape == (*SIZE, 1)
    tags = dng_tags(tmp_path / "a.dng")
    assert tags["PhotometricInterpretation"] == 34892 and "CFAPattern" not in tags
    assert len(tags["NoiseProfile"]) == 2 and tags["WhiteLevel"] == 2**camera.adc.bits - 1


def test_the_white_level_is_that_of_a_full_well_where_the_converter_goes_further(
    tmp_path: Path,
) -> None:
    """10 000 e- at K = 0.2 DN/e- over a black level of 100.5 DN, of 4096 codes; three channels above saturation."""
    fields = {"pixel.full_well_e": 10_000.0, "adc.full_scale_v": 4096 / 0.2 * 30e-6}
    fields |= {"adc.black_level_dn": 100.5, "pixel.prnu": 0.0}
    camera = BAYER.replace(**fields)
    frames = saved(tmp_path / "a.dng", camera, 1e6)
    tags = dng_tags(tmp_path / "a.dng")
    assert tags["WhiteLevel"] in (2100, 2101) and tags["BlackLevel"] == [100.5] * 4
    assert frames.digital.mean() == pytest.approx(tags["WhiteLevel"], abs=0.6)
    saved(tmp_path / "b.dng", camera.replace(**{"pixel.full_well_e": 1.0}))
    assert dng_tags(tmp_path / "b.dng")["WhiteLevel"] == 101, "above the black level"


def test_exposure_f_number_and_iso_stand_where_exif_has_them(tmp_path: Path) -> None:
    for iso, short in ((400, 400), (102_400, 65_535)):
        ladder = LADDER.replace(gains=[{**LADDER.gains[0].model_dump(), "iso": iso}])
        saved(tmp_path / "a.dng", ladder.at_gain(iso).replace(**{"lens.f_number": 1.8}), 10.0)
        with tifffile.TiffFile(tmp_path / "a.dng") as file:
            exif = file.pages.first.tags["ExifTag"].value
        assert exif["ExposureTime"] == (1, 100) and exif["FNumber"] == (9, 5)
        assert exif["ISOSpeedRatings"] == short and exif["RecommendedExposureIndex"] == iso
        with rawpy.imread(str(tmp_path / "a.dng")) as raw:
            assert raw.other.iso_speed == short  # LibRaw reads no larger one
    tags = dng_tags(tmp_path / "a.dng")
    assert tags["UniqueCameraModel"] == "sony_a7s2" and tags["Orientation"] == 1
    versions = (bytes(tags[f"DNG{name}Version"]) for name in ("", "Backward"))
    assert tuple(versions) == (b"\1\4\0\0", b"\1\1\0\0")


def test_a_camera_without_iso_numbers_has_the_speed_at_which_it_saturates(
    tmp_path: Path,
) -> None:
    """ISO 12232 in other terms: a metre of 1 lx of D65, photons counted every nanometre, fills the well 78/S times."""
    nm = np.arange(380.0, 781.0)
    table, y = (
        colour.SDS_ILLUMINANTS["D65"],
        colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy(),
    )
    power, y = (
        np.interp(nm, table.wavelengths, table.values),
        np.interp(nm, y.wavelengths, y.values[:, 1]),
    )
    photons = power / (683.0 * power @ y) / (constants.h * constants.c / (nm * 1e-9))
    electrons_per_lx_s = (BAYER.qe(nm) @ photons).max() * 5.86e-6**2
    saved(tmp_path / "a.dng", BAYER)
    expected = 78 * electrons_per_lx_s / BAYER.emva1288().saturation_e
    assert dng_tags(tmp_path / "a.dng")["ExifTag"]["ISOSpeedRatings"] == pytest.approx(
        expected, rel=0.01
    )


@pytest.mark.parametrize("number", [0, 1], ids=["A", "D65"])
def test_the_matrices_are_those_of_the_dng_specification(number: int) -> None:
    """Chapter 6 in colour-science's terms: ColorMatrix takes the illuminant's XYZ to the raw white; its inverse, and
    ForwardMatrix behind a white balance, take every patch near to what an observer sees."""
    name = ("A", "D65")[number]
    found, power = (
        calibrations(BAYER)[number],
        colour.SDS_ILLUMINANTS[name].copy().align(SHAPE).values,
    )
    assert found.light_source == (17, 21)[number]
    per_filter = BAYER.qe(SHAPE.wavelengths) * power * SHAPE.wavelengths
    neutral, white = (
        per_filter.sum(axis=1) / per_filter.sum(axis=1).max(),
        power @ OBSERVER / (power @ OBSERVER)[1],
    )
    np.testing.assert_allclose(found.to_raw @ white, neutral, atol=2e-3)
    raw, d50 = (
        PATCHES @ per_filter.T / per_filter.sum(axis=1).max(),
        colour.xy_to_XYZ([0.3457, 0.3585]),
    )
    to_d65 = partial(
        colour.chromatic_adaptation, XYZ_wr=colour.xy_to_XYZ(WHITE), transform="Bradford"
    )
    by_inverse = to_d65(raw @ np.linalg.inv(found.to_raw).T, white)
    by_forward = to_d65(raw / neutral @ found.to_xyz.T, d50)
    np.testing.assert_allclose(by_inverse, by_forward, atol=4e-3)
    for xyz in (by_inverse, by_forward):
        assert (
            distances(
                xyz @ colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB.T, seen(name)
            ).mean()
            < 1.2
        )


def test_white_is_as_shot_where_the_illuminant_is_known(tmp_path: Path) -> None:
    lamp = lit_by("A")
    photons = ms.Photons(np.ones((*SIZE, 1)) * lamp.power * MIDDLES, MIDDLES, illuminant=lamp)
    ms.expose(photons, BAYER, EXPOSURE).save_dng(tmp_path / "lamp.dng")
    per_filter = (BAYER.qe(MIDDLES) * lamp.power * MIDDLES).sum(axis=1)
    neutral = dng_tags(tmp_path / "lamp.dng")["AsShotNeutral"]
    np.testing.assert_allclose(neutral, per_filter / per_filter.max(), rtol=1e-6)
    saved(tmp_path / "unknown.dng", BAYER)
    assert "AsShotNeutral" not in dng_tags(tmp_path / "unknown.dng")


@pytest.mark.parametrize(
    ("camera", "photons"),
    [(BAYER, 20_000.0), exhaustive(BAYER, 0.0), exhaustive(MONO, 12_000.0), (EMCCD, 500.0)],
    ids=["filters", "dark", "mono", "EMCCD"],
)
def test_the_noise_profile_is_the_variance_of_64_frames(
    tmp_path: Path, camera: ms.Camera, photons: float
) -> None:
    """Within 1 %, behind each filter; of 20 000 pixels and 64 frames the variance is known to 0.2 %. The excess noise
    of the EMCCD doubles it."""
    camera = camera.replace(**{"readout.ve_nonlinearity": 0.0}) if camera is MONO else camera
    frames = ms.expose(np.full((100, 200), photons), camera, EXPOSURE, frames=64)
    frames.save_dng(tmp_path / "a.dng")
    tags = dng_tags(tmp_path / "a.dng")
    black, white = np.ravel(tags["BlackLevel"])[0], tags["WhiteLevel"]
    x = (frames.digital - black) / (white - black)
    filters = camera.filter_index((100, 200))
    for number in range(len(camera.filter_names)):
        s, o = tags["NoiseProfile"][2 * number : 2 * number + 2]
        own = x[:, filters == number]
        assert own.var(axis=0, ddof=1).mean() == pytest.approx(s * own.mean() + o, rel=0.01)


def test_the_camera_of_a_dng_can_be_imported(tmp_path: Path) -> None:
    """Gain exactly; its read noise has the rounding of the converter in it, 0.29 DN."""
    camera = BAYER.replace(**{"adc.bits": 14, "adc.black_level_dn": 256.0})
    saved(tmp_path / "a.dng", camera)
    found = import_camera(tmp_path / "a.dng")
    assert (found.name, found.adc.bits, found.adc.black_level_dn) == ("bayer_2mp", 14, 256.0)
    assert found.system_gain_dn_per_e == pytest.approx(camera.system_gain_dn_per_e, rel=1e-4)
    rounding_e = np.sqrt(1 / 12) / camera.system_gain_dn_per_e
    assert found.source_follower.read_noise_e == pytest.approx(
        np.hypot(6.83, rounding_e), rel=1e-3
    )


def test_the_command_line_writes_a_dng_of_every_frame_and_removes_older_ones(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dng, "SIDE_MIN", 4)  # this light has 12 × 16
    command = ("expose", light_file, "-o", tmp_path, "--exposure-s", 0.01)
    assert cli(*command, "--dng", "--frames", 3, "--first-frame", 8).exit_code == 0
    names = ["frame_0008.dng", "frame_0009.dng", "frame_0010.dng"]
    (tmp_path / "frame_mine.dng").write_text("kept")
    assert sorted(path.name for path in tmp_path.glob("*.dng")) == [*names, "frame_mine.dng"]
    pages = tifffile.imread(tmp_path / "frame.tiff")
    for page, name in zip(pages, names, strict=True):
        np.testing.assert_array_equal(page, tifffile.imread(tmp_path / name))
    assert cli(*command, "--dng").exit_code == 0
    assert sorted(path.name for path in tmp_path.glob("*.dng")) == [
        "frame.dng",
        "frame_mine.dng",
    ]
    assert cli(*command).exit_code == 0
    assert [path.name for path in tmp_path.glob("*.dng")] == ["frame_mine.dng"]


REFUSED = {
    "deep": (BAYER.replace(**{"adc.bits": 18}), SIZE, ("16", "18", "bayer_2mp")),
    "infrared": (RGBIR, SIZE, ("R, G, B, IR", "2 × 2")),
    "small": (MONO, (21, 60), ("21 × 60", "22 × 22")),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_dng_holds_is_a_sentence_that_names_the_tiff(tmp_path: Path, case: str) -> None:
    camera, shape, words = REFUSED[case]
    with pytest.raises(ms.InputError) as refused:
        ms.expose(np.full(shape, 100.0), camera, EXPOSURE).save_dng(tmp_path / "a.dng")
    assert all(word in str(refused.value) for word in ("frame.tiff", *words))
    assert "\n" not in str(refused.value) and not list(tmp_path.iterdir())


@pytest.mark.parametrize("more", [(), ("--render-noise", "per-frame")])
def test_a_dng_that_cannot_be_is_refused_before_the_render(
    scene_file: Path,
    tmp_path: Path,
    cli: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
    more: tuple[str, ...],
) -> None:
    monkeypatch.setattr(Scene, "render", lambda *_, **__: pytest.fail("rendered"))
    asked = ("--dng", "--set", "adc.bits=18", *more)
    done = cli("render", scene_file, "-o", tmp_path / "out", *asked)
    assert done.exit_code == 2 and "18" in done.stderr and not (tmp_path / "out").exists()


def test_a_frame_that_is_none_of_these_is_refused(tmp_path: Path) -> None:
    frames = ms.expose(np.full(SIZE, 100.0), MONO, EXPOSURE, frames=2)
    frames.save_dng(tmp_path / "a.dng", -1)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.dng"), frames.digital[1])
    with pytest.raises(ms.InputError, match="number is 2"):
        frames.save_dng(tmp_path / "b.dng", 2)
