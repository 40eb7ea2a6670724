"""Small inputs on which strangers found the product wrong, each with its right value or the sentence that it gets.

tests/data/cases has the inputs; README.md there and README in each folder tell what happened and what is right.
"""

from __future__ import annotations

import contextlib
import math
import re
import runpy
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import DATA
from helpers.marks import exhaustive
from helpers.scenes import skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.bench.figures_page import characterized
from mitsuba_sensor.lab.frames.bench import read_bench
from mitsuba_sensor.lab.measure.measurement import measure_bench
from mitsuba_sensor.output.importers.import_camera import import_camera
from mitsuba_sensor.render.lint.finding import Finding
from mitsuba_sensor.render.load.scene import inspect_scene
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use
from mitsuba_sensor.stages.gains import gain_dn_per_e

CASES = DATA / "cases"
Check = Callable[[], None]
CHECKS: dict[str, Check] = {}
"""Name of a case, the beginning of its file's or folder's name → what must hold."""

SKY = {
    "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 24, "height": 18}},
    "sky": {"type": "constant"},
}


def case(name: str) -> Callable[[Check], Check]:
    """Enter the decorated check into the table."""

    def enter(check: Check) -> Check:
        CHECKS[name] = check
        return check

    return enter


@case("12")
def darks_that_are_clipped() -> None:
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        runpy.run_path(str(CASES / "12_dark_clip.py"))
        (found,) = measure_bench(read_bench("bench12"))
    for symbol in (
        *("K", "η", "R", "LE", "σ_d", "DR", "µ_e.min", "σ_row", "ρ_1"),
        *("DSNU1288", "PRNU1288", "hot", "RTS"),
    ):
        figure = found.figures[symbol]
        assert math.isnan(figure.value) and figure.clipped, symbol
        assert "of the values are 0: the black level is too low" in figure.note, symbol
    assert {"σ_d", "dark current", "dark signal"} <= set(found.hidden)
    page = characterized("a camera", [found], {})
    assert not page.passed
    assert any("at the lowest or highest code: K, η" in text for text in page.findings)


@case("13")
def units_of_quantum_efficiency() -> None:
    table1 = ms.load_camera("konnik_table1")
    for name, said in (
        (
            "percent",
            "the largest quantum efficiency is 0.6 percent; if these are fractions, rename",
        ),
        ("um", "goes from 400 to 700 um; .* usual; if it is in nm, call it wavelength_nm"),
    ):
        with pytest.raises(ms.InputError, match=said):
            table1.replace(**{"quantum_efficiency.file": str(CASES / f"13_qe_{name}.csv")})


def means_of(name: str) -> tuple[tuple[int, ...], list[float]]:
    """Shape, and mean codes of R, G and B, of a frame of 10 ms of the light of another program."""
    camera, exposure = ms.load_camera("bayer_2mp"), ms.Exposure(0.01)
    light = ms.read_irradiance(CASES / name, unit="radiance_rgb", camera=camera)
    frame = ms.expose(ms.collect(light, camera, exposure), camera, exposure).digital[0]
    return frame.shape, [float(frame[y::2, x::2].mean()) for y, x in ((0, 0), (0, 1), (1, 1))]


GREY_MEANS = pytest.approx([319.55, 556.46, 343.66], abs=1.0)
"""Means of the same picture without layers, parts and overscan."""


@case("2026-11-29_10")
def exr_display_window() -> None:
    shape, means = means_of("2026-11-29_10_exr_display_window/overscan.exr")
    assert shape == (16, 24) and means == GREY_MEANS


@case("2026-11-29_11")
def exr_chromaticities() -> None:
    folder = "2026-11-29_11_exr_chromaticities"
    assert means_of(f"{folder}/ap1_red.exr")[1] == pytest.approx([449.5, 114.2, 46.0], abs=0.1)
    assert means_of(f"{folder}/srgb_red.exr")[1] == pytest.approx([286.5, 127.6, 56.0], abs=0.1)


@case("2026-11-29_12")
def exr_layers() -> None:
    for name in ("blender_multilayer", "multipart_depth_first"):
        assert means_of(f"2026-11-29_12_exr_layers/{name}.exr")[1] == GREY_MEANS


