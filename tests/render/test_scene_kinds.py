"""A scene as a path, as XML text, as a dict and as a loaded mi.Scene: the same picture, and one sentence where not."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest
from helpers.scenes import BALL, SCENES, SKY, scalar_first, skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.render.plugins import plugin_hook
from mitsuba_sensor.render.scene.parsed_scene import SCENES_OF_LOADED_EMITTERS
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
CORNELL = SCENES / "cornell_box.xml"
SMALL = {"width": "16", "height": "12"}
OPTIONS: Any = {"spp": 16, "bandwidth_nm": 50, "denoise": False}
OWN = (
    '<scene version="3.0.0"><sensor type="camera"><float name="focal_length_mm" value="0.05"/>'
    '<float name="f_number" value="2"/><float name="focus_distance_m" value="3"/>'
    '<spectrum name="transmission" value="400:0.5, 700:0.9"/><transform name="to_world"><translate z="-1"/></transform>'
    '<film type="photosensor"><string name="camera" value="konnik_table1"/><integer name="width" value="12"/>'
    '<integer name="height" value="8"/><integer name="crop_width" value="5"/><integer name="crop_offset_x" value="3"/>'
    '<float name="exposure_s" value="0.02"/><integer name="serial" value="7"/><integer name="adc.bits" value="14"/>'
    f"</film></sensor>{SKY}{BALL.format(bsdf='')}</scene>"
)


def ready(variant: str) -> Any:
    return use(choose_variant(skip_unless_usable(variant)))


def room(mi: Any) -> dict[str, Any]:
    """Mitsuba's own Cornell box, small."""
    scene = mi.cornell_box()
    scene["sensor"]["film"] |= {"width": 16, "height": 12}
    return scene  # type: ignore[no-any-return]


@scalar_first
def test_path_text_and_loaded_scene_of_one_file_are_the_same_picture(variant: str) -> None:
    """Bit for bit; two digests: a loaded scene says nothing of its file."""
    mi = ready(variant)
    text = CORNELL.read_text("utf-8")
    loaded = mi.load_file(str(CORNELL), optimize=False, **SMALL)
    asked = {**OPTIONS, "parameters": SMALL}
    path, as_text = (ms.render(one, CAMERA, EXPOSURE, **asked) for one in (CORNELL, text))
    np.testing.assert_array_equal(as_text.data, path.data)
    assert as_text.statistics.scene_sha256 == path.statistics.scene_sha256
    built = ms.render(loaded, CAMERA, EXPOSURE, **OPTIONS)
    np.testing.assert_array_equal(built.data, path.data)
    np.testing.assert_array_equal(built.standard_error, path.standard_error)


@scalar_first
def test_a_dict_and_what_mitsuba_loads_of_it_are_the_same_picture(variant: str) -> None:
    mi = ready(variant)
    given = ms.render(room(mi), CAMERA, EXPOSURE, **OPTIONS)
    built = ms.render(mi.load_dict(room(mi), optimize=False), CAMERA, EXPOSURE, **OPTIONS)
    np.testing.assert_array_equal(built.data, given.data)
    assert given.statistics.scene_sha256 != built.statistics.scene_sha256
    parts = room(mi)
    parts["integrator"], parts["light"]["emitter"] = (
        mi.load_dict(one) for one in (parts["integrator"], parts["light"]["emitter"])
    )
    np.testing.assert_array_equal(
        ms.render(parts, CAMERA, EXPOSURE, **OPTIONS).data, given.data
    )


def test_an_emitter_that_the_caller_keeps_does_not_crash_the_next_render() -> None:
    """Plain Mitsuba reads the freed shape of the emitter when it compiles the next kernel."""
    mi = ready("llvm_ad_spectral")
    parts = room(mi)
    kept = parts["light"]["emitter"] = mi.load_dict(parts["light"]["emitter"])
    ms.render(parts, CAMERA, EXPOSURE, **OPTIONS)
    parts.clear()
    gc.collect()
    filled = [np.full(2**size, 7.7) for size in range(4, 14) for _ in range(100)]
    assert ms.render(room(mi), CAMERA, EXPOSURE, **OPTIONS).data.min() >= 0
    assert kept is not None and len(filled) == 1000


def test_a_sky_that_the_caller_uses_again_and_again_keeps_no_scene() -> None:
    mi = ready("scalar_spectral")
    before, parts = len(SCENES_OF_LOADED_EMITTERS), room(mi)
    parts["sky"] = mi.load_dict({"type": "constant"})
    for _ in range(2):
        ms.render(parts, CAMERA, EXPOSURE, **OPTIONS)
    assert len(SCENES_OF_LOADED_EMITTERS) == before


