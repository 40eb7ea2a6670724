"""What a user can do wrong: one sentence on stderr, exit code 2, nothing written, older results untouched."""

from __future__ import annotations

import errno
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from helpers import CAMERAS
from helpers.marks import one_in

from mitsuba_sensor.files import png, texts, tiff
from mitsuba_sensor.files.disk_errors import disk_sentences
from mitsuba_sensor.render.load.scene import Scene
from mitsuba_sensor.sensor.expose import PreparedExposure

DARK_SCENE_IN_THE_INFRARED_ONLY = '<spectrum name="radiance" value="900:0.01, 1000:0.01"/>'
MALFORMED = "<scene version='3.0.0'><sensor type='perspective'></scene>"

# (arguments of the command, what the sentence must say); SCENE, LIGHT, OUT and TMP are filled in.
CASES: dict[str, tuple[Sequence[str], str]] = {
    "missing scene": (("render", "TMP/none.xml", "-o", "OUT"), "none.xml"),
    "scene is a folder": (("render", "TMP", "-o", "OUT"), "is a folder, or no plain file"),
    "malformed XML": (("render", "TMP/malformed.xml", "-o", "OUT"), "malformed.xml"),
    "not XML": (("render", "LIGHT", "-o", "OUT"), "irradiance.exr"),
    "no light in the band": (
        ("render", "TMP/infrared.xml", "-o", "OUT", "--spp", "16"),
        "from 400 to 700 nm",
    ),
    "unknown scene parameter": (
        ("render", "SCENE", "-o", "OUT", "-D", "levle=1", "--spp", "16"),
        "levle",
    ),
    "light in place of a scene": (("render", "LIGHT", "-o", "OUT"), "`mitsuba-sensor expose`"),
    "scene in place of light": (
        ("expose", "SCENE", "-o", "OUT"),
        "`mitsuba-sensor render SCENE",
    ),
    "no folder": (("render", "SCENE"), "Missing option '-o'"),
    "no folder of frames": (("fit", "-o", "OUT.toml"), "--frames"),
    "no scene": (("render", "-o", "OUT"), "Missing argument"),
    "percent": (("render", "SCENE", "-o", "OUT", "--noise-ratio", "3 %"), "'3 %' is 0.03"),
    "frames in words": (
        ("render", "SCENE", "-o", "OUT", "--frames", "four"),
        "frames is 'four'",
    ),
    "percent of a field": (
        ("render", "SCENE", "-o", "OUT", "--set", "pixel.prnu=0.5 %"),
        "'0.5 %' is 0.005",
    ),
    "parameter without value": (
        ("render", "SCENE", "-o", "OUT", "-D", "level"),
        "-D NAME=VALUE",
    ),
    "unknown variant": (
        ("render", "SCENE", "-o", "OUT", "--variant", "scalar_spectrum"),
        "Did you mean 'scalar_spectral'",
    ),
    "rgb variant": (
        ("render", "SCENE", "-o", "OUT", "--variant", "scalar_rgb"),
        "scalar_spectral",
    ),
    "zero wavelength": (
        ("render", "SCENE", "-o", "OUT", "--wavelength-nm", "0"),
        "--wavelength-nm",
    ),
    "NaN wavelength": (
        ("render", "SCENE", "-o", "OUT", "--wavelength-nm", "nan"),
        "--wavelength-nm",
    ),
    "negative bandwidth": (
        ("render", "SCENE", "-o", "OUT", "--bandwidth-nm", "-1"),
        "--bandwidth-nm",
    ),
    "wavelength in metres": (
        ("render", "SCENE", "-o", "OUT", "--wavelength-nm", "5.5e-7"),
        "--wavelength-nm",
    ),
    "zero samples": (("render", "SCENE", "-o", "OUT", "--spp", "0"), "spp is 0"),
    "no such irradiance": (("expose", "TMP/none.exr", "-o", "OUT"), "none.exr"),
    "not an EXR": (("expose", "SCENE", "-o", "OUT"), "not an OpenEXR file"),
    "unknown camera": (
        ("expose", "LIGHT", "-o", "OUT", "--camera", "konnik_table"),
        "Did you mean 'konnik_table1'",
    ),
    "camera file missing": (
        ("expose", "LIGHT", "-o", "OUT", "--camera", "none.toml"),
        "none.toml",
    ),
    "unit of a field wrong": (
        ("expose", "LIGHT", "-o", "OUT", "--camera", "TMP/millimetres.toml"),
        "pitch_x_um",
    ),
    "text for a number": (
        ("expose", "LIGHT", "-o", "OUT", "--camera", "TMP/text.toml"),
        "full_well_e",
    ),
    "camera is not TOML": (
        ("expose", "LIGHT", "-o", "OUT", "--camera", "TMP/broken.toml"),
        "not valid TOML",
    ),
    "unknown field": (
        ("expose", "LIGHT", "-o", "OUT", "--set", "adc.bitz=14"),
        "Did you mean 'adc.bits'",
    ),
    "field without value": (
        ("expose", "LIGHT", "-o", "OUT", "--set", "adc.bits"),
        "--set NAME=VALUE",
    ),
    "negative full well": (
        ("expose", "LIGHT", "-o", "OUT", "--set", "pixel.full_well_e=-3"),
        "full_well_e is -3",
    ),
    "NaN in a field": (
        ("expose", "LIGHT", "-o", "OUT", "--set", "pixel.prnu=nan"),
        "prnu is nan",
    ),
    "text in a field": (
        ("expose", "LIGHT", "-o", "OUT", "--set", "adc.bits=many"),
        "adc.bits is 'many'",
    ),
    "too many bits": (
        ("expose", "LIGHT", "-o", "OUT", "--set", "adc.bits=25"),
        "adc.bits is 25",
    ),
    "negative exposure": (
        ("expose", "LIGHT", "-o", "OUT", "--exposure-s", "-1"),
        "time_s is -1",
    ),
    "NaN exposure": (("expose", "LIGHT", "-o", "OUT", "--exposure-s", "nan"), "time_s is nan"),
    "infinite exposure": (
        ("expose", "LIGHT", "-o", "OUT", "--exposure-s", "inf"),
        "time_s is inf",
    ),
    "negative temperature": (
        ("expose", "LIGHT", "-o", "OUT", "--temperature-k", "-5"),
        "--temperature-k is -5",
    ),
    "negative seed": (("expose", "LIGHT", "-o", "OUT", "--seed", "-1"), "seed is -1"),
    "negative serial": (("expose", "LIGHT", "-o", "OUT", "--serial", "-1"), "serial is -1"),
    "no frames": (("expose", "LIGHT", "-o", "OUT", "--frames", "0"), "frames is 0"),
    "text for a time": (
        ("expose", "LIGHT", "-o", "OUT", "--exposure-s", "long"),
        "--exposure-s",
    ),
    "no output folder": (("expose", "LIGHT"), "-o"),
    "unknown engine": (
        ("expose", "LIGHT", "-o", "OUT", "--engine", "matlab"),
        "engine is 'matlab'; it must be one of",
    ),
    "no such patterns": (
        ("expose", "LIGHT", "-o", "OUT", "--fpn-maps", "TMP/none.npz"),
        "none.npz cannot be read",
    ),
    "patterns of another kind": (
        ("render", "SCENE", "-o", "OUT", "--fpn-maps", "SCENE"),
        "no .npz of numbers",
    ),
    "patterns into no folder": (
        ("fpn-maps", "-o", "OUT/chip.npz", "--rows", "2", "--width", "2"),
        "cannot write",
    ),
    "patterns of no rows": (("fpn-maps", "-o", "OUT", "--rows", "0"), "rows is 0"),
    "patterns into nothing": (
        ("fpn-maps", "-o", "", "--rows", "2", "--width", "2"),
        "give the name of a file",
    ),
    "endless preview": (
        ("expose", "LIGHT", "-o", "OUT", "--preview-gain", "inf"),
        "--preview-gain is inf",
    ),
    "plan of light with options of a render": (
        ("plan", "LIGHT", "--spp", "4"),
        "spp is for the render of a scene",
    ),
    "plan of light with another picture": (
        ("plan", "LIGHT", "--width", "8"),
        "width is for the render of a scene",
    ),
    "plan of light with a parameter": (
        ("plan", "LIGHT", "-D", "level=1"),
        "parameters is for the render of a scene",
    ),
    "patterns without a file": (("fpn-maps",), "-o"),
    "too hot": (
        ("expose", "LIGHT", "-o", "OUT", "--temperature-k", "1e9"),
        "--temperature-k is 1000000000.0",
    ),
    "too long": (
        ("expose", "LIGHT", "-o", "OUT", "--exposure-s", "1e13"),
        "time_s is 10000000000000.0",
    ),
    "a gain that overflows": (
        ("plan", "LIGHT", "--set", "readout.cds_gain=1e-320"),
        "cds_gain is 1e-320",
    ),
    "plan of nothing": (("plan", "TMP/none.exr"), "none.exr"),
    "negative tolerance": (("plan", "LIGHT", "--tolerance-dn", "-1"), "--tolerance-dn"),
    "show an unknown camera": (("cameras", "show", "bayer"), "Did you mean 'bayer_2mp'"),
    "unknown command": (("rendr", "SCENE"), "rendr"),
}


