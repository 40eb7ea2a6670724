"""A camera file is checked as a whole: every error with its line, the field that was meant, and unusual numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from helpers import CAMERAS
from helpers.marks import exhaustive

import mitsuba_sensor as ms
from mitsuba_sensor.camera.camera_check import CameraFinding
from mitsuba_sensor.camera.datasheet_errors import fields_of, usual_of

TABLE1 = (CAMERAS / "konnik_table1.toml").read_text(encoding="utf-8").split("[sources]")[0]

MANY = """\
name = "many"
[sensor]
technology = "cmos"
columns = 640
rows = 480.5

[pixel]
pitch_x_um = 5.86e-6
pitch_y_um = 5.86
fil_factor = 1.0
full_well_e = -3
prnu = 50

[quantum_efficiency]
wavelengths_nm = [400,
  700]
curves.mono = [0.6, 60.0]

[dark_current]
rate_e_per_s = 5
at_temperature_k = 25
cvs = 40

[[dark_current.components]]
weight = 0.1
family = "uniform"
low = 1
high = 2
unit = "dn"

[[dark_current.components]]
weight = 2.0
family = "uniform"
low = 1
high = 2
unit = "dn"

[source_follower]
read_noise_e = 3
white_nv_per_rthz = 15

[readout]
rest = "true_cds"

[adcs]
bits = 12

[lens]
xyzzy = 1

[sources]
"pixel.prnuu" = "a book"
"""
ERRORS = {  # line → field, and what is said
    5: ("sensor.rows", "is 480.5; it must be a whole number"),
    10: ("pixel.fil_factor", "Did you mean 'pixel.fill_factor'?"),
    11: ("pixel.full_well_e", "is -3; it must be at least 1"),
    17: ("quantum_efficiency.curves.mono.1", "if 60 is in percent, write 0.6"),
    21: ("dark_current.at_temperature_k", "if 25 is in °C, write 298.15"),
    22: ("dark_current.cvs", "Did you mean 'dark_current.cv'?"),
    32: ("dark_current.components.1.weight", "is 2.0; it must be at most 1"),
    38: ("source_follower", "give either read_noise_e or white_nv_per_rthz"),
    43: ("readout.rest", "Did you mean 'readout.reset'?"),
    45: ("adcs", "is not a field of a camera file. Did you mean 'adc'?"),
    49: ("lens.xyzzy", "is not a field"),
    52: ("sources.pixel.prnuu", "Did you mean 'pixel.prnu'?"),
}


def checked(text: str, folder: Path) -> tuple[CameraFinding, ...]:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return ms.check_camera(path)


def test_all_errors_of_a_file_are_found_at_once_with_their_lines(tmp_path: Path) -> None:
    """Errors of values, names, tables and contradictions, each in its line; the warnings come with them."""
    found = checked(MANY, tmp_path)
    errors = [one for one in found if one.level == "error"]
    assert {one.line: one.field for one in errors} == {
        line: field for line, (field, _) in ERRORS.items()
    }
    assert len(errors) == len(ERRORS)
    for one in errors:
        assert ERRORS[one.line or 0][1] in one.text and one.text.endswith((".", "?"))
        assert str(one) == f"{one.file}:{one.line}: error: {one.text}"
    warnings = {one.line: one.text for one in found if one.level == "warning"}
    assert sorted(warnings) == [8, 12]
    assert warnings[8].endswith("if 5.86e-06 is in metres, write 5.86.")
    assert found[-1].to_dict()["text"] == warnings[12]
    with pytest.raises(ms.InputError, match=r"first of \d+ errors; `cameras check` or check"):
        ms.load_camera(tmp_path / "mine.toml")


def test_thousands_of_unknown_keys_are_named_each_in_its_line(tmp_path: Path) -> None:
    """A second of a processor for 3000 of them."""
    keys = "".join(f"qwfpkey_number_{n} = {n}\n" for n in range(3000))
    found = checked(TABLE1.replace("[adc]\n", f"[adc]\n{keys}"), tmp_path)
    assert len(found) == 3000
    assert found[-1].line == found[0].line + 2999  # type: ignore[operator]


@pytest.mark.parametrize(
    "dotted", ["pixel.full_well_e", "readout.reset", "adc.bits", "sensor.columns", "adc"]
)
def test_a_misspelt_required_key_is_one_error_that_says_which_was_meant(
    dotted: str, tmp_path: Path
) -> None:
    """Not two, of an unknown key and of a missing one; loading says it too."""
    table, _, key = dotted.rpartition(".")
    wrong = key[:-1] + "x" + key[-1]
    text = (
        re.sub(rf"(?m)^{key} = ", f"{wrong} = ", TABLE1)
        if table
        else TABLE1.replace(f"[{key}]", f"[{wrong}]")
    )
    (one,) = checked(text, tmp_path)
    assert one.line == next(n for n, line in enumerate(text.splitlines(), 1) if wrong in line)
    assert f"Did you mean '{dotted}'?" in one.text
    with pytest.raises(ms.InputError, match=re.escape(f"Did you mean '{dotted}'?")):
        ms.load_camera(tmp_path / "mine.toml")


UNUSUAL = {  # a line of Table 1 → what stands there instead, and the end of the warning
    "prnu = 0.005": ("prnu = 50", "0 to 0.1 is usual: if 50 is in percent, write 0.5."),
    "pitch_x_um = 5.7": ("pitch_x_um = 5.86e-6", "if 5.86e-06 is in metres, write 5.86."),
    "wavelengths_nm = [400, 700]": ("wavelengths_nm = [0.4, 0.7]", "if 0.4 is in micrometres"),
    "sense_gain_uv_per_e = 5.0": ("sense_gain_uv_per_e = 5e-6", "5e-06 is in volts, write 5."),
    "full_well_e = 33000": ("full_well_e = 33", "if 33 is in thousands, write 33000."),
    "bits = 12": ("bits = 12\nblack_level_dn = 4000", "leaves 95 of 4095 codes for light"),
    "bits = 12\n": ("bits = 12\nfull_scale_v = 8.0\n", "fills 0.0206 of it"),
    "cds_sample_s = 1e-6": ("cds_sample_s = 1.0", "if 1 is in microseconds, write 1e-06."),
    "white_nv_per_rthz = 15": ("read_noise_e = 9000", "0.05 to 500 is usual: check its unit."),
}


@pytest.mark.parametrize("line", UNUSUAL)
def test_an_unusual_number_is_a_warning_with_the_way_out(line: str, tmp_path: Path) -> None:
    """And a note of the camera, which loads: a render says it too."""
    new, said = UNUSUAL[line]
    assert f"\n{line}" in TABLE1
    text = TABLE1.replace(f"\n{line}", f"\n{new}")
    (found,) = checked(text, tmp_path)
    number = next(
        n for n, row in enumerate(text.splitlines(), 1) if row.startswith(new.splitlines()[-1])
    )
    assert (found.level, found.line) == ("warning", number) and said in found.text
    assert ms.load_camera(tmp_path / "mine.toml").notes == (found.text.removesuffix("."),)


@pytest.mark.parametrize("name", ms.list_cameras())
def test_a_shipped_camera_has_no_finding(name: str) -> None:
    assert not ms.check_camera(name) and not ms.load_camera(name).notes


def test_the_example_of_a_field_is_usual() -> None:
    """So that a sentence with the example does not lead into a warning."""
    ranges = {
        name: usual for name, info in fields_of(ms.Camera).items() if (usual := usual_of(info))
    }
    assert len(ranges) > 25
    for name, usual in ranges.items():
        example = fields_of(ms.Camera)[name].examples[0]  # type: ignore[index]
        inner = next(iter(example.values())) if isinstance(example, dict) else example
        for number in inner if isinstance(inner, list) else [inner]:
            assert usual.includes(number) and usual.low < usual.high, name


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("name = x\n[sensor]\nrows = 0,5\n", 1),
        ('name = "x"\n[sensor\ncolumns = 5\n', 2),
        ('name = "x"\nname = "y"\n[sensor]\n', 2),
        ('name = "x"\nlist = [1,\n2\n[sensor]\ncolumns = 5\n', 4),
        ('name = """x\ny\n', None),
    ],
)
def test_a_file_that_is_no_toml_has_one_error(
    text: str, line: int | None, tmp_path: Path
) -> None:
    """The first, with the parser's line; the rest waits."""
    (one,) = checked(text, tmp_path)
    assert one.level == "error" and one.line == line and one.text.startswith("not valid TOML: ")
    assert one.text.endswith("; the rest is checked when this is right.")
    assert one.to_dict()["line"] == line
    with pytest.raises(ms.InputError, match="cannot be read"):
        ms.check_camera(tmp_path / "none.toml")