def test_a_scene_of_our_plugins_keeps_camera_lens_crop_and_exposure_when_it_is_loaded() -> None:
    mi = ready("scalar_spectral")
    plugin_hook.register_plugins()
    from_text = ms.capture(OWN, **OPTIONS)
    loaded = ms.capture(mi.load_string(OWN), **OPTIONS)
    np.testing.assert_array_equal(loaded.frames.digital, from_text.frames.digital)
    known = loaded.light.rendered_for
    assert known is not None and known.exposure == ms.Exposure(0.02) and known.serial == 7
    assert (
        known.camera is not None
        and known.camera.adc.bits == 14
        and known.camera.lens.f_number == 2
    )
    assert loaded.light.origin == (0, 3) and loaded.light.data.shape[:2] == (8, 5)
    assert known.camera.lens.transmission_curve is not None


def test_a_dict_may_have_our_elements_and_fields_of_the_camera() -> None:
    """As in XML; mi.load_dict itself refuses the name of a field, because it has a dot."""
    mi = ready("scalar_spectral")
    size = {"width": 12, "height": 8, "crop_width": 5, "crop_offset_x": 3}
    film = {
        "type": "photosensor",
        "camera": "konnik_table1",
        **size,
        "exposure_s": 0.02,
        "serial": 7,
        "adc.bits": 14,
    }
    lens = {
        "type": "camera",
        "focal_length_mm": 0.05,
        "f_number": 2.0,
        "focus_distance_m": 3.0,
        "film": film,
    }
    glass = {"type": "spectrum", "value": [(400.0, 0.5), (700.0, 0.9)]}
    pose = mi.ScalarTransform4f().translate([0, 0, -1])
    sky = {
        "type": "constant",
        "radiance": {"type": "spectrum", "value": [(360.0, 2e-4), (830.0, 2e-4)]},
    }
    ball = {"type": "sphere", "center": [0, 0, 4]}
    given = {
        "type": "scene",
        "lens": {**lens, "transmission": glass, "to_world": pose},
        "sky": sky,
        "ball": ball,
    }
    np.testing.assert_array_equal(
        ms.capture(given, **OPTIONS).frames.digital, ms.capture(OWN, **OPTIONS).frames.digital
    )


def test_aovs_frames_of_their_own_and_a_user_s_film_are_left_as_they_were() -> None:
    """To the rounding of float32: threads of LLVM add the samples of a pixel in any order."""
    mi = ready("llvm_ad_spectral")
    scene = mi.load_dict(room(mi))
    before, names = (
        np.array(mi.render(scene, spp=4, seed=1)),
        [shape.id() for shape in scene.shapes()],
    )
    found = ms.capture(scene, CAMERA, EXPOSURE, aovs=True, **OPTIONS)
    assert (
        found.aovs is not None
        and np.isfinite(found.aovs.depth_m).any()
        and "red-wall" in found.aovs.shapes
    )
    assert [shape.id() for shape in scene.shapes()] == names
    each = list(ms.render_frames(scene, CAMERA, EXPOSURE, frames=2, spp=16))
    assert len(each) == 2 and each[0].frames.digital.shape == (1, 12, 16)
    np.testing.assert_allclose(
        np.array(mi.render(scene, spp=4, seed=1)), before, rtol=1e-5, atol=1e-9
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"parameters": {"width": 3}},
            "parameters is given and the scene is a loaded mi.Scene",
        ),
        (
            {"motion": "x.toml"},
            "motion is given and the scene is a loaded mi.Scene, which it cannot change; pass the",
        ),
        ({"integrator": "direct"}, "integrator is given and the scene is a loaded mi.Scene"),
        (
            {"variant": "scalar_spectral"},
            "loaded in variant 'llvm_ad_spectral', and 'scalar_spectral' is to render it",
        ),
    ],
)
def test_what_a_loaded_scene_cannot_do_is_one_sentence(
    options: dict[str, Any], said: str
) -> None:
    mi = ready("llvm_ad_spectral")
    with pytest.raises(ms.InputError, match=said):
        ms.render(mi.load_dict(room(mi)), CAMERA, EXPOSURE, **options)


def test_a_scene_of_another_variant_is_one_sentence() -> None:
    mi = ready("llvm_ad_spectral")
    compiled, bsdf = mi.load_dict(room(mi)), mi.load_dict({"type": "diffuse"})
    mi.set_variant("scalar_rgb")
    coloured = mi.load_dict(room(mi))
    mi.set_variant("scalar_spectral")
    for scene, said in (
        (coloured, "in variant 'scalar_rgb', which keeps no spectra"),
        (compiled, "in variant 'llvm_ad_spectral', and 'scalar_spectral' is to render it"),
        (
            {**room(mi), "white": bsdf},
            "'white' of the dict was made in variant 'llvm_ad_spectral'",
        ),
    ):
        with pytest.raises(ms.InputError, match=said):
            ms.render(scene, CAMERA, EXPOSURE)


