"""A camera file is checked as a whole: every error with its line, the field that was meant, and unusual numbers."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers import CAMERAS, ROOT

import mitsuba_sensor as ms
from mitsuba_sensor.camera.camera_check import CameraFinding

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
    with pytest.raises(ms.InputError, match=r"lists all \d+ errors"):
        ms.load_camera(tmp_path / "mine.toml")


def test_thousands_of_unknown_keys_are_named_each_in_its_line(tmp_path: Path) -> None:
    """A third of a second of a processor for 1000 of them."""
    keys = "".join(f"qwfpkey_number_{n} = {n}\n" for n in range(1000))
    found = checked(TABLE1.replace("[adc]\n", f"[adc]\n{keys}"), tmp_path)
    assert len(found) == 1000
    assert found[-1].line == found[0].line + 999  # type: ignore[operator]


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


def test_a_small_full_well_at_a_given_gain_is_one_warning(tmp_path: Path) -> None:
    """K fixes the range of the ADC, so nothing is to be said about adc.full_scale_v."""
    text = (ROOT / "examples/cmv4000.toml").read_text("utf-8")
    (warning,) = checked(text.replace("full_well_e = 13500", "full_well_e = 13.5"), tmp_path)
    assert warning.field == "pixel.full_well_e" and "write 13500" in warning.text


@pytest.mark.parametrize("name", ms.list_cameras())
def test_a_shipped_camera_has_no_finding(name: str) -> None:
    camera = ms.load_camera(name)
    assert not ms.check_camera(name) and not ms.check_camera(camera) and not camera.notes
