"""Scene files of Mitsuba 0.3 to 2: what has an equivalent in version 3 renders as it, and every change is a note."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import BALL, PERSPECTIVE, SKY, scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.bands import box_bands
from mitsuba_sensor.render.scene.old_text import upgraded_text, version_of
from mitsuba_sensor.render.scene.parse_scene import parse_scene
from mitsuba_sensor.render.scene.scene import Scene, load_scene
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA = ms.load_camera("konnik_table1")
BANDS = box_bands(CAMERA, np.array([400.0, 500.0, 600.0, 700.0]))
PICTURE = '<texture type="bitmap" name="reflectance"><string name="filename" value="a.exr"/>{}</texture>'


@pytest.fixture(autouse=True)
def variant(tmp_path: Path) -> Any:
    mi = use(choose_variant(skip_unless_usable("scalar_spectral")))
    mi.Bitmap(np.linspace(0.1, 0.9, 48, dtype=np.float32).reshape(4, 4, 3)).write(
        str(tmp_path / "a.exr")
    )
    return mi


def loaded(folder: Path, *elements: str, version: str = "0.6.0", **options: Any) -> Scene:
    text = scene_text(*elements, **options).replace("3.0.0", version)
    return load_scene(write_scene(folder, text), BANDS, {})


def picture(scene: Scene) -> np.ndarray:
    return scene.render(1, 16, (0, 8)).astype(float)


def grey(bsdf: str) -> str:
    return BALL.format(bsdf=bsdf)


def diffuse(colour: str) -> str:
    return grey(f'<bsdf type="diffuse">{colour}</bsdf>')


def fog(inside: str, integrator: str) -> str:
    medium = f'<medium name="interior" type="homogeneous">{inside}</medium>'
    return f'{grey(medium + NOTHING)}<integrator type="{integrator}"/>'


NOTHING = '<bsdf type="null"/>'
LINEAR = 0.215861  # of 0x80: ((128/255 + 0.055)/1.055)^2.4, IEC 61966-2-1
PAIRS = {  # the old form, its version, and what it means in version 3
    "srgb": (
        diffuse('<srgb name="reflectance" value="#808080"/>'),
        diffuse(f'<rgb name="reflectance" value="{LINEAR}"/>'),
        "<srgb> in the terms of Mitsuba 3",
    ),
    "linear #rrggbb": (
        diffuse('<rgb name="reflectance" value="#ff3300"/>'),
        diffuse('<rgb name="reflectance" value="1, 0.2, 0"/>'),
        "<rgb> in the terms",
    ),
    "three numbers": (
        diffuse('<spectrum name="reflectance" value="0.1, 0.2, 0.3"/>'),
        diffuse('<rgb name="reflectance" value="0.1, 0.2, 0.3"/>'),
        "<spectrum> in the terms",
    ),
    "reflectance": (
        diffuse('<rgb name="diffuseReflectance" value="0.1, 0.2, 0.3"/>'),
        diffuse('<rgb name="reflectance" value="0.1, 0.2, 0.3"/>'),
        "",
    ),
    "trilinear": (
        diffuse(PICTURE.format('<string name="filterType" value="trilinear"/><float name="maxAnisotropy" value="8"/>')),
        diffuse(PICTURE.format("")),
        "filter_type 'trilinear' is 'bilinear' now",
    ),
    "wrap mode": (
        diffuse(PICTURE.format('<string name="wrapModeU" value="clamp"/>')),
        diffuse(PICTURE.format('<string name="wrap_mode" value="clamp"/>')),
        "'wrap_mode_u' is 'wrap_mode' now",
    ),
    "phong distribution": (
        grey('<bsdf type="roughconductor"><string name="distribution" value="phong"/></bsdf>'),
        grey('<bsdf type="roughconductor"><string name="distribution" value="beckmann"/></bsdf>'),
        "distribution 'phong' is 'beckmann' now",
    ),
    "normal map": (
        grey('<bsdf type="normalmap"><texture type="bitmap"><string name="filename" value="a.exr"/>'
             '<float name="gamma" value="1"/></texture><bsdf type="diffuse"/></bsdf>'),
        grey('<bsdf type="normalmap"><texture type="bitmap" name="normalmap"><string name="filename" value="a.exr"/>'
             '<boolean name="raw" value="true"/></texture><bsdf type="diffuse"/></bsdf>'),
        "the texture of a normalmap is read as numbers",
    ),
    "sky": (
        '<emitter type="sky"><float name="scale" value="2"/></emitter>',
        '<emitter type="sunsky"><float name="sun_scale" value="0"/><float name="sky_scale" value="2"/></emitter>',
        "emitter 'sky' is 'sunsky' without its sun now",
    ),
    "capital letters": (
        '<shape type="shapeGroup" id="g"><shape type="sphere"/></shape>'
        '<shape type="instance"><ref id="g"/><transform name="toWorld"><translate z="4"/></transform></shape>',
        '<shape type="sphere"><transform name="to_world"><translate z="4"/></transform></shape>',
        "'shapeGroup' is 'shapegroup' now",
    ),
    "luminaire": (
        grey('<luminaire type="area"><spectrum name="intensity" value="1"/></luminaire>'),
        grey('<emitter type="area"><spectrum name="radiance" value="1"/></emitter>'),
        "<luminaire> in the terms",
    ),
    "medium": (
        fog('<float name="sigmaS" value="1"/><float name="sigmaA" value="1"/>', "sppm"),
        fog('<float name="sigma_t" value="2"/><float name="albedo" value="0.5"/>', "volpath"),
        "integrator 'sppm' is 'volpath' now",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", PAIRS)
def test_the_old_form_renders_as_the_new_one_and_a_note_says_so(
    tmp_path: Path, name: str
) -> None:
    old, new, note = PAIRS[name]
    light = "" if name == "sky" else SKY
    found, expected = (
        loaded(tmp_path, light, old),
        loaded(tmp_path, light, new, version="3.0.0"),
    )
    np.testing.assert_allclose(picture(found), picture(expected), rtol=1e-4)
    assert not note or any(note in one for one in found.notes), found.notes


@pytest.mark.parametrize("kind", ["bdpt", "photonmapper", "sppm", "mlt", "vpl"])
def test_bidirectional_integrators_become_a_path_tracer_of_the_same_depth(
    tmp_path: Path, kind: str
) -> None:
    more = '<integer name="maxDepth" value="3"/><boolean name="lightImage" value="true"/>'
    found = loaded(
        tmp_path, SKY, BALL.format(bsdf=""), f'<integrator type="{kind}">{more}</integrator>'
    )
    expected = loaded(
        tmp_path,
        SKY,
        BALL.format(bsdf=""),
        '<integrator type="path"><integer name="max_depth" value="3"/></integrator>',
    )
    assert (picture(found) == picture(expected)).all()
    assert f"integrator '{kind}' is 'path' now" in " ".join(found.notes)


def test_a_black_body_has_the_radiance_of_planck_and_the_given_scale(tmp_path: Path) -> None:
    """Against Mitsuba's own blackbody, at 1e-6 of it."""
    old = '<emitter type="constant"><blackbody name="radiance" temperature="5000K" scale="1e-6"/></emitter>'
    new = '<spectrum name="radiance" type="blackbody"><float name="temperature" value="5000"/></spectrum>'
    found = picture(loaded(tmp_path, old))
    expected = picture(
        loaded(tmp_path, f'<emitter type="constant">{new}</emitter>', version="3.0.0")
    )
    np.testing.assert_allclose(
        found.mean(axis=(0, 1)), 1e-6 * expected.mean(axis=(0, 1)), rtol=0.002
    )