@pytest.fixture
def places(tmp_path: Path, scene_file: Path, light_file: Path) -> dict[str, str]:
    """Folders and files that the cases speak of."""
    scene = scene_file.read_text(encoding="utf-8")
    infrared = scene.replace(
        '<spectrum name="radiance" value="$level"/>', DARK_SCENE_IN_THE_INFRARED_ONLY
    )
    camera = (CAMERAS / "konnik_table1.toml").read_text(encoding="utf-8")
    for name, text in {
        "malformed.xml": MALFORMED,
        "infrared.xml": infrared,
        "millimetres.toml": camera.replace("pitch_x_um", "pitch_x_mm"),
        "text.toml": camera.replace("full_well_e = ", 'full_well_e = "33000 e-" #'),
        "broken.toml": camera.replace("]", ""),
    }.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return {
        "TMP": str(tmp_path),
        "SCENE": str(scene_file),
        "LIGHT": str(light_file),
        "OUT": str(tmp_path / "new" / "out"),
    }


def fill(argument: str, places: dict[str, str]) -> str:
    for name, place in places.items():
        argument = argument.replace(name, place)
    return argument


def sentence(stderr: str) -> str:
    """Typer frames its own complaints; without the frame and its line breaks they read as one text."""
    return " ".join(stderr.replace("│", " ").split())


