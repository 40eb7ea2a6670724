"""The commands cameras new, check, show --toml, and --set FIELD=none."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms


@pytest.mark.parametrize("name", one_in(9, ms.list_cameras()))
def test_a_new_file_is_the_camera_that_it_is_like(
    name: str, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    file = tmp_path / "my.toml"
    done = cli("cameras", "new", file, "--like", name)
    assert done.exit_code == 0 and f"cameras check {file}" in done.stdout.replace("\n", ""), (
        done.stderr
    )
    like = ms.load_camera(name)
    assumed = {field: f"assumed: as {name}: {text}" for field, text in like.sources.items()}
    own = like.replace(name="my", description=f"a camera like {name}", sources=assumed)
    assert ms.load_camera(file) == own and file.read_text("utf-8") == own.to_toml()
    named = ("--name", like.name, "--description", like.description, "--force")
    assert cli("cameras", "new", file, "--like", name, *named).exit_code == 0
    assert file.read_text("utf-8") == cli("cameras", "show", name, "--toml").stdout
    checked = cli("cameras", "check", file)
    assert checked.exit_code == 0 and checked.stdout.endswith(f"{file}: nothing is wrong\n")
    assert "the Airy disk of f/" in checked.stdout and checked.stdout.count("\n") == 3
    assert json.loads(cli("cameras", "check", file, "--json").stdout)["findings"] == []


def test_an_existing_file_is_written_over_only_by_force(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    file = tmp_path / "my.toml"
    file.write_text("mine", encoding="utf-8")
    done = cli("cameras", "new", file)
    assert done.exit_code == 2 and "exists already; --force writes over it" in done.stderr
    assert file.read_text("utf-8") == "mine" and done.stdout == ""
    assert cli("cameras", "new", file, "--force", "--set", "adc.bits=14").exit_code == 0
    made = ms.load_camera(file)
    expected = ms.load_camera("konnik_table1").replace(
        name="my", description=made.description, **{"adc.bits": 14}
    )
    assert made == expected.replace(sources=made.sources)
    assert made.sources["adc.bits"] == "set by the user"


def test_a_new_file_keeps_of_its_model_what_is_true_of_it(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """Another K has no source, and gain settings with other numbers are left out; what is kept is said in a line."""
    file, like = tmp_path / "my.toml", ms.load_camera("raspberry_pi_hq")

    def made_with(*settings: str) -> tuple[ms.Camera, str]:
        flags = [part for one in settings for part in ("--set", one)]
        done = cli("cameras", "new", file, "--like", like.name, "--force", *flags)
        assert done.exit_code == 0
        return ms.load_camera(file), " ".join(done.stdout.split())

    camera, said = made_with("adc.bits=10")
    assert "but adc.bits; K is 0.1175 DN/e- (that of raspberry_pi_hq: 0.47)" in said
    assert "its gain settings are left out" in said and not camera.gains
    assert "adc.full_scale_v" not in camera.sources and "gains" not in camera.sources
    assert camera.sources["adc.bits"] == "set by the user"
    camera, said = made_with("pixel.prnu=0.02")
    assert "all numbers and their sources are those of raspberry_pi_hq, but pixel.prnu" in said
    assert camera.gains == like.gains and "K is" not in said and "left out" not in said
    assert camera.sources["pixel.prnu"] == "set by the user"
    camera, _ = made_with("source_follower.read_noise_e=5", "quantum_efficiency.value=0.5")
    assert not camera.gains and camera.sources["quantum_efficiency.curves"] == "set by the user"


def test_a_place_that_takes_no_camera_file_is_one_sentence(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    (tmp_path / "folder.toml").mkdir()
    for file, said in {
        "my.txt": "let it end in .toml",
        "folder.toml": "exists already; give another name",
        "nowhere/my.toml": "there is no folder",
    }.items():
        for force in ((), ("--force",)):
            done = cli("cameras", "new", tmp_path / file, *force)
            assert (
                done.exit_code == 2
                and said in done.stderr
                and len(done.stderr.splitlines()) == 1
            )
    assert [path.name for path in tmp_path.iterdir()] == ["folder.toml"]


def test_a_check_prints_errors_and_warnings_and_exits_2_only_for_errors(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    file = tmp_path / "my.toml"
    text = ms.load_camera("konnik_table1").to_toml().replace("\nprnu = 0.005", "\nprnu = 50")
    file.write_text(text, encoding="utf-8")
    line = 1 + text[: text.index("\nprnu = 50") + 1].count("\n")
    done = cli("cameras", "check", file)
    assert done.exit_code == 0 and done.stderr == ""
    assert done.stdout.splitlines() == [
        f"{file}:{line}: warning: pixel.prnu is 50, and 0 to 0.1 is usual: if 50 is in percent, write 0.5.",
        f"{file}: the Airy disk of f/2.8 is 0.66 pixels across at 550 nm; lens.diffraction = true renders it",
        f"{file}: the pixel's aperture leaves 0.637 of the contrast at Nyquist's frequency along the rows and 0.637 "
        "along the columns",
        f"{file}: 1 warning",
    ]
    file.write_text(
        text.replace("\nbits = 12", "\nbitts = 12").replace("\nrows = 1300", "\nrows = 0"),
        "utf-8",
    )
    done = cli("cameras", "check", file)
    assert (
        done.exit_code == 2 and done.stdout.splitlines()[-1] == f"{file}: 2 errors, 1 warning"
    )
    found = cli("cameras", "check", file, "--json")
    assert found.exit_code == 2
    assert json.loads(found.stdout)["airy_disk"] is None
    assert [one["field"] for one in json.loads(found.stdout)["findings"]] == [
        "sensor.rows",
        "adc.bitts",
        "pixel.prnu",
    ]


def test_a_check_may_change_fields_first(cli: Callable[..., Any]) -> None:
    done = cli("cameras", "check", "sony_imx174", "--set", "lens.f_number=220")
    assert done.exit_code == 0
    *found, verdict = done.stdout.splitlines()
    assert verdict == "sony_imx174: 1 warning"
    assert found[:2] == [
        "sony_imx174 with --set: warning: lens.f_number is 220, and 0.5 to 130 is usual: check its unit.",
        "sony_imx174: the Airy disk of f/220 is 62 pixels across at 675 nm; lens.diffraction = true renders it",
    ]
    wrong = cli("cameras", "check", "sony_imx174", "--set", "adc.bits=99")
    assert wrong.exit_code == 2 and "adc.bits is 99; it must be" in wrong.stderr
    lens = ("--set", "lens.prescription=double_gauss", "--set", "lens.f_number=1.4")
    closed = cli("cameras", "check", "sony_imx174", *lens)
    assert closed.exit_code == 2 and "opens to f/2.05 at most" in closed.stdout
    assert closed.stdout.endswith("sony_imx174: 1 error\n")


@pytest.mark.parametrize(
    ("scene", "is_named"), [("night_crossing", True), ("cornell_box", False)]
)
def test_lint_says_how_a_camera_is_named_where_neither_scene_nor_user_does(
    scene: str, is_named: bool, cli: Callable[..., Any]
) -> None:
    done = cli("lint", scene, "--set", "lens.f_number=1.8")
    assert done.exit_code == 0 and "nothing to say for this camera" in done.stdout
    assert "Airy disk 0." in done.stdout  # also where it is small
    assert ("--camera" in done.stdout + done.stderr) == (not is_named)


def test_lint_takes_fields_of_the_camera(cli: Callable[..., Any]) -> None:
    """The corner of the Cornell box, at 26° of microlenses that have half of the response there."""
    response = ("--set", "pixel.angular_response=[1.0, 0.5]")
    angles = ("--set", "pixel.angular_response_deg=[0, 20]")
    short = cli("lint", "cornell_box", *response, *angles)
    assert short.exit_code == 2 and "angular_response_deg [°] ends at 20" in short.stderr
    angles = ("--set", "pixel.angular_response_deg=[0, 52]")
    found = json.loads(cli("lint", "cornell_box", *response, *angles, "--json").stdout)
    assert any("chief ray of the corner" in one["what"] for one in found)


def test_a_check_as_json_has_the_airy_disk_in_pixels(cli: Callable[..., Any]) -> None:
    """2.44·λN over the pitch: 2.44 · 0.55 µm · 2.8 over 5.7 µm."""
    found = json.loads(cli("cameras", "check", "konnik_table1", "--json").stdout)
    expected = 2.44 * 0.55 * 2.8 / 5.7
    assert found["airy_disk"]["diameter_px"] == pytest.approx(expected, rel=1e-3)
    assert found["airy_disk"]["wavelength_nm"] == 550
    assert found["airy_disk"]["rendered"] is False


def test_a_map_of_the_sensitivity_within_the_pixel_is_read_from_a_csv_file(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """A square of a quarter of the pixel: sinc(¼) of the contrast at Nyquist's frequency; beside its camera file."""
    (tmp_path / "within.csv").write_text("# a square\n0;0;0;0\n0;2;2;0\n0;2;2;0\n0;0;0;0\n")
    text = ms.load_camera("konnik_table1").to_toml()
    file = tmp_path / "my.toml"
    file.write_text(
        text.replace("\n[pixel]\n", '\n[pixel]\naperture = "within.csv"\n').replace(
            "\nfill_factor = 0.5", "\nfill_factor = 0.25"
        ),
        encoding="utf-8",
    )
    found = json.loads(cli("cameras", "check", file, "--json").stdout)
    assert found["pixel_mtf"]["cycles_per_pixel"][-1] == 0.5
    for direction in ("along_rows", "along_columns"):
        assert found["pixel_mtf"][direction][-1] == pytest.approx(0.9003, abs=1e-4)
    camera = ms.load_camera(file)
    assert camera.pixel.aperture_shape.area == 0.25
    assert ms.load_camera(camera.to_toml()) == camera


