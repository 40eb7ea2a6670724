"""Light groups: their sum is the render of the whole, at any levels, in memory and in irradiance.exr."""

from __future__ import annotations

import ast
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive
from helpers.scenes import write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.core.id_groups import groups_of_ids
from mitsuba_sensor.output.exr import read_irradiance_exr, write_irradiance_exr
from mitsuba_sensor.render.light.light_sum import notes_of_groups
from mitsuba_sensor.render.passes import prepared as prepared_module
from mitsuba_sensor.render.passes.prepared import prepare
from mitsuba_sensor.render.passes.stop_criterion import RenderProgress
from mitsuba_sensor.render.scene.asked import checked_light_groups
from mitsuba_sensor.render.scene.light_groups import light_groups_of
from mitsuba_sensor.render.scene.parse_scene import parse

CAMERA = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(1e-4)
VIEW = """<sensor type="perspective"><float name="fov" value="50"/><transform name="to_world">
<lookat origin="0, 1, 4" target="0, 0.8, 0" up="0, 1, 0"/></transform><film type="hdrfilm">
<integer name="width" value="24"/><integer name="height" value="18"/><rfilter type="box"/></film></sensor>"""
FLOOR = """<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="5"/>
</transform><bsdf type="diffuse"/></shape>"""
AREA = """<shape type="rectangle" id="area"><transform name="to_world"><scale value="0.5"/>
<translate x="0.8" y="1.2"/></transform>
<emitter type="area"><spectrum name="radiance" value="0.02"/></emitter></shape>"""
BALL = """<shape type="sphere" id="lamp_1"><float name="radius" value="0.3"/>
<point name="center" x="-0.8" y="1.2" z="0"/>
<emitter type="area"><spectrum name="radiance" value="400:0.01, 700:0.05"/></emitter></shape>"""
SPOT = """<emitter type="point" id="lamp_2"><point name="position" x="0" y="1.6" z="1"/>
<spectrum name="intensity" value="0.03"/></emitter>"""
SKY = '<emitter type="constant" id="env"><spectrum name="radiance" value="0.005"/></emitter>'
SCENES = {
    "area and sky": (AREA, SKY),
    "lamps": (BALL, SPOT),
    "all": (AREA, BALL, SPOT, SKY),
}
QUICK: dict[str, Any] = {"progress": False, "wavelength_nm": 550.0, "spp": 16, "denoise": False}


def scene_of(folder: Path, name: str, *, integrator: str = '<integrator type="path"/>') -> Path:
    text = f'<scene version="3.0.0">{integrator}{VIEW}{FLOOR}{"".join(SCENES[name])}</scene>'
    return write_scene(folder, text)


@pytest.fixture(scope="module")
def light(tmp_path_factory: pytest.TempPathFactory) -> ms.Irradiance:
    """Three groups of one scene: area and lamps, and what no pattern names."""
    scene = scene_of(tmp_path_factory.mktemp("groups"), "all")
    groups = {"area": "area", "lamps": "lamp_*"}
    return ms.render(scene, CAMERA, EXPOSURE, light_groups=groups, **QUICK)


@pytest.mark.parametrize("name", [exhaustive("area and sky"), exhaustive("lamps"), "all"])
def test_light_that_is_seen_directly_adds_up_to_the_whole_at_equal_seeds(
    name: str, tmp_path: Path
) -> None:
    """Without reflections all groups have the same light paths, so that only rounding is left: 1e-6."""
    scene = scene_of(
        tmp_path,
        name,
        integrator='<integrator type="path"><integer name="max_depth" value="1"/></integrator>',
    )
    options: dict[str, Any] = {"wavelength_nm": 550.0, "light_groups": "auto"}
    whole = prepare(scene, CAMERA, EXPOSURE, **options)
    parts = [whole.of_light_group(group) for group in whole.light_groups]
    assert len(parts) == len(SCENES[name])
    together, *apart = (one.at_rest.render(3, 16, (0, 18)) for one in (whole, *parts))
    assert together.max() > 0
    np.testing.assert_allclose(sum(apart), together, rtol=1e-6, atol=1e-6 * together.max())


@pytest.mark.parametrize("name", [exhaustive("area and sky"), exhaustive("lamps"), "all"])
def test_the_sum_is_the_render_of_the_whole_within_its_errors(
    name: str, tmp_path: Path
) -> None:
    """Both sums over the picture, and their difference: |z| < 4, which chance fails once in 16 000."""
    scene = scene_of(tmp_path, name)
    grouped = ms.render(scene, CAMERA, EXPOSURE, light_groups="auto", seed=5, **QUICK)
    whole = ms.render(scene, CAMERA, EXPOSURE, seed=6, **QUICK)
    sums = [float(one.data.sum(dtype=float)) for one in (grouped, whole)]
    errors = [
        one.error_of_sum() * total for one, total in zip((grouped, whole), sums, strict=True)
    ]
    assert abs(sums[0] - sums[1]) < 4 * math.hypot(*errors)
    assert errors[0] / sums[0] < 0.05


