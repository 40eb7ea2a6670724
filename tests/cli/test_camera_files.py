"""The commands cameras new, import, check and show, `--set FIELD=none`, and cameras of EMVA 1288 sheets."""

from __future__ import annotations

import json
from collections.abc import Callable
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.camera.emva_sheet import COMPARED, KEYS, EmvaSheet, camera_of_sheet
from mitsuba_sensor.camera.field_catalogue import copied_source

Cli = Callable[..., Any]
IMX174 = {
    **{"pitch_um": 5.86, "size": [1920, 1200], "bits": 12, "wavelength_nm": 525},
    **{"qe_percent": 77, "gain_dn_per_e": 1 / 8.16, "read_noise_e": 6.83},
    **{"saturation_e": 32691, "dsnu_e": 0, "prnu_percent": 1},
    **{"dark_e_per_s": 5, "dark_temperature_c": 25},
}
"""EMVA 1288 figures of a camera with this sensor, as in camera/cameras/sony_imx174.toml."""
CMV4000 = {
    **{"pitch_um": [5.5, 5.4], "size": [2048, 2048], "bits": 10, "wavelength_nm": 550},
    **{"qe_percent": 60, "gain_dn_per_e": 0.075, "read_noise_e": 13, "snr_max_db": 41.3},
    **{"saturation_e": 13500, "dsnu_e": 13.5, "prnu_percent": 1, "linearity_percent": 0.5},
    **{"dark_e_per_s": 125, "dark_temperature_c": -20},
}
"""The data sheet of the ams CMV4000, as in examples/cmv4000.toml."""
SHEETS: dict[str, dict[str, Any]] = {"sony_imx174": IMX174, "cmv4000": CMV4000}


@pytest.mark.parametrize("name", one_in(20, ms.list_cameras()))
def test_a_new_file_is_the_camera_that_it_is_like(name: str, tmp_path: Path, cli: Cli) -> None:
    file, like = tmp_path / "my.toml", ms.load_camera(name)
    assert cli("cameras", "new", file, "--like", name).exit_code == 0
    sources = {field: copied_source(text, name) for field, text in like.sources.items()}
    own = like.replace(name="my", description=f"a camera like {name}", sources=sources)
    assert ms.load_camera(file) == own and file.read_text("utf-8") == own.to_toml()
    named = ("--name", like.name, "--description", like.description, "--force")
    assert cli("cameras", "new", file, "--like", name, *named).exit_code == 0
    assert file.read_text("utf-8") == cli("cameras", "show", name, "--toml").stdout
    checked = json.loads(cli("cameras", "check", file, "--json").stdout)
    assert checked["findings"] == []


@pytest.mark.parametrize(
    ("source", "copied"),
    [
        ("EMVA 1288 sheet: pixel size", "of b: EMVA 1288 sheet: pixel size"),
        ("of a: EMVA 1288 sheet: pixel size", "of b: EMVA 1288 sheet: pixel size"),
        ("assumed: 6 K, usual for silicon", "assumed: as b: 6 K, usual for silicon"),
        ("assumed: as a: 6 K, usual for silicon", "assumed: as b: 6 K, usual for silicon"),
        ("assumed: as a", "assumed: as b: as a"),
    ],
)
def test_a_copied_number_is_assumed_only_if_it_was_assumed(source: str, copied: str) -> None:
    assert copied_source(source, "b") == copied


def test_an_existing_file_is_overwritten_only_by_force(tmp_path: Path, cli: Cli) -> None:
    file = tmp_path / "my.toml"
    file.write_text("mine", encoding="utf-8")
    for command in (("new",), ("import", tmp_path / "none.json", "-o")):
        assert cli("cameras", *command, file).exit_code == 2
        assert file.read_text("utf-8") == "mine"
    assert cli("cameras", "new", file, "--force", "--set", "adc.bits=14").exit_code == 0
    made = ms.load_camera(file)
    assert made.adc.bits == 14 and made.sources["adc.bits"] == "set by the user"


