"""What RGB colours reflect beyond 700 nm: held, refused or measured; and light as far as 2500 nm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import (
    scalar_first,
    scene_text,
    skip_unless_usable,
)

import mitsuba_sensor as ms
from mitsuba_sensor.render.scene.asked import materials
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use

VISIBLE = ms.load_camera("konnik_table1")  # 400 to 700 nm
INFRARED = VISIBLE.replace(
    **{
        "quantum_efficiency.curves": {"mono": (0.5, 0.5)},
        "quantum_efficiency.wavelengths_nm": (400, 1000),
    }
)
EXPOSURE = ms.Exposure(0.01)
FLAT = (
    '<emitter type="constant"><spectrum name="radiance" value="300:0.01, 2600:0.01"/></emitter>'
)
GREEN = (0.05, 0.3, 0.05)
RGB = '<rgb name="reflectance" value="0.05, 0.3, 0.05"/>'
GREY = '<spectrum name="reflectance" value="0.5"/>'
PLANE = (
    '<shape type="rectangle" id="leaf_1"><transform name="to_world"><scale value="9"/>'
    '<rotate x="0" y="1" z="0" angle="180"/><translate x="0" y="0" z="4"/></transform>'
    '<bsdf type="twosided"><bsdf type="diffuse" id="green">{}</bsdf></bsdf></shape>'
)
POT = '<shape type="sphere" id="pot"><point name="center" value="0, 0, 9"/><bsdf type="diffuse">{}</bsdf></shape>'
VEGETATION = {"leaf_*": "vegetation"}


def scene(reflectance: str, *more: str) -> str:
    """A plane that fills the picture, under a flat sky."""
    return scene_text(PLANE.format(reflectance), FLAT, *more)


def picture(folder: Path) -> str:
    """A picture of one green in place of the colour."""
    path = folder / "green.exr"
    use(choose_variant("scalar_spectral"))
    mitsuba().Bitmap(np.full((2, 2, 3), GREEN, np.float32)).write(str(path))
    file = f'<string name="filename" value="{path}"/>'
    return f'<texture type="bitmap" name="reflectance">{file}</texture>'


def radiance(text: str, nm: float = 850.0, **options: Any) -> float:
    """Mean light of a band of 2 nm, of arbitrary unit."""
    camera = INFRARED if nm > 701 else VISIBLE
    chosen: dict[str, Any] = {"variant": "scalar_spectral", **options}
    light = ms.render(
        text,
        camera,
        EXPOSURE,
        wavelength_nm=nm,
        bandwidth_nm=2,
        width=4,
        spp=32,
        denoise=False,
        **chosen,
    )
    return float(light.data.mean(dtype=float))


def reflectance(text: str, nm: float = 850.0, **options: Any) -> float:
    """Of the plane: that of grey is 0.5, with the same random numbers."""
    alike = {name: value for name, value in options.items() if name == "variant"}
    return 0.5 * radiance(text, nm, **options) / radiance(scene(GREY), nm, **alike)


@scalar_first
def test_leaf_green_is_held_at_its_value_at_700_nm_or_is_that_of_the_table(
    tmp_path: Path, variant: str
) -> None:
    """Mitsuba itself makes 0.0007 of it at 850 nm; a camera that ends at 700 nm has no rule and is the oracle."""
    skip_unless_usable(variant)
    at_700 = reflectance(scene(RGB), 700.0)
    measured = float(materials()["vegetation"].at(np.array(850.0)))
    for green in (RGB, picture(tmp_path)):
        assert reflectance(scene(green), variant=variant) == pytest.approx(at_700, rel=0.005)
        leaf = reflectance(scene(green), variant=variant, infrared=VEGETATION)
        assert leaf == pytest.approx(measured, rel=0.005)


def test_a_camera_that_sees_nothing_beyond_keeps_its_bytes(tmp_path: Path) -> None:
    """bayer_2mp ends at 710 nm: no rule acts, and none is a reason to refuse."""
    lights = [
        ms.render(
            scene(green),
            "bayer_2mp",
            EXPOSURE,
            width=4,
            spp=2,
            bandwidth_nm=100,
            variant="scalar_spectral",
            denoise=False,
            infrared=rule,
        )
        for green in (RGB, picture(tmp_path))
        for rule in ("refuse", ["leaf_*=vegetation"])
    ]
    for first, other in (lights[:2], lights[2:]):
        assert (first.data == other.data).all() and not first.statistics.beyond_data


def test_up_to_700_nm_a_colour_under_a_rule_is_mitsubas() -> None:
    """A band about 650 nm of a camera that sees as far as 1000 nm. The wavelengths that are drawn within the band leave
    0.14 % of noise (3.5 standard errors)."""
    many = {**SMALL, "spp": 1600}
    held = ms.render(scene(RGB), INFRARED, EXPOSURE, **many)
    plain = ms.render(scene(RGB), VISIBLE, EXPOSURE, **many)
    grey = [ms.render(scene(GREY), camera, EXPOSURE, **many) for camera in (INFRARED, VISIBLE)]
    at = [int(np.argmin(np.abs(light.wavelengths_nm - 655))) for light in (held, plain)]
    ratios = [
        light.data[..., band].mean() / one.data[..., band].mean()
        for light, one, band in zip((held, plain), grey, at, strict=True)
    ]
    assert ratios[0] == pytest.approx(ratios[1], rel=5e-3)


SMALL: dict[str, Any] = {"width": 4, "spp": 64, "variant": "scalar_spectral", "denoise": False}


def test_a_picture_of_a_lamp_is_held(tmp_path: Path) -> None:
    """Seen directly: at 850 nm it is as bright as at 700 nm."""
    lamp = (
        f'<emitter type="area">{picture(tmp_path).replace("reflectance", "radiance")}</emitter>'
    )
    text = scene_text(
        PLANE.replace('<bsdf type="twosided">', f'{lamp}<bsdf type="twosided">').format(GREY)
    )
    assert radiance(text) == pytest.approx(radiance(text, 700.0), rel=1e-3)


@pytest.mark.parametrize("pattern", ["green", "leaf_*", "le?f_1"])
def test_a_material_is_named_by_its_id_or_that_of_its_shape(pattern: str) -> None:
    assert "beyond 700 nm, where rgb in 1 place is 'soil'" in note_on_rgb(
        scene(RGB), {pattern: "soil"}
    )


def test_a_highlight_is_no_part_of_a_measured_reflectance() -> None:
    """The diffuse colour of plastic is measured, its specular colour is held."""
    colours = RGB.replace("reflectance", "diffuse_reflectance") + RGB.replace(
        "reflectance", "specular_reflectance"
    )
    pot = POT.format(colours).replace('type="diffuse"', 'type="plastic"')
    note = note_on_rgb(scene(GREY, pot), {"pot": "concrete"})
    for rule in ("is 'concrete'", "keeps its value at 700 nm"):
        assert f"rgb in 1 place {rule}" in note


def note_on_rgb(text: str, rule: object, **options: Any) -> str:
    """The only note of a render on colours."""
    light = ms.render(text, INFRARED, EXPOSURE, infrared=rule, **{**SMALL, "spp": 8}, **options)
    (note,) = (note for note in light.notes if "rgb" in note)
    return note


def test_the_photoelectrons_that_depend_on_a_rule_are_told_once_for_all_light_groups() -> None:
    text = scene(RGB, FLAT.replace("<emitter", '<emitter id="sky"'))
    note = note_on_rgb(text.replace(FLAT, "", 1), "hold", light_groups="auto")
    assert note.startswith("up to 9.0 % of the photoelectrons") and "(line 2); give" in note


def test_refusing_names_the_materials_and_where_they_are() -> None:
    with pytest.raises(ms.InputError, match=r"'green' \(line 2\), 'pot' \(line 2\)"):
        ms.render(scene(RGB, POT.format(RGB)), INFRARED, EXPOSURE, infrared="refuse", **SMALL)
    ms.render(scene(GREY), INFRARED, EXPOSURE, infrared="refuse", **{**SMALL, "spp": 4})


@pytest.mark.parametrize(
    ("rule", "sentence"),
    [
        ("grass", "infrared is 'grass'; pass 'hold', 'refuse', or materials"),
        (3, "infrared is 3; pass 'hold'"),
        ({"green": "grass"}, "infrared of 'green' is 'grass'; the materials are vegetation"),
        (
            "gren=soil",
            "named 'gren'; they are named green, leaf_1. Did you mean 'green'",
        ),
        (
            ["green=soil", "leaf_1=sand"],
            "'green' is named by 'green' and 'leaf_1'; name it once",
        ),
    ],
)
def test_a_rule_that_cannot_be_is_one_sentence(rule: object, sentence: str) -> None:
    with pytest.raises(ms.InputError) as error:
        ms.render(scene(RGB), INFRARED, EXPOSURE, infrared=rule, **SMALL)
    assert sentence in str(error.value)


@scalar_first
def test_a_colour_keeps_its_name_for_traverse(variant: str) -> None:
    """Set to its own coefficients it stays what it is, and is held as before."""
    mi = use(choose_variant(skip_unless_usable(variant)))
    coefficients = [float(c) for c in mi.srgb_model_fetch(mi.ScalarColor3f(*GREEN))]
    same = {"leaf_1.bsdf.brdf_0.reflectance.value": coefficients}
    at_700 = reflectance(scene(RGB), 700.0)
    held = reflectance(scene(RGB), variant=variant, traverse=same)
    assert held == pytest.approx(at_700, rel=0.005)


def test_the_measured_materials_begin_at_700_nm_and_have_sources() -> None:
    for material in materials().values():
        assert (
            material.wavelengths_nm[0] == 700 and (np.diff(material.wavelengths_nm) > 0).all()
        )
        assert material.wavelengths_nm.shape == material.reflectance.shape
        assert ((material.reflectance > 0) & (material.reflectance < 1)).all()
        assert len(material.source) > 20
    leaf, water = (materials()["vegetation"].at(np.array(nm)) for nm in (850.0, 1450.0))
    assert 0.4 < leaf < 0.6 and water < 0.2


BLACK_BODY_K = 1500.0
BLACK_BODY = (
    '<emitter type="constant"><spectrum type="blackbody" name="radiance"><float name="temperature" value="1500"/>'
    '<float name="wavelength_min" value="350"/><float name="wavelength_max" value="2550"/></spectrum></emitter>'
)
SWIR = ms.load_camera("sony_imx990").replace(**{"lens.f_number": 4.0})
NARROW = '<sensor type="perspective"><float name="fov" value="0.5"/>{more}<film type="hdrfilm">{film}</film></sensor>'
FILM = (
    '<integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/>'
)


def planck(wavelengths_nm: np.ndarray) -> np.ndarray:
    """Radiance of the black body [W m⁻² sr⁻¹ nm⁻¹], of the constants of CODATA 2018."""
    h, c, k = 6.62607015e-34, 299792458.0, 1.380649e-23
    metres = wavelengths_nm * 1e-9
    return 2e-9 * h * c**2 / metres**5 / np.expm1(h * c / (metres * k * BLACK_BODY_K))


def black_body(variant: str, **options: Any) -> ms.Irradiance:
    text = scene_text(BLACK_BODY, film=FILM, sensor=NARROW)
    return ms.render(text, SWIR, EXPOSURE, variant=variant, denoise=False, **options)


@scalar_first
def test_a_black_body_at_1550_nm_is_plancks(variant: str) -> None:
    """A sky of 1500 K, seen through a lens of f/4 focused at infinity: E = π·B·T/(4·N²). 256 strata of 10 nm."""
    skip_unless_usable(variant)
    light = black_body(variant, wavelength_nm=1550, bandwidth_nm=10, spp=256)
    nm = np.linspace(1545, 1555, 1001)
    expected = np.pi * planck(nm).mean() * SWIR.lens.transmission / (4 * 4.0**2)
    assert float(light.data.mean(dtype=float)) == pytest.approx(expected, rel=1e-3)