def test_groups_are_named_by_patterns_and_the_rest_is_other(light: ms.Irradiance) -> None:
    assert list(light.groups) == ["area", "lamps", "other"]
    assert light.levels == {"area": 1.0, "lamps": 1.0, "other": 1.0}
    assert "light groups area 1, lamps 1, other 1" in repr(light)


def test_auto_makes_a_group_of_each_emitter_with_an_id(tmp_path: Path) -> None:
    nameless = '<emitter type="constant"><spectrum name="radiance" value="0.005"/></emitter>'
    text = f'<scene version="3.0.0">{VIEW}{FLOOR}{AREA}{SPOT}{nameless}</scene>'
    prepared = prepare(write_scene(tmp_path, text), CAMERA, EXPOSURE, light_groups="auto")
    assert {group.name for group in prepared.light_groups} == {"area", "lamp_2", "other"}


def test_levels_scale_each_group_and_errors_add_in_squares(light: ms.Irradiance) -> None:
    levels = {"area": 0.25, "lamps": 3.0, "other": 0.0}
    changed = light.with_lights(levels)
    expected = sum(levels[name] * one.data for name, one in light.groups.items())
    np.testing.assert_allclose(changed.data, expected, rtol=1e-5)
    squares = sum((levels[n] * one.standard_error) ** 2 for n, one in light.groups.items())
    np.testing.assert_allclose(changed.standard_error, np.sqrt(squares), rtol=1e-5)
    lit = changed.data[..., 0] > 0
    errors = [
        levels[n] * one.data[lit, 0] * one.relative_error[lit]
        for n, one in light.groups.items()
    ]
    relative = np.sqrt(np.square(errors).sum(axis=0)) / changed.data[lit, 0]
    np.testing.assert_allclose(changed.relative_error[lit], relative, rtol=1e-3)
    assert changed.with_lights().data == pytest.approx(light.data, rel=1e-6)


def test_a_group_that_is_off_is_darkness_and_all_off_is_a_dark_frame(
    light: ms.Irradiance,
) -> None:
    dark = light.with_lights(area=0, lamps=0, other=0)
    assert not dark.data.any() and not dark.relative_error.any()
    frames = ms.expose(dark, CAMERA, ms.Exposure(0.0))
    black = ms.expose(np.zeros(dark.data.shape[:2]), CAMERA, ms.Exposure(0.0))
    np.testing.assert_array_equal(frames.digital, black.digital)


@pytest.mark.parametrize("half", [False, True])
def test_a_file_keeps_the_groups(half: bool, light: ms.Irradiance, tmp_path: Path) -> None:
    file = tmp_path / "irradiance.exr"
    write_irradiance_exr(file, light, half)
    again = read_irradiance_exr(file)
    assert list(again.groups) == list(light.groups)
    tolerance = 1e-3 if half else 1e-7
    for name, one in light.groups.items():
        np.testing.assert_allclose(again.groups[name].data, one.data, rtol=tolerance)
        assert again.groups[name].statistics == one.statistics
    relit, expected = (one.with_lights(lamps=0.2, other=2) for one in (again, light))
    np.testing.assert_allclose(relit.data, expected.data, rtol=tolerance)
    np.testing.assert_allclose(relit.relative_error, expected.relative_error, rtol=1e-3)


def test_expose_takes_levels_of_the_command_line(light: ms.Irradiance, tmp_path: Path) -> None:
    file = tmp_path / "irradiance.exr"
    write_irradiance_exr(file, light)
    captured = ms.capture(file, lights=["lamps=0.2", "other=0"], exposure=EXPOSURE)
    expected = ms.expose(light.with_lights(lamps=0.2, other=0), exposure=EXPOSURE)
    np.testing.assert_array_equal(captured.frames.digital, expected.digital)
    assert captured.metadata["options"]["lights"] == {"lamps": 0.2, "other": 0.0}