def test_a_picture_in_a_dict_can_be_rendered_again_in_any_variant_and_counts_for_the_scene() -> (
    None
):
    """Plain Mitsuba takes the pixels out of the Bitmap that it is given: its second scene is black."""
    mi = ready("scalar_spectral")
    half, quarter = (mi.Bitmap(np.full((4, 4, 3), value, np.float32)) for value in (0.5, 0.25))

    def wall(picture: Any) -> dict[str, Any]:
        bsdf = {"type": "diffuse", "reflectance": {"type": "bitmap", "bitmap": picture}}
        return {**room(mi), "white": bsdf}

    first, again = (ms.render(wall(half), CAMERA, EXPOSURE, **OPTIONS) for _ in range(2))
    darker = ms.render(wall(quarter), CAMERA, EXPOSURE, **OPTIONS)
    np.testing.assert_array_equal(first.data, again.data)
    assert darker.data.mean() < first.data.mean()
    assert (
        first.statistics.scene_sha256
        == again.statistics.scene_sha256
        != darker.statistics.scene_sha256
    )
    compiled = ms.render(
        wall(half), CAMERA, EXPOSURE, variant=skip_unless_usable("llvm_ad_spectral"), **OPTIONS
    )
    assert compiled.data.mean() == pytest.approx(
        first.data.mean(), rel=0.5
    )  # noise: about 15 %


def test_what_is_no_scene_is_one_sentence() -> None:
    mi = ready("scalar_spectral")
    box = room(mi)
    aov = {"type": "aov", "aovs": "d:depth", "inner": {"type": "path"}}
    meter = {"type": "radiancemeter", "film": {"type": "hdrfilm", "width": 1, "height": 1}}
    dark = {"type": "scene", "light": {"type": "constant"}}
    path = mi.load_dict({"type": "path"})
    wrong: list[tuple[Any, dict[str, Any], str]] = [
        (3, {}, "scene is 3; pass a path, a name"),
        (None, {}, "scene is None"),
        ({}, {}, "the dict has type None"),
        (mi.load_dict({"type": "sphere"}), {}, "pass a path, a name"),
        (
            {"type": "scene", "sensor": {"type": "perspektive"}},
            {},
            "Did you mean 'perspective'",
        ),
        (dark, {}, "scene 'dict' has no sensor"),
        (mi.load_dict(dark), {}, "scene 'mi.Scene' has no sensor"),
        (
            {**box, "small-box": {"type": "ply", "filename": "no.ply"}},
            {},
            'no.ply .node "small-box"',
        ),
        ("<scene version='3.0.0'><sensor></scene>", {}, "XML text"),
        ("no_such.xml", {}, "there is no file 'no_such.xml'"),
        (mi.load_dict({**box, "integrator": aov}), {}, "AOVIntegrator, adds channels"),
        (
            mi.load_dict({**box, "integrator": {"type": "depth"}}),
            {},
            "does not compute radiance",
        ),
        (mi.load_dict({**box, "sensor": meter}), {}, "takes no image"),
        (box, {"parameters": {"a": 1}}, "<default> names of a scene in XML"),
        (
            {**box, "integrator": path},
            {"integrator": "direct"},
            "'integrator' of the dict is an integrator",
        ),
    ]
    for scene, options, said in wrong:
        with pytest.raises(ms.InputError, match=said) as error:
            ms.render(scene, CAMERA, EXPOSURE, **options)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["tensor", "bitmap"])
def test_pixels_in_a_dict_are_there_for_each_group_of_light(kind: str) -> None:
    """Each group builds the scene anew, and plugins take the pixels out of what they are given; the sum of the groups
    is the light of the whole, and the user's own tensor stays as it was."""
    mi = ready("scalar_spectral")
    pixels = np.full((2, 2, 1), 0.5, np.float32)
    pixels[0] = 0.1
    given = {"tensor": ("data", mi.TensorXf(pixels)), "bitmap": ("bitmap", mi.Bitmap(pixels))}
    name, value = given[kind]
    texture = {"type": "bitmap", name: value}
    film = {"type": "hdrfilm", "width": 8, "height": 8}
    pose = mi.ScalarTransform4f().translate([0, 0, 3]).rotate([0, 1, 0], 180)
    wall = {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": texture}}
    tree = {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "film": film,
            "to_world": pose,
        },
        "wall": wall,
        "sky": {"type": "constant", "id": "sky"},
        "lamp": {"type": "point", "id": "lamp", "position": [0, 0, 3]},
    }
    options: Any = {
        "spp": 16,
        "wavelength_nm": 550,
        "denoise": False,
        "variant": "scalar_spectral",
    }
    groups = ms.render(tree, CAMERA, EXPOSURE, light_groups="auto", **options)
    whole = ms.render(tree, CAMERA, EXPOSURE, **options)
    assert np.ptp(whole.data[2:6, 2:6]) > 0.5 * whole.data[2:6, 2:6].max()
    np.testing.assert_allclose(groups.data.mean(), whole.data.mean(), rtol=0.02)
    assert np.array(value).shape[:2] == (2, 2)