@pytest.mark.parametrize("case", one_in(3, CASES))
def test_a_mistake_is_one_sentence_exit_2_and_no_file(
    case: str, places: dict[str, str], cli: Callable[..., Any]
) -> None:
    arguments, said = CASES[case]
    done = cli(*(fill(argument, places) for argument in arguments))
    assert done.exit_code == 2, (done.exception, done.stderr)
    assert said in sentence(done.stderr), done.stderr
    assert "Traceback" not in done.stderr and done.stdout == ""
    if done.stderr.startswith("error: "):
        assert len(done.stderr.strip().splitlines()) == 1
    assert not (Path(places["TMP"]) / "new").exists()


@pytest.mark.parametrize("where", ["file", "below a file", "proc", "folder in the way"])
def test_a_place_that_takes_no_files_is_found_before_the_render(
    where: str,
    tmp_path: Path,
    scene_file: Path,
    cli: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "file").write_text("kept")
    (tmp_path / "folder" / "frame.json").mkdir(parents=True)
    place = {
        "file": tmp_path / "file",
        "below a file": tmp_path / "file" / "out",
        "proc": Path("/proc/nowhere/out"),
        "folder in the way": tmp_path / "folder",
    }[where]
    monkeypatch.setattr(
        Scene, "render", lambda *_: pytest.fail("rendered before looking at the folder")
    )
    done = cli("render", scene_file, "-o", place)
    assert done.exit_code == 2 and len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert str(place) in done.stderr
    assert (tmp_path / "file").read_text() == "kept"
    assert [path.name for path in (tmp_path / "folder").iterdir()] == ["frame.json"]


@pytest.mark.parametrize(
    "module, writer", [(tiff, "write_tiff"), (png, "write_png"), (texts, "write_json")]
)
def test_a_disk_that_fills_up_leaves_the_older_result_alone(
    module: Any,
    writer: str,
    light_file: Path,
    tmp_path: Path,
    cli: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "out"
    assert cli("expose", light_file, "-o", out).exit_code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def full(path: Path, *_: Any) -> None:
        with disk_sentences(path):
            raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(module, writer, full)
    done = cli("expose", light_file, "-o", out, "--seed", 2)
    assert done.exit_code == 3 and "No space left on device" in done.stderr
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_running_out_of_memory_is_a_sentence(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def huge(*_: Any, **__: Any) -> None:
        raise MemoryError("Unable to allocate 1 TiB")

    monkeypatch.setattr(PreparedExposure, "frames", huge)
    done = cli("expose", light_file, "-o", tmp_path / "out")
    assert done.exit_code == 2 and "Unable to allocate 1 TiB" in done.stderr
    assert not (tmp_path / "out").exists()