@pytest.mark.parametrize(
    ("exposure", "lights"),
    [
        ("auto", {"lamps": 0.2, "other": 0.5}),
        (EXPOSURE, {"lamps": "0.5 pwm(7000, 0.5)", "area": 2}),
    ],
)
def test_the_light_of_a_capture_is_that_of_its_frames(
    tmp_path: Path, exposure: Any, lights: dict[str, Any]
) -> None:
    """Exposed again it gives the same frames: levels, metered exposure and serial number are those of the capture. The
    file keeps the groups as they were rendered."""
    scene = scene_of(tmp_path, "all")
    options = {**QUICK, "light_groups": {"area": "area", "lamps": "lamp_*"}, "serial": 7}
    captured = ms.capture(scene, CAMERA, exposure, lights=lights, **options)
    again = ms.expose(captured.light)
    np.testing.assert_array_equal(again.digital, captured.frames.digital)
    time_s = captured.frames.first.exposure.time_s
    assert captured.light.rendered_for.exposure.time_s == time_s
    if exposure == "auto":
        assert captured.metadata["origin"]["metering"]["exposure_s"] == time_s
    captured.save(tmp_path / "out")
    kept = read_irradiance_exr(tmp_path / "out" / "irradiance.exr")
    np.testing.assert_array_equal(kept.data, captured.light.with_lights().data)
    from_file = ms.expose(kept.with_lights(lights))
    np.testing.assert_array_equal(from_file.digital, captured.frames.digital)


def test_notes_of_groups_that_are_off_are_left_out_and_equal_ones_are_one(
    light: ms.Irradiance, tmp_path: Path
) -> None:
    """Also when levels change again, when lamps flicker, and from a file."""
    notes = {"area": ("all", "two"), "lamps": ("all", "two", "own"), "other": ("all",)}
    groups = {
        name: replace(one, statistics=replace(one.statistics, notes=notes[name]))
        for name, one in light.groups.items()
    }
    of_sum = ("scene", *notes_of_groups(notes))
    assert of_sum == ("scene", "all", "area, lamps: two", "lamps: own")
    noted = replace(light, groups=groups, statistics=replace(light.statistics, notes=of_sum))
    write_irradiance_exr(tmp_path / "irradiance.exr", noted)
    for one in (noted, ms.read_irradiance(tmp_path / "irradiance.exr")):
        assert one.notes == one.with_lights(lamps=0).with_lights().notes == of_sum
        assert one.with_lights(lamps=0).notes == ("scene", "all", "area: two")
        assert one.with_lights(area=0, lamps=0).notes == ("scene", "all")
        flickering = one.with_lights(lamps=0, other=ms.pwm(100, 0.5))
        frames = ms.expose(flickering, CAMERA, EXPOSURE)
        assert frames.notes[:3] == ("scene", "all", "area: two")


RED, BLUE = (
    f"""<emitter type="point" id="{name}"><point name="position" x="{x}" y="2" z="1"/>
    <spectrum name="intensity" value="{spectrum}"/></emitter>"""
    for name, x, spectrum in (
        ("red", 1, "400:0, 600:0.01, 700:0.05"),
        ("blue", -1, "400:0.05, 500:0.01, 700:0"),
    )
)


def test_the_illuminant_is_that_of_the_scene_and_follows_the_levels(tmp_path: Path) -> None:
    """Two lamps like mirror images in wavelength; of 2048 points each sees one of them at random, which makes 6 % of
    their ratio (1σ): 0.25 is 4σ. Weighed by electrons it was 0.74."""
    scene = write_scene(tmp_path, f'<scene version="3.0.0">{VIEW}{FLOOR}{RED}{BLUE}</scene>')
    camera = ms.load_camera("bayer_2mp")
    options: dict[str, Any] = {"spp": 8, "progress": False, "denoise": False}
    grouped = ms.render(scene, camera, EXPOSURE, light_groups="auto", **options)
    whole = ms.render(scene, camera, EXPOSURE, **options)

    def spectrum(light: ms.Irradiance) -> Any:
        assert light.rendered_for is not None and light.rendered_for.illuminant is not None
        power = light.rendered_for.illuminant.power
        return power / power.mean()

    spread = np.abs(spectrum(grouped) - spectrum(whole)).max() / spectrum(whole).max()
    assert spread < 0.25
    alone = grouped.with_lights(blue=0)
    red = grouped.groups["red"]
    np.testing.assert_allclose(spectrum(alone), spectrum(red), rtol=1e-12)
    mixed, parts = grouped.with_lights(red=3), [3 * red.rendered_for.illuminant.power]
    parts.append(grouped.groups["blue"].rendered_for.illuminant.power)
    np.testing.assert_allclose(mixed.rendered_for.illuminant.power, sum(parts), rtol=1e-12)