def test_lookat_of_all_ages(tmp_path: Path) -> None:
    """lookAt with vectors, and with single coordinates as before 0.3, mean the same."""
    new = '<lookat origin="1, 2, -3" target="0, 0, 4" up="0, 1, 0"/>'
    olds = (
        '<lookAt origin="1, 2, -3" target="0, 0, 4" up="0, 1, 0"/>',
        '<lookAt ox="1" oy="2" oz="-3" tz="4" uy="1"/>',
    )
    pose = '<transform name="{}">{}</transform>'
    expected = picture(
        loaded(
            tmp_path,
            SKY,
            BALL.format(bsdf=""),
            more=pose.format("to_world", new),
            version="3.0.0",
        )
    )
    for old in olds:
        assert (
            picture(
                loaded(tmp_path, SKY, BALL.format(bsdf=""), more=pose.format("toWorld", old))
            )
            == expected
        ).all()


def test_included_files_of_the_same_age_are_converted_too(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(
        f'<scene version="0.5.0">\n<!-- old -->\n{PAIRS["srgb"][0]}</scene>',
        encoding="utf-8",
    )
    found = loaded(tmp_path, SKY, '<include filename="ball.xml"/>', version="0.5.0")
    expected = loaded(
        tmp_path, SKY, diffuse(f'<rgb name="reflectance" value="{LINEAR}"/>'), version="3.0.0"
    )
    np.testing.assert_allclose(picture(found), picture(expected), rtol=1e-4)


def test_line_numbers_stay_and_comments_are_no_elements() -> None:
    text = '<scene version="0.6.0">\n<!-- <srgb value="#000000"/>\n-->\n<srgb\n name="a" value="#ffffff"/>\n</scene>'
    new, tags = upgraded_text(text, {})
    assert tags == ["srgb"] and new.count("\n") == text.count("\n")
    assert new.splitlines()[3].startswith("<rgb")


def test_an_error_names_the_line_in_the_file_that_was_converted(tmp_path: Path) -> None:
    film = PERSPECTIVE.format(film="", more="")
    text = f'<scene version="0.5.0">\n{film}\n{SKY}\n{PAIRS["srgb"][0]}\n<shape type="hair"/></scene>'
    with pytest.raises(ms.InputError, match=r"line 6.*hair.*format of Mitsuba 0\.5\.0"):
        load_scene(write_scene(tmp_path, text), BANDS, {})


def test_parameters_single_quotes_and_white_space_are_read(tmp_path: Path) -> None:
    element = "<srgb  name='reflectance'\n value='$grey' />"
    text = scene_text('<default name="grey" value="#000000"/>', SKY, diffuse(element)).replace(
        "3.0.0", "0.6.0"
    )
    path = write_scene(tmp_path, text)
    expected = loaded(
        tmp_path, SKY, diffuse(f'<rgb name="reflectance" value="{LINEAR}"/>'), version="3.0.0"
    )
    path.write_text(text, encoding="utf-8")
    found = load_scene(path, BANDS, {"grey": "#808080"})
    np.testing.assert_allclose(picture(found), picture(expected), rtol=1e-4)


UNREADABLE = [
    '<srgb name="reflectance" value="#12"/>',
    '<srgb name="reflectance" value="#xyzxyz"/>',
]
UNREADABLE += [
    '<srgb name="reflectance" value="red"/>',
    '<blackbody name="reflectance" temperature="hot"/>',
]
UNREADABLE += [
    '<blackbody name="reflectance" temperature="0"/>',
    '<srgb name="reflectance" value="$none"/>',
]


@pytest.mark.parametrize("element", UNREADABLE)
def test_what_cannot_be_read_is_refused_with_the_format(tmp_path: Path, element: str) -> None:
    with pytest.raises(ms.InputError, match=r"The file has the format of Mitsuba 0\.6\.0"):
        loaded(tmp_path, SKY, diffuse(element))


def test_new_files_are_left_as_they_are(tmp_path: Path) -> None:
    """An <srgb> or bdpt in a file of version 3 is an error there, as in Mitsuba."""
    assert version_of(scene_text()) == (3, 0, 0)
    with pytest.raises(ms.InputError, match="unsupported XML element: <srgb>"):
        loaded(tmp_path, SKY, PAIRS["srgb"][0], version="3.0.0")
    assert not parse_scene(write_scene(tmp_path, scene_text(SKY)), {}).changes


def test_the_digest_tells_what_was_changed(tmp_path: Path) -> None:
    path = write_scene(tmp_path, scene_text(SKY, '<integrator type="path"/>'))
    digests = {
        parse_scene(path, {}, integrator).digest() for integrator in (None, "direct", "volpath")
    }
    assert len(digests) == 3 and all(re.fullmatch("[0-9a-f]{64}", one) for one in digests)
