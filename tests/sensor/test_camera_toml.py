"""The text of a camera file: it loads as an equal camera, has every key with its meaning, and says what is not set."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.camera.field_catalogue import tables

TABLE1 = ms.load_camera("konnik_table1")
COMPONENT = {"weight": 0.001, "family": "uniform", "low": 45, "high": 440, "unit": "dn"}
TEXTS = 'quotes " and \\ and tab \t and \x7f and \n new lines, µ, 東京'

CAMERAS: dict[str, ms.Camera] = {
    name: ms.load_camera(name) for name in ("bayer_2mp", "scmos_dual_gain", "sony_a7s2")
} | {
    "a prescription": TABLE1.replace(
        **{"lens.prescription": "double_gauss", "lens.focal_length_mm": 25}
    ),
    "lists": TABLE1.replace(
        **{
            "dark_current.components": [COMPONENT, COMPONENT | {"weight": 0.1}],
            "adc.dnl_lsb": {str(code): 0.1 / code for code in range(1, 60)},
        }
    ),
    "names to be quoted": ms.load_camera("bayer_2mp").replace(
        **{
            "quantum_efficiency.curves": {
                "R e d": [0.1, 0.2],
                "g.1": [0.0, 1 / 3],
                "": [0.5, 0.5],
            },
            "quantum_efficiency.wavelengths_nm": [400, 1e9 / 3],
            "quantum_efficiency.tile": [["R e d", "g.1"], ["", ""]],
            "name": TEXTS,
            "description": TEXTS,
        }
    ),
    "tiny and huge numbers": TABLE1.replace(
        **{
            "readout.ve_k1_c": 1.0909e-14,
            "readout.ve_nonlinearity": 0.1,
            "readout.sense_gain_uv_per_e": None,
        }
    ).replace(
        **{"source_follower.corner_hz": 1.2345678901234567e12, "pixel.dsnu_e": 5e-324 * 2**1000}
    ),
    "alternatives": TABLE1.replace(
        **{
            "source_follower.white_nv_per_rthz": None,
            "source_follower.read_noise_e": 3,
            "dark_current.fom_na_per_cm2": None,
            "dark_current.rate_e_per_s": 5,
            "dark_current.at_temperature_k": 298.15,
        }
    ),
}


def loaded(text: str, folder: Path) -> ms.Camera:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return ms.load_camera(path)


@pytest.mark.parametrize("name", CAMERAS)
def test_the_file_of_a_camera_loads_as_an_equal_camera(name: str, tmp_path: Path) -> None:
    """And its text again is the same."""
    text = CAMERAS[name].to_toml()
    again = loaded(text, tmp_path)
    assert again == CAMERAS[name] and again.to_toml() == text
    assert (
        max(map(len, re.findall(r"(?m)^#.*$", text.partition("[sources]")[0]))) <= 120
        or name == "alternatives"
    )


def keys_of(text: str) -> dict[str, set[str]]:
    """Table → keys, set or behind a #."""
    found: dict[str, set[str]] = {"": set()}
    for line in text.splitlines():
        if header := re.fullmatch(r"\[+([\w.]+)\]+", line):
            found.setdefault((table := header.group(1)), set())
        elif key := re.match(r"(?:# )?(\w+)[\w.]* = ", line):
            found["" if len(found) == 1 else table].add(key.group(1))
    return found


@pytest.mark.parametrize("name", ["bayer_2mp", "scmos_dual_gain"])
def test_every_key_that_there_is_stands_in_the_file_below_its_explanation(name: str) -> None:
    """With its description, its unit and, where it is declared, its usual range; tables of a list have headers."""
    text = CAMERAS[name].to_toml()
    keys, prose = keys_of(text), " ".join(text.replace("\n#  ", "").split())
    for table in tables(ms.Camera):
        if table.path in keys:
            entries = [
                one
                for one in table.entries
                if f"{table.path}.{one.name}".lstrip(".") not in keys
            ]
            assert {one.name for one in entries} == keys[table.path], table.path
            for one in entries:
                said = " ".join(
                    f"{one.meaning}{f' [{one.unit}]' if one.unit else ''}; {one.allowed}".split()
                )
                assert f"# {said}" in prose, said
                assert f"usual {one.usual}" in prose or not one.usual
    assert {table.path for table in tables(ms.Camera)} >= set(keys) - {"sources"}


def test_an_unset_field_has_its_default_again() -> None:
    camera = TABLE1.replace(
        **{"source_follower.gain": 0.5, "lens.f_number": 8.0, "adc.black_level_dn": 64}
    )
    assert camera.replace(**{"source_follower.gain": None}).source_follower.gain == 1.0
    assert camera.replace(**{"lens": None}).lens == type(camera.lens)()
    assert not [
        key for key in camera.replace(**{"lens": None}).sources if key.startswith("lens.")
    ]
    assert camera.replace(**{"adc.black_level_dn": None}).adc == TABLE1.adc
    with pytest.raises(ms.InputError, match=r"adc\.bits is missing; add it, e\.g\. 12"):
        camera.replace(**{"adc.bits": None})