def test_a_lens_that_does_not_open_as_far_as_its_f_number_is_an_error(tmp_path: Path) -> None:
    """As a render says it; the file itself loads."""
    lens = '[lens]\nf_number = 1.4\nprescription = "double_gauss"\n'
    text = TABLE1.partition("[lens]")[0] + lens
    (found,) = (one for one in checked(text, tmp_path) if one.level == "error")
    assert found.line == text.splitlines().index('prescription = "double_gauss"') + 1
    assert "lens.f_number is 1.4, and the lens 'double_gauss' opens to f/2.05" in found.text
    assert not checked(text.replace("1.4", "2.8"), tmp_path)


JUNK = [
    "-3",
    "nan",
    "'x'",
    "[]",
    "[1]",
    "{a=1}",
    "true",
    "1e40",
    "=",
    "[[",
    "2999-01-01",
    "[[1,2],['R']]",
]
HEADERS = [
    "[adc]",
    "[lens.prescription]",
    "[[dark_current.components]]",
    "[[pixel]]",
    "[pixel.prnu]",
    "[sources]",
]


def damaged(text: str, random: np.random.Generator) -> str:
    """A camera file with one to five lines lost, doubled, moved, misspelt, or with another value or header."""
    lines = text.splitlines()
    for _ in range(random.integers(1, 6)):
        n, other = (int(x) for x in random.integers(len(lines), size=2))
        line, place = lines[n], int(random.integers(len(lines[n]) + 1))
        lines[n : n + 1] = (
            [],
            [line, lines[other]],
            [line.partition("=")[0] + "= " + str(random.choice(JUNK))],
            [line[:place] + "x" + line[place:]],
            [line[:place] + line[place + 1 :]],
            [str(random.choice(HEADERS)), line],
        )[random.integers(6)]
    return "\n".join(lines)


@pytest.mark.parametrize("files", [15, exhaustive(60)])
def test_a_damaged_file_has_an_error_exactly_if_it_does_not_load(
    files: int, tmp_path: Path
) -> None:
    """None of them stops the check; lines are those of the file."""
    random, loads, path = np.random.default_rng(5), 0, tmp_path / "mine.toml"
    for _ in range(files):
        name = str(random.choice(ms.list_cameras()))
        text = damaged(ms.load_camera(name).to_toml(), random)
        found = checked(text, tmp_path)
        errors = [one for one in found if one.level == "error"]
        assert all(one.line is None or 1 <= one.line <= text.count("\n") + 1 for one in found)
        if errors:
            with pytest.raises(ms.InputError):
                ms.load_camera(path)
        else:
            loads += bool(ms.load_camera(path))
    assert files / 20 < loads < 19 * files / 20