@case("2026-11-29_01")
def apertures_of_a_zemax_design() -> None:
    """A disk of 3 of 5 mm radius takes 9/25 of the light, and a hole of 3 mm is f/8.32, where 9/25 are left.

    The aberration of the pupil is 0.3 % at f/5, the noise of the render 0.1 % in any variant.
    """
    scene = """<scene version="3.0.0"><integrator type="direct"/><sensor type="perspective"><film type="hdrfilm">
        <integer name="width" value="3"/><integer name="height" value="3"/></film></sensor>
        <emitter type="constant"><spectrum name="radiance" value="1e-3"/></emitter></scene>"""

    def light(name: str, f_number: float) -> float:
        lens = str(CASES / "2026-11-29_01_zemax_clap" / name)
        fields = {"lens.prescription": lens, "lens.f_number": f_number, "lens.focus_m": 1e3}
        camera = ms.load_camera("konnik_table1").replace(**fields)
        options = {"spp": 4096, "wavelength_nm": 587.56, "denoise": False, "progress": False}
        return float(ms.render(scene, camera, ms.Exposure(0.1), **options).data.mean())

    plain = light("plain.zmx", 5.0)
    assert light("obsc3.zmx", 5.0) == pytest.approx(0.64 * plain, rel=0.005)
    with pytest.raises(ms.InputError, match=r"at least 8\.32"):
        light("clap3.zmx", 5.0)
    assert light("clap3.zmx", 8.32) == pytest.approx(0.36 * plain, rel=0.005)


@case("2026-11-29_05")
def tuning_file_with_a_comma_before_a_bracket() -> None:
    folder = CASES / "2026-11-29_05_libcamera_trailing_comma"
    for name in ("tuning.json", "without_comma.json"):
        camera = import_camera(folder / name)
        assert gain_dn_per_e(camera) == pytest.approx(2.5**2 / 16, rel=1e-5)
        assert camera.adc.black_level_dn == 200
        assert "pisp (Raspberry Pi 5)" in camera.description


@case("2026-11-29_06")
def tuning_file_of_a_monochrome_sensor() -> None:
    camera = import_camera(CASES / "2026-11-29_06_libcamera_mono" / "sensor_mono.json")
    assert list(camera.quantum_efficiency.curves) == ["mono"]
    assert "a monochrome sensor" in camera.sources["quantum_efficiency.curves"]
    assert "bcm2835 (vc4, Raspberry Pi 0 to 4)" in camera.sources["adc.full_scale_v"]