@pytest.mark.parametrize(
    ("settings", "keeps_gains", "keeps_k"),
    [
        (("adc.bits=10",), False, False),
        (("pixel.prnu=0.02",), True, True),
        (("source_follower.read_noise_e=5", "quantum_efficiency.value=0.5"), False, True),
    ],
)
def test_a_new_file_keeps_of_its_model_what_is_true_of_it(
    settings: tuple[str, ...], keeps_gains: bool, keeps_k: bool, tmp_path: Path, cli: Cli
) -> None:
    """Another K has no source, and gain settings with other numbers are left out; a note says so."""
    file, like = tmp_path / "my.toml", ms.load_camera("raspberry_pi_hq")
    flags = [part for one in settings for part in ("--set", one)]
    said = json.loads(cli("cameras", "new", file, "--like", like.name, *flags, "--json").stdout)
    camera = ms.load_camera(file)
    assert bool(camera.gains) == keeps_gains == (camera.gains == like.gains)
    assert ("adc.full_scale_v" in camera.sources) == keeps_k
    assert any("0.1175" in note and "0.47" in note for note in said["notes"]) != keeps_k
    for one in settings:
        field = one.partition("=")[0].replace("ency.value", "ency.curves")
        assert camera.sources[field] == "set by the user"


def test_a_check_finds_errors_and_warnings_and_exits_2_only_for_errors(
    tmp_path: Path, cli: Cli
) -> None:
    file = tmp_path / "my.toml"
    text = ms.load_camera("konnik_table1").to_toml().replace("\nprnu = 0.005", "\nprnu = 50")
    file.write_text(text, encoding="utf-8")
    line = 1 + text[: text.index("\nprnu = 50") + 1].count("\n")
    done = cli("cameras", "check", file)
    assert done.exit_code == 0 and f"{file}:{line}: warning: pixel.prnu is 50" in done.stdout
    text = text.replace("\nbits = 12", "\nbitts = 12").replace("\nrows = 1300", "\nrows = 0")
    file.write_text(text, "utf-8")
    found = cli("cameras", "check", file, "--json")
    assert found.exit_code == 2 and json.loads(found.stdout)["airy_disk"] is None
    fields = [one["field"] for one in json.loads(found.stdout)["findings"]]
    assert fields == ["sensor.rows", "adc.bitts", "pixel.prnu"]


def test_a_check_has_the_airy_disk_and_the_aperture_of_the_pixel(
    tmp_path: Path, cli: Cli
) -> None:
    """2.44·λN over the pitch; a square of a quarter of the pixel, from a CSV file beside the camera file, leaves
    sinc(¼) of the contrast at the Nyquist frequency."""
    (tmp_path / "within.csv").write_text("# a square\n0;0;0;0\n0;2;2;0\n0;2;2;0\n0;0;0;0\n")
    text = ms.load_camera("konnik_table1").to_toml()
    text = text.replace("\n[pixel]\n", '\n[pixel]\naperture = "within.csv"\n')
    file = tmp_path / "my.toml"
    file.write_text(text.replace("\nfill_factor = 0.5", "\nfill_factor = 0.25"), "utf-8")
    found = json.loads(cli("cameras", "check", file, "--json").stdout)
    expected_px = 2.44 * 0.55 * 2.8 / 5.7
    assert found["airy_disk"]["diameter_px"] == pytest.approx(expected_px, rel=1e-3)
    assert found["pixel_mtf"]["cycles_per_pixel"][-1] == 0.5
    for direction in ("along_rows", "along_columns"):
        assert found["pixel_mtf"][direction][-1] == pytest.approx(0.9003, abs=1e-4)
    camera = ms.load_camera(file)
    assert ms.load_camera(camera.to_toml()) == camera


def test_set_unsets_a_field_so_that_its_alternative_can_be_given(
    light_file: Path, tmp_path: Path, cli: Cli
) -> None:
    """By none or by nothing; and an unusual number is a note of the frame and of its camera."""
    changes = (
        *("source_follower.white_nv_per_rthz=none", "source_follower.read_noise_e=3"),
        *("dark_current.fom_na_per_cm2=", "dark_current.rate_e_per_s=5"),
        *("dark_current.at_temperature_k=298.15", "pixel.prnu=0.5"),
    )
    settings = [part for one in changes for part in ("--set", one)]
    done = cli("expose", light_file, "-o", tmp_path, *settings, "--json")
    assert done.exit_code == 0, done.stderr
    camera = json.loads(done.stdout)["camera"]
    assert camera["source_follower"]["white_nv_per_rthz"] is None
    assert camera["dark_current"]["fom_na_per_cm2"] is None
    assert camera["source_follower"]["read_noise_e"] == 3
    assert "pixel.prnu is 0.5" in camera["notes"][0]