BAD = {
    "a level that is no number": (
        {"light_groups": "auto", "lights": {"env": True}},
        "must be a level or a waveform",
    ),
    "no such emitter": (
        {"light_groups": "lamp=lamb_1"},
        r"no emitter is named lamb_1 .*lamp_1",
    ),
    "in two groups": (
        {"light_groups": {"a": "lamp_*", "b": "lamp_1"}},
        "in the groups a and b",
    ),
    "no pattern": ({"light_groups": "sky"}, "light_groups has 'sky'"),
    "no groups": ({"light_groups": {}}, "pass 'auto'"),
    "a number": ({"light_groups": 3}, "pass 'auto'"),
    "a name with a dot": ({"light_groups": {"a.b": "env"}}, "give a name of letters"),
    "unknown level": (
        {"light_groups": "auto", "lights": {"skies": 1}},
        "no light group 'skies'",
    ),
    "negative level": ({"light_groups": "auto", "lights": {"env": -1}}, "the level of env"),
    "no level": ({"lights": ["env"]}, "must be a level or a waveform"),
    "no groups to change": ({"lights": {"env": 1}}, "light_groups='auto'"),
    "a render for each frame": (
        {"lights": {"env": 1}, "render_noise": "per-frame"},
        "omit one of them",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_groups_and_levels_are_refused_with_the_way_out(case: str, tmp_path: Path) -> None:
    """Before any pass is rendered."""
    options, sentence = BAD[case]
    options = {"spp": 1, "wavelength_nm": 550.0, "denoise": False, **options}
    told = list[RenderProgress]()
    with pytest.raises(ms.InputError, match=sentence):
        ms.capture(scene_of(tmp_path, "all"), CAMERA, EXPOSURE, progress=told.append, **options)
    assert not told


def test_a_scene_that_is_loaded_already_cannot_be_taken_apart() -> None:
    import mitsuba as mi

    text = f'<scene version="3.0.0">{VIEW}{FLOOR}{AREA}</scene>'
    ms.render(text, CAMERA, EXPOSURE, **{**QUICK, "spp": 1})  # sets a variant
    with pytest.raises(ms.InputError, match="loaded already"):
        ms.render(mi.load_string(text), CAMERA, EXPOSURE, light_groups="auto", **QUICK)


def test_too_many_groups_are_refused_before_the_scene_is_loaded_with_those_that_its_ids_suggest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The night crossing has 19 emitters; what is suggested is accepted and has every one of them."""

    def load(*_: object, **__: object) -> None:
        raise AssertionError("the scene was loaded")

    monkeypatch.setattr(prepared_module, "load_scene", load)
    with pytest.raises(ms.InputError, match="makes 19 groups") as refused:
        ms.render("night_crossing", light_groups="auto")
    said = str(refused.value)
    groups = ast.literal_eval(re.findall(r"light_groups=(\{.*\})", said)[0])
    assert groups["lamp"] == "lamp_*" and groups["moon"] == "moon" and len(groups) <= 16
    scene = parse("night_crossing", {})
    found = light_groups_of(scene, checked_light_groups("light_groups", groups))
    assert [one.name for one in found] == list(groups)
    assert sum(len(one.emitters) for one in found) == 19


@pytest.mark.parametrize(
    ("ids", "groups"),
    [
        (["lamp_1", "sky", "lamp_2"], {"lamp": "lamp_*", "sky": "sky"}),
        (["lamp", "lamp_2"], {"lamp": "lamp,lamp_*"}),
        (["moon_shape"], {"moon_shape": "moon_shape"}),
        ([], {}),
    ],
)
def test_ids_that_begin_alike_are_a_group(ids: list[str], groups: dict[str, str]) -> None:
    assert groups_of_ids(ids) == groups


@pytest.mark.parametrize("spp", [4, 100])
def test_groups_share_the_samples_equally_and_more_than_were_asked_for_are_told(
    spp: int, tmp_path: Path
) -> None:
    """Three groups with 8 samples or more each take 24 where 4 were asked for."""
    scene = scene_of(tmp_path, "all")
    groups = {"area": "area", "lamps": "lamp_*"}
    light = ms.render(scene, CAMERA, EXPOSURE, light_groups=groups, **{**QUICK, "spp": spp})
    samples = [one.statistics.samples_per_pixel for one in light.groups.values()]
    assert len(set(samples)) == 1 and sum(samples) == light.statistics.samples_per_pixel
    assert sum(samples) == pytest.approx(max(spp, 24), rel=1 / 8)
    told = f"took {sum(samples)} samples per pixel in 3 light groups together instead of {spp}"
    assert any(note.startswith(told) for note in light.notes) == (sum(samples) != spp)