@case("2026-11-29_14")
def flat_fields_under_light_that_flickers_before_a_rolling_shutter() -> None:
    """Made with K 0.12 DN/e-, 7 e- of read noise and PRNU of 1 % in the pixels; the figures of rows are refused."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        make = CASES / "2026-11-29_14_flicker_prnu" / "make.py"
        runpy.run_path(str(make), run_name="__main__")
        (measured,) = ms.lab.measure_bench(ms.lab.read_bench(folder))
    figures = measured.figures
    for symbol, right in (("K", 0.12), ("PRNU1288_pixel", 1.0), ("σ_d", 7.0)):
        assert figures[symbol].covers(right)
        assert figures[symbol].high - figures[symbol].low < 0.04 * right
    for symbol in ("PRNU1288", "PRNU1288_row", "σ/µ"):
        assert math.isnan(figures[symbol].value)
        assert "flickering light in front of a rolling shutter" in figures[symbol].note
    assert any(
        "flickering light in front of a rolling shutter" in note for note in measured.notes
    )


def names_of_inputs() -> set[str]:
    """The numbers that inputs begin with: 01, 2026-11-29_01."""
    names = (re.match(r"(2026-11-29_)?\d\d(?=_)", path.name) for path in CASES.iterdir())
    return {name.group() for name in names if name}


def rendered(scene: Any, **options: Any) -> ms.Irradiance:
    """The light of a scene for konnik_table1."""
    options = {"spp": 4, "progress": False, **options}
    return ms.render(scene, "konnik_table1", ms.Exposure(0.01), seed=1, **options)


@case("09")
def _variant_left() -> None:
    """The variant that the user has set is the current one afterwards, and their scene renders."""
    mi = mitsuba()
    mi.set_variant("scalar_rgb")
    try:
        scene = mi.load_dict({"type": "scene", "i": {"type": "path"}, **SKY})
        rendered(CASES / "02_default_emitter.xml", variant="scalar_spectral")
        assert mi.variant() == "scalar_rgb"
        assert np.isfinite(mi.render(scene, spp=1)).all()
    finally:
        mi.set_variant("scalar_spectral")


@case("11")
def _dict_prb() -> None:
    """A dict with prb, whose primal image is that of path."""
    variant = skip_unless_usable("llvm_ad_spectral")
    scenes = ({"type": "scene", "i": {"type": name}, **SKY} for name in ("prb", "path"))
    one, other = (rendered(scene, variant=variant).data for scene in scenes)
    np.testing.assert_allclose(one, other, rtol=1e-5)


@case("2026-11-29_04")
def _far_spheres() -> None:
    """A sphere of reflectance ρ under a uniform sky has ρ of its radiance. Far away LLVM is wrong, and says so."""
    folder, llvm = CASES / "2026-11-29_04_far_sphere_llvm", "llvm_ad_spectral"
    skip_unless_usable(llvm)
    far = (folder / "far.xml").read_text(encoding="utf-8")

    def reflectances(scene: str, variant: str) -> tuple[Any, bool]:
        light = rendered(scene, variant=variant, spp=64, denoise=False)
        picture = light.data.sum(axis=-1)
        spheres = [picture[11:13, column : column + 2].mean() for column in (5, 11, 17)]
        found = any("too far from the sensor for float32" in note for note in light.notes)
        return spheres / picture[0].mean(), found

    clipped = far.replace('"1e5"', '"699994"')  # what the finding proposes
    near = (folder / "near.xml").read_text(encoding="utf-8")
    for scene, variant in ((near, llvm), (far, "scalar_spectral"), (clipped, llvm)):
        of_spheres, found = reflectances(scene, variant)
        # Its neighbours hide some of the sky from each sphere.
        np.testing.assert_allclose(of_spheres, (0.8, 0.2, 0.6), rtol=0.07)
        assert not found
    of_spheres, found = reflectances(far, llvm)
    assert max(of_spheres / (0.8, 0.2, 0.6)) < 0.9 and found


def found(scene: Path, camera: str) -> list[Finding]:
    """What lint finds in a scene that is black or wrong."""
    use(choose_variant("scalar_spectral"))
    findings = inspect_scene(scene, ms.load_camera(camera), {})
    return [one for one in findings if one.level not in ("note", "fact")]


def small_render(scene: Path, camera: str, **options: Any) -> ms.Irradiance:
    """A small render of a scene."""
    asked = {"width": 8, "spp": 16, "variant": "scalar_spectral", "denoise": False, **options}
    return ms.render(scene, camera, ms.Exposure(0.01), seed=1, progress=False, **asked)


@case("01")
def prb_is_path() -> None:
    """Of both the mean over the picture, within 5 standard errors: chance fails one seed in a million."""
    variant = skip_unless_usable("llvm_ad_spectral")
    options = {"variant": variant, "wavelength_nm": 550, "spp": 64}
    scene = CASES / "01_prb_small_film.xml"
    prb = small_render(scene, "konnik_table1", **options)
    path = small_render(scene, "konnik_table1", integrator="path", **options)
    error = np.hypot(prb.standard_error, path.standard_error).astype(float)
    off = (prb.data.astype(float) - path.data).sum()
    assert abs(off) < 5 * np.sqrt((error**2).sum()) + 1e-6 * path.data.sum()


@case("02")
def a_default_emitter_is_d65() -> None:
    (finding,) = found(CASES / "02_default_emitter.xml", "rgbir_2mp")
    assert finding.level == "black" and "is black outside 360 to 830 nm" in finding.what


@case("03")
def the_sky_is_lit_from_320_to_720_nm() -> None:
    """Rendered at 340 nm, where it has light; refused at 800 nm, where it has none."""
    scene = CASES / "03_sunsky.xml"
    assert small_render(scene, "rgbir_2mp", wavelength_nm=340).data.mean() > 0
    with pytest.raises(ms.InputError, match="black outside 320 to 720 nm"):
        small_render(scene, "rgbir_2mp", wavelength_nm=800)
    assert any("outside 320 to 720 nm" in one.what for one in found(scene, "rgbir_2mp"))


@case("04")
def a_reflectance_in_percent_makes_light() -> None:
    """What is called wrong is wrong: a convex surface of reflectance 40 is 40 times as bright as the sky."""
    scene = CASES / "04_reflectance_percent.xml"
    (finding,) = found(scene, "konnik_table1")
    assert "'reflectance' in 1 place is as large as 40" in finding.what
    assert "percent" in finding.remedy
    light = small_render(scene, "konnik_table1", wavelength_nm=550).data
    assert light.max() / light[0, 0, 0] > 30


@case("05")
def a_metal_is_told_where_its_table_ends() -> None:
    notes = small_render(CASES / "05_conductor_nir.xml", "rgbir_2mp", bandwidth_nm=100).notes
    (note,) = (one for one in notes if "Mitsuba's table of 'Cr'" in one)
    assert "885.57 nm" in note and "its first and last values are held beyond" in note


@case("07")
def a_missing_attribute_is_refused() -> None:
    with pytest.raises(ms.InputError, match="has no attribute 'vertex_albedo'"):
        found(CASES / "07_attribute_missing.xml", "konnik_table1")


@case("2026-11-29_03")
def materials_that_depolarise_are_named() -> None:
    folder = CASES / "2026-11-29_03_plastic_polarizers"
    for kind in ("plastic", "principled", "roughdielectric", "roughplastic", "thindielectric"):
        (finding,) = found(folder / f"pol_{kind}.xml", "sony_imx250mzr")
        assert f"Mitsuba depolarises what {kind!r} reflects" in finding.what
        assert "pplastic" in finding.remedy and "dielectric" in finding.remedy
        assert found(folder / f"pol_{kind}.xml", "konnik_table1") == []
    assert found(folder / "pplastic_right.xml", "sony_imx250mzr") == []
    options = {"wavelength_nm": 550, "spp": 1, "variant": "scalar_spectral_polarized"}
    notes = small_render(folder / "pol_plastic.xml", "sony_imx250mzr", **options).notes
    assert any("Mitsuba depolarises what 'plastic'" in note for note in notes)


@case("2026-11-29_08")
def a_medium_needs_an_integrator_that_renders_it() -> None:
    """5 units of fog of 0.2 leave exp(−1) of the light in the middle; 4 standard errors of 6 400 paths are 7 %."""
    scene = CASES / "2026-11-29_08_path_ignores_medium" / "scene.xml"
    (finding,) = found(scene, "konnik_table1")
    assert "integrator 'path' renders no media" in finding.what
    assert "volpath" in finding.remedy
    options = {"wavelength_nm": 550, "spp": 100}
    vacuum = small_render(scene, "konnik_table1", **options)
    assert any("renders no media" in note for note in vacuum.notes)
    fog = small_render(scene, "konnik_table1", integrator="volpath", **options)
    assert not any("media" in note for note in fog.notes)
    assert fog.data.mean() / vacuum.data.mean() == pytest.approx(np.exp(-1), rel=0.07)


@case("2026-11-29_09")
def an_area_emitter_without_a_shape_is_told() -> None:
    scene = CASES / "2026-11-29_09_area_emitter_without_shape" / "scene.xml"
    (finding,) = found(scene, "konnik_table1")
    assert "emitter 'area' is in no shape and gives no light" in finding.what
    assert finding.where == "line 6"


@case("2026-11-29_16")
def a_picture_as_a_lamp_is_no_d65() -> None:
    """The note is true: at 455 nm over 755 nm the picture is flat, <rgb> has the ratio of D65, and at 855 nm none."""
    folder, bands = CASES / "2026-11-29_16_picture_as_lamp", (455, 755)
    picture, rgb = (
        [small_render(folder / name, "rgbir_2mp", wavelength_nm=nm).data.mean() for nm in bands]
        for name in ("ir_tex.xml", "ir_rgb.xml")
    )
    assert picture[0] / picture[1] == pytest.approx(1, rel=0.02)
    assert rgb[0] / rgb[1] == pytest.approx(2.135, rel=0.02)  # CIE D65: 117.41 and 54.99
    options = {"wavelength_nm": 855}
    assert small_render(folder / "ir_tex.xml", "rgbir_2mp", **options).data.mean() > 0
    with pytest.raises(ms.InputError, match="has no light in the bands"):
        small_render(folder / "ir_rgb.xml", "rgbir_2mp", **options)
    notes = small_render(folder / "ir_tex.xml", "rgbir_2mp", bandwidth_nm=100).notes
    assert any(
        "a texture as a light in 1 place is not multiplied by D65" in one for one in notes
    )


KERNELS = {"2026-11-29_01"}
"""Cases that compile a kernel for each of several lenses."""


def test_each_input_has_a_row() -> None:
    assert CHECKS.keys() == names_of_inputs()


@pytest.mark.parametrize("name", [exhaustive(x) if x in KERNELS else x for x in sorted(CHECKS)])
def test_case(name: str) -> None:
    CHECKS[name]()