def test_an_import_says_what_is_assumed_and_writes_a_file_that_is_right(
    tmp_path: Path, cli: Cli
) -> None:
    source, file = tmp_path / "imx477.json", tmp_path / "my.toml"
    tuning = '{"algorithms": [{"rpi.noise": {"reference_slope": 2.767}}]}'
    source.write_text(tuning, encoding="utf-8")
    flags = ("--set", "adc.bits=12", "--name", "my_pi", "--json")
    said = json.loads(cli("cameras", "import", source, "-o", file, *flags).stdout)
    assert said["name"] == "my_pi" and "source_follower.read_noise_e" in said["assumed"]
    assert "reference_slope 2.767" in said["sources"]["adc.full_scale_v"]
    assert cli("cameras", "check", file).exit_code == 0
    source.write_text("{}", encoding="utf-8")
    bad = cli("cameras", "import", source, "-o", tmp_path / "other.toml")
    assert bad.exit_code == 2 and not (tmp_path / "other.toml").exists()


def new(cli: Cli, folder: Path, sheet: dict[str, Any], *more: str) -> Any:
    lines = [f"{name} = {value}  # [unit]" for name, value in sheet.items()]
    (folder / "sheet.txt").write_text("\n".join(["# EMVA 1288", *lines]), "utf-8")
    return cli("cameras", "new", folder / "my.toml", "--emva", folder / "sheet.txt", *more)


@pytest.mark.parametrize("name", SHEETS)
def test_a_sheet_is_a_camera_with_its_figures(name: str, tmp_path: Path, cli: Cli) -> None:
    sheet = SHEETS[name]
    done = new(cli, tmp_path, sheet, "--name", name)
    assert done.exit_code == 0, done.stderr
    camera = ms.load_camera(tmp_path / "my.toml")
    assert not [x for x in ms.check_camera(tmp_path / "my.toml") if x.level == "error"]
    figures = camera.emva1288()
    same = {"system_gain_dn_per_e": "gain_dn_per_e", "temporal_dark_noise_e": "read_noise_e"}
    for figure, row in (same | {"saturation_e": "saturation_e"}).items():
        assert getattr(figures, figure) == pytest.approx(sheet[row], rel=1e-4)
    in_dark = camera.emva1288(ms.Exposure(1.0, sheet["dark_temperature_c"] + 273.15))
    dark_e = figures.saturation_e - in_dark.saturation_e
    assert dark_e == pytest.approx(sheet["dark_e_per_s"], rel=1e-3)
    assert camera.name == name and all(camera.sources.values())


@pytest.mark.parametrize("name", SHEETS)
def test_the_keys_of_a_row_have_its_value(name: str) -> None:
    """As the table of docs/camera-file.md says; the others are compared, or said to be left out."""
    sheet = EmvaSheet(**SHEETS[name])
    camera, rows = camera_of_sheet(sheet, name, ""), EmvaSheet.model_fields
    assert {*rows} == {*KEYS, *COMPARED, "linearity_percent"}
    for row, fields in KEYS.items():
        if (value := getattr(sheet, row)) is None:
            continue
        scale, offset = 0.01 if row.endswith("percent") else 1, 273.15 * row.endswith("_c")
        for field, wanted in zip(fields, value if len(fields) > 1 else (value,), strict=True):
            seen = attrgetter(field)(camera)
            if row == "qe_percent":
                seen = camera.qe([sheet.wavelength_nm])[0, 0]
            assert seen == pytest.approx(scale * wanted + offset, rel=1e-9), field


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        *(({"qe_percent": 0.65}, "65"), ({"prnu_percent": 0.006}, "0.6")),
        *(({"qe_percent": "'x'"}, "'x'"), ({"gain_dn_per_e": 0}, "K")),
        *(({"qee_percent": 3}, "'qe_percent'"), ({"bits": ""}, "TOML")),
        *(
            ({"dark_temperature_c": None}, "dark_temperature_c"),
            ({"pitch_um": None}, "pitch_um"),
        ),
    ],
)
def test_a_wrong_sheet_is_one_line(
    changes: dict[str, Any], said: str, tmp_path: Path, cli: Cli
) -> None:
    sheet = {name: x for name, x in {**IMX174, **changes}.items() if x is not None}
    done = new(cli, tmp_path, sheet)
    assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1 and said in done.stderr
    assert not (tmp_path / "my.toml").exists()


@pytest.mark.parametrize(
    ("source", "copied"),
    [
        ("EMVA sheet: pixel size", "of new: EMVA sheet: pixel size"),
        ("of my cam: EMVA sheet", "of new: EMVA sheet"),
        ("assumed: usual", "assumed: as new: usual"),
        ("assumed: as my cam: usual", "assumed: as new: usual"),
    ],
)
def test_sources_of_copies_of_copies_do_not_stack(source: str, copied: str) -> None:
    assert copied_source(source, "new") == copied
