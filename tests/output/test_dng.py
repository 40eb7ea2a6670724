"""DNGs as LibRaw, tifffile and this package's own importer read them: pixels, levels, mosaic, colours, noise."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest
import rawpy
import tifffile
from helpers.patches import MIDDLES, OBSERVER, PATCHES, SHAPE, WHITE, distances, lit_by, seen
from numpy.typing import NDArray
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
LADDER = ms.load_camera("sony_a7s2")


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
        assert (
            raw.black_level_per_channel == [4] * 4 and raw.white_level == 4095
        )  # 4σ of read noise; the last code
        assert (raw.other.shutter_speed, raw.other.aperture) == pytest.approx((0.01, 2.8))
        assert raw.postprocess().shape == (*SIZE, 3)
        crop = (
            raw.sizes.crop_left_margin,
            raw.sizes.crop_top_margin,
            raw.sizes.crop_width,
            raw.sizes.crop_height,
        )
        assert crop == (
            2,
            2,
            SIZE[1] - 4,
            SIZE[0] - 4,
        )  # Adobe's SDK warns of less at the edges
    back = read_raw(tmp_path / "a.dng")
    np.testing.assert_array_equal(back.frames, frames.digital)
    assert back.tile == tuple(map(tuple, names[:2, :2])) and back.exposure_s == pytest.approx(
        0.01
    )


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
    assert (
        tags["PhotometricInterpretation"] == 34892
        and "CFAPattern" not in tags
        and len(tags["NoiseProfile"]) == 2
    )
    assert dng_tags(tmp_path / "a.dng")["WhiteLevel"] == 2**camera.adc.bits - 1


def test_the_white_level_is_that_of_a_full_well_where_the_converter_goes_further(
    tmp_path: Path,
) -> None:
    """10 000 e- at K = 0.2 DN/e- over a black level of 100.5 DN, of 4096 codes; three channels above saturation."""
    fields = {
        "pixel.full_well_e": 10_000.0,
        "adc.full_scale_v": 4096 / 0.2 * 30e-6,
        "adc.black_level_dn": 100.5,
    }
    camera = BAYER.replace(**fields, **{"pixel.prnu": 0.0})
    frames = saved(tmp_path / "a.dng", camera, 1e6)
    tags = dng_tags(tmp_path / "a.dng")
    assert tags["WhiteLevel"] in (2100, 2101) and tags["BlackLevel"] == [100.5] * 4
    assert frames.digital.mean() == pytest.approx(tags["WhiteLevel"], abs=0.6)
    saved(tmp_path / "b.dng", camera.replace(**{"pixel.full_well_e": 1.0}))
    assert dng_tags(tmp_path / "b.dng")["WhiteLevel"] == 101, (
        "above the black level, however small a full well is"
    )


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
    assert (
        bytes(tags["DNGVersion"]) == b"\1\4\0\0"
        and bytes(tags["DNGBackwardVersion"]) == b"\1\1\0\0"
    )


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


# Colours.


def chart(name: str) -> ms.Photons:
    """The 24 patches under an illuminant, blocks of 24 pixels, white near saturation."""
    light = lit_by(name)
    photons = (
        np.stack([np.interp(MIDDLES, SHAPE.wavelengths, one) for one in PATCHES])
        * light.power
        * MIDDLES
    )
    photons *= 29_000 / (photons @ BAYER.qe(MIDDLES).T).max()
    blocks = photons.reshape(4, 6, -1).repeat(24, axis=0).repeat(24, axis=1)
    return ms.Photons(blocks, MIDDLES, illuminant=light)


def developed(path: Path, **how: Any) -> NDArray[np.float64]:
    """(24, 3) linear sRGB of the patches' middles, as LibRaw develops them."""
    with rawpy.imread(str(path)) as raw:
        done = raw.postprocess(no_auto_bright=True, output_bps=16, gamma=(1, 1), **how) / 65535
    return np.asarray(
        done.reshape(4, 24, 6, 24, 3)[:, 6:18, :, 6:18].mean(axis=(1, 3)).reshape(24, 3)
    )


