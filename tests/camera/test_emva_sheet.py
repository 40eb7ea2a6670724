"""A camera from an EMVA 1288 sheet: its f-number, and 1/K instead of K."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.camera.emva_sheet import camera_of_sheet, read_sheet

IMX174: dict[str, Any] = {
    **{"pitch_um": 5.86, "size": [1920, 1200], "bits": 12, "wavelength_nm": 525},
    **{"qe_percent": 77, "gain_dn_per_e": 0.1225, "read_noise_e": 6.83, "saturation_e": 32691},
    **{"dsnu_e": 0, "prnu_percent": 1, "dark_e_per_s": 5, "dark_temperature_c": 25},
}


def camera_of(folder: Path, **changes: Any) -> ms.Camera:
    path = folder / "sheet.toml"
    path.write_text(
        "\n".join(f"{name} = {x}" for name, x in (IMX174 | changes).items()), "utf-8"
    )
    return camera_of_sheet(read_sheet(path), "mine", "")


def test_an_assumed_f_number_is_marked_and_a_given_one_is_taken(tmp_path: Path) -> None:
    lines = camera_of(tmp_path).to_toml().splitlines()
    assert lines[lines.index("f_number = 2.8") - 1].startswith("# assumed: f/2.8")
    given = camera_of(tmp_path, f_number=1.4)
    assert given.lens.f_number == 1.4 and "# assumed: f/" not in given.to_toml()
    assert ms.load_camera(given.to_toml()) == given


@pytest.mark.parametrize(
    ("gain", "saturation_e", "both"),
    [
        (8.163, 32691, ("8.163", "0.122504")),
        (0.5, 2000, ("0.5", "2")),
        (12.0, 49000, ("12", "0.0833333")),
    ],
)
def test_one_over_k_is_found_where_the_sheet_contradicts_it(
    gain: float, saturation_e: float, both: tuple[str, str], tmp_path: Path
) -> None:
    with pytest.raises(ms.InputError, match=f"gain_dn_per_e is {both[0]}, .* write {both[1]},"):
        camera_of(tmp_path, gain_dn_per_e=gain, saturation_e=saturation_e)


@pytest.mark.parametrize(
    ("gain", "saturation_e"), [(1.2, 3000), (0.1225, 10000), (1.0, 4000), (0.9, 9000)]
)
def test_other_sheets_pass(gain: float, saturation_e: float, tmp_path: Path) -> None:
    """A well or an ADC may saturate first, and K near 1 is not contradicted."""
    camera_of(tmp_path, gain_dn_per_e=gain, saturation_e=saturation_e)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("size = 1440x1080", r"write size = \[1440, 1080\]"),
        ("qe = 64", r"qe is not a field of a sheet file\. Did you mean 'qe_percent'\?"),
        ("colour = 64", "colour is not a field of a sheet file"),
    ],
)
def test_a_row_that_is_not_toml_or_unknown_is_named(
    row: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "sheet.toml"
    path.write_text(f"bits = 12\n{row}\n", "utf-8")
    with pytest.raises(ms.InputError, match=message):
        read_sheet(path)
