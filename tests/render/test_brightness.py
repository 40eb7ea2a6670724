"""How bright a scene is to the eye, and one scale for all its light."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest
from helpers.scenes import BALL, PERSPECTIVE, SCENES, SKY, scalar_first, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.brightness import cd_per_m2

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.01)
BOX = SCENES / "cornell_box.xml"
PLAIN: dict[str, Any] = {"variant": "scalar_spectral", "denoise": False, "progress": False}
SMALL: dict[str, Any] = {**PLAIN, "width": 8, "spp": 16}
LAMP = """<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><translate z="9"/></transform>
<emitter type="area">{}</emitter></shape>"""


def luminance_of(radiance: float) -> float:
    """Of a flat spectrum [W m⁻² sr⁻¹ nm⁻¹ → cd/m²], by the table of colour-science."""
    photopic = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    return 683.002 * radiance * float(photopic.values[:, 1].sum())


def brightness(scene: Path, camera: ms.Camera = CAMERA, **options: Any) -> dict[str, Any]:
    light = ms.render(scene, camera, EXPOSURE, **{**SMALL, "width": None, **options})
    assert light.statistics.brightness is not None
    return light.statistics.brightness


@scalar_first
def test_a_flat_sky_has_its_luminance_in_the_picture_and_by_the_lens_on_the_sensor(
    tmp_path: Path, variant: str
) -> None:
    """E = L·T·π/(4N²)·cos⁴θ; without noise, because the sky is the same everywhere. The bands cover 99.97 % of V(λ)."""
    camera = CAMERA.replace(**{"lens.f_number": 4.0, "lens.transmission": 0.8})
    found = brightness(write_scene(tmp_path, scene_text(SKY)), camera, variant=variant)
    luminance = luminance_of(2e-4)
    tangents = math.tan(math.radians(30)) * (np.arange(12) - 5.5) / 6, (np.arange(8) - 3.5) / 6
    u, v = np.meshgrid(tangents[0], math.tan(math.radians(30)) * tangents[1])
    shading = float((1 / (1 + u**2 + v**2) ** 2).mean())
    on_axis = luminance * 0.8 * math.pi / (4 * 16)
    assert found["median_cd_per_m2"] == pytest.approx(luminance, rel=2e-3)
    assert found["illuminance_lx"] == pytest.approx(on_axis * shading, rel=5e-3)
    assert found["brightest_lamp_cd_per_m2"] is None and found["light_scale"] == 1


@scalar_first
@pytest.mark.parametrize(
    ("radiance", "luminance"),
    [
        ('<spectrum name="radiance" value="2"/>', None),
        ('<rgb name="radiance" value="12, 11, 9"/>', 11.069 * 72983),
        (
            '<texture type="checkerboard" name="radiance"><spectrum name="color0" value="360:1e-3, 830:1e-3"/>'
            '<spectrum name="color1" value="360:3, 830:3"/></texture>',
            luminance_of(3.0),
        ),
    ],
)
def test_the_brightest_lamp_is_looked_at_whether_in_the_picture_or_not(
    tmp_path: Path, variant: str, radiance: str, luminance: float | None
) -> None:
    """Y of linear sRGB 12, 11, 9 is 11.069 (IEC 61966-2-1); a float is a factor on D65, whose Y is as of a flat one."""
    dim = LAMP.format('<spectrum name="radiance" value="360:1e-3, 830:1e-3"/>')
    scene = write_scene(
        tmp_path, scene_text(SKY, dim, LAMP.format(radiance).replace('z="9"', 'z="-9"'))
    )
    found = brightness(scene, variant=variant)["brightest_lamp_cd_per_m2"]
    assert found == pytest.approx(luminance or 2 * 72983, rel=0.01)


@pytest.mark.parametrize("options", [{}, {"light_groups": "auto"}, {"spectral": "cube"}])
def test_the_picture_gets_the_luminance_that_is_asked_for_by_one_factor(
    options: dict[str, Any],
) -> None:
    """All bits but the factor are those of the render without it; the median is known to the noise of two renders."""
    plain, bright = (
        ms.render(BOX, CAMERA, EXPOSURE, **options, **SMALL, **scale)
        for scale in ({}, {"luminance": 500.0})
    )
    known = bright.statistics.brightness
    assert known is not None and plain.statistics.brightness is not None
    scale = known["light_scale"]
    assert scale is not None and scale != 1
    for name in ("data", "standard_error"):
        np.testing.assert_allclose(
            getattr(bright, name), scale * getattr(plain, name), rtol=1e-5, atol=1e-12
        )
    np.testing.assert_allclose(
        bright.relative_error, plain.relative_error, rtol=1e-4, atol=1e-6
    )
    for name in ("median_cd_per_m2", "illuminance_lx", "brightest_lamp_cd_per_m2"):
        before = plain.statistics.brightness[name]
        assert before is not None
        assert known[name] == pytest.approx(scale * before, rel=1e-4), name
    assert known["median_cd_per_m2"] == pytest.approx(500, rel=0.15)
    assert any(f"scaled by {scale:g}" in note for note in bright.notes)


def test_the_luminance_is_kept_in_all_files(tmp_path: Path) -> None:
    scene = write_scene(tmp_path, scene_text(SKY))
    options: dict[str, Any] = {**SMALL, "width": 8, "luminance": 320.0}
    captured = ms.capture(scene, CAMERA, EXPOSURE, **options)
    captured.save(tmp_path / "out")
    report = json.loads((tmp_path / "out" / "frame.json").read_text("utf-8"))
    again = ms.read_irradiance(tmp_path / "out" / "irradiance.exr").statistics.brightness
    assert report["render"]["brightness"] == again and again is not None
    assert again["median_cd_per_m2"] == pytest.approx(
        320, rel=3e-3
    )  # by noise within the bands
    assert again["light_scale"] == pytest.approx(320 / luminance_of(2e-4), rel=3e-3)
    assert report["options"]["luminance"] == 320


def test_all_frames_of_a_scene_that_moves_have_one_scale(tmp_path: Path) -> None:
    """A ball leaves the picture; each frame by its own median would change the sky."""
    ball = BALL.format(bsdf='<bsdf type="diffuse"/>').replace("<shape", '<shape id="ball"')
    scene = write_scene(tmp_path, scene_text(SKY, ball))
    motion = {"objects": {"ball": {"velocity_m_per_s": [40.0, 0, 0]}}}
    found = [
        ms.render(
            scene,
            CAMERA,
            EXPOSURE,
            motion=motion,
            start_s=start_s,
            luminance=100.0,
            **PLAIN,
            spp=16,
        )
        for start_s in (0.0, 1.0)
    ]
    scales = [
        one.statistics.brightness["light_scale"] for one in found if one.statistics.brightness
    ]
    assert scales[0] == scales[1] != 1


def test_what_has_no_luminance_is_refused_with_a_sentence(tmp_path: Path) -> None:
    sky = write_scene(tmp_path, scene_text(SKY))
    infrared = CAMERA.replace(
        **{
            "quantum_efficiency.curves": {"mono": [0.5, 0.5]},
            "quantum_efficiency.wavelengths_nm": [700, 800],
        }
    )
    for camera, options in (
        (CAMERA, {"wavelength_nm": 550}),
        (CAMERA, {"spectral": "channels"}),
        (CAMERA, {"bandwidth_nm": 100}),
        (infrared, {}),
    ):
        with pytest.raises(ms.InputError, match="luminance needs a render of adjacent bands"):
            ms.render(sky, camera, EXPOSURE, luminance=100, **options, **SMALL)
    assert brightness(sky, infrared)["median_cd_per_m2"] is None
    lamp = LAMP.format("").replace("<rotate", '<scale value="0.5"/><rotate')
    black = write_scene(tmp_path, scene_text(lamp))
    with pytest.raises(ms.InputError, match="median pixel of the image is black"):
        ms.render(black, CAMERA, EXPOSURE, luminance=100, **SMALL)
    for wrong in (0, -5, math.nan, math.inf, True, "bright"):
        with pytest.raises(ms.InputError, match="luminance is"):
            ms.render(sky, CAMERA, EXPOSURE, luminance=wrong, **SMALL)


def test_light_with_other_levels_keeps_its_scale_and_no_brightness() -> None:
    light = ms.render(BOX, CAMERA, EXPOSURE, light_groups="auto", luminance=50.0, **SMALL)
    assert light.statistics.brightness is not None
    name = next(iter(light.groups))
    off = light.with_lights({name: 0.5}).statistics.brightness
    assert off is not None and off["median_cd_per_m2"] is None
    assert off["light_scale"] == light.statistics.brightness["light_scale"] != 1


@pytest.mark.parametrize(
    ("sky", "lamp", "said"),
    [
        (2e-4, None, ()),
        (2.0, None, ("the image has",)),
        (1e5, None, ("the image has", "the metered exposure time is")),
        (2e-4, 2e3, ("the brightest lamp has",)),
    ],
)
def test_light_that_is_not_of_this_world_is_noted_with_the_way_out(
    tmp_path: Path, sky: float, lamp: float | None, said: tuple[str, ...]
) -> None:
    """146 000 cd/m²; 7.3e9 cd/m², metered to nanoseconds; a lamp of 1.5e8 cd/m² that is not in the picture."""
    lamps = (
        []
        if lamp is None
        else [LAMP.format(f'<spectrum name="radiance" value="360:{lamp}, 830:{lamp}"/>')]
    )
    hidden = [one.replace('z="9"', 'z="-9"') for one in lamps]
    scene = write_scene(tmp_path, scene_text(SKY.replace("2e-4", str(sky)), *hidden))
    light = ms.render(scene, CAMERA, "auto", **SMALL)
    found = [note for note in light.notes if "luminance=500" in note]
    assert len(found) == bool(said)
    parts = ("the image has", "the brightest lamp has", "the metered exposure time is")
    assert {part for part in parts if part in " ".join(found)} == {*said}


def test_lint_and_the_summary_say_how_bright_it_is(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    lamp = LAMP.format('<rgb name="radiance" value="12, 11, 9"/>')
    scene = write_scene(tmp_path, scene_text(SKY, lamp, film="<rfilter type='gaussian'/>"))
    said = "807\u00a0000 cd/m² (1.3 times as bright as the sun at the horizon)"
    findings = json.loads(cli("lint", scene, "--json").stdout)
    assert any(said in one["what"] and one["level"] == "fact" for one in findings)
    small = ("--spp", 16, "--no-denoise", "--variant", "scalar_spectral")
    printed = " ".join(cli("render", scene, "-o", tmp_path / "out", *small).stdout.split())
    assert said.replace("\u00a0", " ") in printed.replace("\u00a0", " ")
    assert "note: film" not in printed and "note: filter" not in printed
    report = json.loads((tmp_path / "out" / "frame.json").read_text("utf-8"))
    assert any("filter 'gaussian'" in one for one in report["render"]["facts"])
    assert not any("filter 'gaussian'" in one for one in report["notes"])


def test_a_luminance_is_compared_by_a_factor() -> None:
    sunlit = "2100 cd/m² (0.42 times as bright as a landscape in full sunlight)"
    assert cd_per_m2(2100.0) == sunlit


def test_several_sensors_refuse_a_scale_of_each_view(tmp_path: Path) -> None:
    scene = write_scene(tmp_path, scene_text(SKY, PERSPECTIVE.format(film="", more="")))
    with pytest.raises(ms.InputError, match=r"2 sensors .* would scale the light"):
        ms.capture(scene, CAMERA, EXPOSURE, sensor="all", luminance=10, **SMALL)