@pytest.mark.parametrize(("name", "mean", "largest"), [("D65", 1.1, 4.0), ("A", 4.0, 12.0)])
def test_libraw_gives_a_color_checker_its_colours(
    tmp_path: Path, name: str, mean: float, largest: float
) -> None:
    """LibRaw takes the matrix of D65 whatever the light is, so it is further off under lamps."""
    ms.expose(chart(name), BAYER, EXPOSURE).save_dng(tmp_path / "a.dng")
    off = distances(developed(tmp_path / "a.dng", use_camera_wb=True), seen(name))
    assert off.mean() < mean and off.max() < largest


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
    ms.expose(chart("A"), BAYER, EXPOSURE).save_dng(tmp_path / "lamp.dng")
    per_filter = (BAYER.qe(MIDDLES) * lit_by("A").power * MIDDLES).sum(axis=1)
    neutral = dng_tags(tmp_path / "lamp.dng")["AsShotNeutral"]
    np.testing.assert_allclose(neutral, per_filter / per_filter.max(), rtol=1e-6)
    saved(tmp_path / "unknown.dng", BAYER)
    assert "AsShotNeutral" not in dng_tags(tmp_path / "unknown.dng")


# Noise.


@pytest.mark.parametrize(
    ("camera", "photons"), [(BAYER, 20_000.0), (BAYER, 0.0), (MONO, 12_000.0)]
)
def test_the_noise_profile_is_the_variance_of_64_frames(
    tmp_path: Path, camera: ms.Camera, photons: float
) -> None:
    """Within 1 %, behind each filter; of 20 000 pixels and 64 frames the variance is known to 0.2 %."""
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


def test_a_camera_without_shot_noise_says_no_noise(
    tmp_path: Path,
) -> None:
    saved(tmp_path / "a.dng", BAYER.without("shot_noise"))
    assert "NoiseProfile" not in dng_tags(tmp_path / "a.dng")


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


# Files.


def test_the_command_line_writes_a_dng_of_every_frame_and_removes_older_ones(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dng, "FEWEST_PIXELS", 4)  # this light has 12 × 16
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
    "deep": (
        BAYER.replace(**{"adc.bits": 18}),
        SIZE,
        "a DNG has 16 bits at most, and bayer_2mp has 18; leave dng",
    ),
    "infrared": (
        RGBIR,
        SIZE,
        "filters R, G, B, IR in a tile of 2 × 2, and a DNG is read with red, green and blue",
    ),
    "small": (
        MONO,
        (21, 60),
        "21 × 60 pixels is too small for a DNG: LibRaw opens 22 × 22 and more; leave dng out",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_dng_holds_is_a_sentence_that_names_the_tiff(tmp_path: Path, case: str) -> None:
    camera, shape, said = REFUSED[case]
    with pytest.raises(ms.InputError, match=re.escape(said)) as refused:
        ms.expose(np.full(shape, 100.0), camera, EXPOSURE).save_dng(tmp_path / "a.dng")
    assert (
        "frame.tiff" in str(refused.value)
        and "\n" not in str(refused.value)
        and not list(tmp_path.iterdir())
    )


@pytest.mark.parametrize("more", [(), ("--render-noise", "per-frame")])
def test_a_dng_that_cannot_be_is_refused_before_the_render(
    scene_file: Path,
    tmp_path: Path,
    cli: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
    more: tuple[str, ...],
) -> None:
    monkeypatch.setattr(Scene, "render", lambda *_, **__: pytest.fail("rendered"))
    done = cli(
        "render", scene_file, "-o", tmp_path / "out", "--dng", "--set", "adc.bits=18", *more
    )
    assert done.exit_code == 2 and "a DNG has 16 bits at most" in " ".join(done.stderr.split())
    assert not (tmp_path / "out").exists()


def test_a_frame_that_is_none_of_these_is_refused(tmp_path: Path) -> None:
    frames = ms.expose(np.full(SIZE, 100.0), MONO, EXPOSURE, frames=2)
    frames.save_dng(tmp_path / "a.dng", -1)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.dng"), frames.digital[1])
    with pytest.raises(
        ms.InputError, match=r"number is 2; the frames are numbered from 0 to 1\."
    ):
        frames.save_dng(tmp_path / "b.dng", 2)
