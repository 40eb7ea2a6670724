"""Errors of camera fields and names: the value, the allowed values, what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.files.scene_xml import require_scene_file

TABLE1 = ms.load_camera("konnik_table1")
FIELDS: list[tuple[str, Any, tuple[str, ...]]] = [
    ("adc.bits", 25, ("is 25", "at most 24", "e.g. 12")),
    ("adc.bits", "12", ("'12'", "a whole number", "e.g. 12")),
    ("adc.bits", None, ("is missing", "add it, e.g. 12")),
    ("adc.bitz", 3, ("adc.bitz", "Did you mean 'adc.bits'")),
    ("adc.foo", 3, ("adc.foo", "The fields of [adc] are gamma, ile, bits")),
    ("companding.points", [1], ("The fields of [companding] are bits, knees",)),
    ("readouts", [{"name": "a", "bar": 1}], ("The fields of [readouts] are name, of",)),
    ("e_per_dn", 3, ("'readout.gain_dn_per_e', the reciprocal",)),
    ("pixel.pitch_x_um", 0, ("is 0", "above 0", "e.g. 5.7")),
    ("pixel.prnu", "1 %", ("'1 %'", "a number", "write 0.01 for '1 %'")),
    ("pixel.full_well_e", "33 000", ("write 33000 for",)),
    ("pixel.pitch_x_um", "5.7 um", ("omit 'um'",)),
    ("lens.f_number", "f/2.8", ("write 2.8 for",)),
    ("quantum_efficiency.value", 50, ("at most 1", "if 50 is in percent, write 0.5")),
    ("sensor.technology", "cdd", ("'cdd'", "must be 'cmos' or 'ccd'")),
    ("pixel", 3, ("pixel is 3", "must be a table")),
    ("gain", "800", ("camera.at_gain('800')",)),
    ("source_follower.read_noise_e", 3.0, ("not both. None unsets a field.",)),
]


@pytest.mark.parametrize(("field", "value", "words"), FIELDS)
def test_an_error_of_a_field_gives_value_allowed_values_and_remedy(
    field: str, value: Any, words: tuple[str, ...]
) -> None:
    with pytest.raises(ms.InputError) as caught:
        TABLE1.replace(**{field: value})
    assert not [x for x in words if x not in str(caught.value)], caught.value


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("bayer_2pm", " Did you mean 'bayer_2mp'?"),
        ("konnik", " Did you mean 'konnik_table1'?"),
        ("imx477", " Did you mean 'raspberry_pi_hq' (Raspberry Pi High Quality Camera: Sony"),
        ("imx", " Did you mean 'sony_imx174' or 'sony_imx250mzr' or"),
        ("xyz", " Pass the path of a .toml file, or a name from ms.list_cameras()."),
    ],
)
def test_an_unknown_camera_gets_the_suggestion_first(name: str, end: str) -> None:
    with pytest.raises(ms.InputError) as caught:
        ms.load_camera(name)
    assert str(caught.value).startswith(f"unknown camera {name!r}.{end}")
    assert str(caught.value).count("_") < 12, "not all names"


def test_a_camera_or_scene_file_with_a_near_name_is_suggested(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("my.toml", "own.xml"):
        (tmp_path / name).touch()
    for name in ("my.tml", "mu.toml", str(tmp_path / "mu.toml")):
        with pytest.raises(ms.InputError, match=r"Did you mean '.*my\.toml'\?"):
            ms.load_camera(name)
    with pytest.raises(ms.InputError, match=r"no file 'own.xm'. Did you mean 'own.xml'\?"):
        require_scene_file("own.xm")