@pytest.mark.parametrize(
    ("aperture", "said"),
    [
        ([[1, 2], [1]], "rows that are equally long"),
        ([[0, 0], [0, 0]], "0 everywhere"),
        ([[1, -1]], "the value -1"),
        ([[1, 1], [1, 0]], "aperture has 0.75 of the pixel's area and fill_factor is 0.5"),
        ("none.csv", "file 'none.csv' cannot be read"),
        ([1.2, 0.5], "neither 'full' nor 'square'"),
    ],
)
def test_an_aperture_that_is_none_gets_a_sentence(aperture: object, said: str) -> None:
    with pytest.raises(ms.InputError, match=said):
        ms.load_camera("konnik_table1").replace(**{"pixel.aperture": aperture})


def test_set_unsets_a_field_so_that_its_alternative_can_be_given(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """By none or by nothing; and an unusual number is a note of the frame."""
    changes = {
        "source_follower.white_nv_per_rthz": "none",
        "source_follower.read_noise_e": "3",
        "dark_current.fom_na_per_cm2": "",
        "dark_current.rate_e_per_s": "5",
        "dark_current.at_temperature_k": "298.15",
        "pixel.prnu": "0.5",
    }
    settings = [
        part for field, text in changes.items() for part in ("--set", f"{field}={text}")
    ]
    done = cli("expose", light_file, "-o", tmp_path / "out", *settings)
    assert done.exit_code == 0 and "note: pixel.prnu is 0.5" in done.stdout, done.stderr
    camera = json.loads((tmp_path / "out" / "frame.json").read_text("utf-8"))["camera"]
    assert (
        camera["source_follower"]["white_nv_per_rthz"]
        is camera["dark_current"]["fom_na_per_cm2"]
        is None
    )
    assert (
        camera["source_follower"]["read_noise_e"],
        camera["dark_current"]["rate_e_per_s"],
    ) == (3, 5)
    (note,) = camera["notes"]
    assert note.startswith("pixel.prnu is 0.5, and 0 to 0.1 is usual")


def test_an_import_says_what_is_assumed_and_writes_a_file_that_is_right(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """A tuning file at 12 bits; a second import needs --force, and a bad file writes nothing."""
    source, file = tmp_path / "imx477.json", tmp_path / "my.toml"
    source.write_text(
        '{"algorithms": [{"rpi.noise": {"reference_slope": 2.767}}]}', encoding="utf-8"
    )
    flags = ("--set", "adc.bits=12", "--name", "my_pi")
    done = cli("cameras", "import", source, "-o", file, *flags, "--json")
    said = json.loads(done.stdout)
    assert said["name"] == "my_pi" and "source_follower.read_noise_e" in said["assumed"]
    assert said["sources"]["adc.full_scale_v"].startswith(
        "imx477.json: rpi.noise reference_slope 2.767"
    )
    assert cli("cameras", "check", file).stdout.endswith(f"{file}: nothing is wrong\n")
    again = cli("cameras", "import", source, "-o", file, *flags)
    assert again.exit_code == 2 and "exists already; --force" in again.stderr
    assert (
        "numbers are assumed"
        in cli("cameras", "import", source, "-o", file, *flags, "--force").stdout
    )
    source.write_text("{}", encoding="utf-8")
    bad = cli("cameras", "import", source, "-o", tmp_path / "other.toml")
    assert (
        bad.exit_code == 2
        and len(bad.stderr.splitlines()) == 1
        and not (tmp_path / "other.toml").exists()
    )
