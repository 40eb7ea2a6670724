"""A datasheet that contradicts itself: one sentence with the file, the field, the value or range, and the way out.

(Single fields out of range are generated elsewhere; these are the pairs and triples that exclude each other.)
"""

from __future__ import annotations

import copy
import tomllib
from typing import Any

import pytest
from helpers import CAMERAS

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
TABLES = tomllib.loads((CAMERAS / "konnik_table1.toml").read_text(encoding="utf-8"))
del TABLES["sources"]
UNIFORM = {"weight": 0.6, "family": "uniform", "low": 45, "high": 440, "unit": "dn"}
NORMAL = {"weight": 0.6, "family": "normal", "mean": 18, "sigma": 4, "unit": "e"}

# What is set, the field the sentence must name, and what it must say: value or range, and what to do instead.
CASES: dict[str, tuple[dict[str, Any], str, str]] = {
    "k1 and A_SN": (
        {"readout.ve_k1_c": 1e-14, "readout.ve_nonlinearity": 1.0},
        "readout",
        "give either sense_gain_uv_per_e or ve_k1_c, which implies it, and not both",
    ),
    "neither k1 nor A_SN": (
        {"readout.sense_gain_uv_per_e": None},
        "readout",
        "the gain is missing",
    ),
    "gamma of e": (
        {"adc.gamma": 2.718281828459045},
        "adc.gamma",
        "is 2.718281828459045; it must be below 2.718",
    ),
    "gamma and ile": (
        {"adc.gamma": 1.04, "adc.ile": 0.0099},
        "adc",
        "give either gamma or ile, and not both; gamma = 1.04",
    ),
    "DNL below -1": (
        {"adc.dnl_lsb": {"7": -1.5}},
        "adc.dnl_lsb.7",
        "is -1.5; it must be at least -1",
    ),
    "darkness beyond the codes": (
        {"adc.black_level_dn": 5000.0, "adc.bits": 12},
        "adc",
        "black_level_dn is 5000, and the codes of 12 bits end at 4095; take a lower one, or more",
    ),
    "DNL of a code above the range": (
        {"adc.dnl_lsb": {"300": 0.1}, "adc.bits": 8},
        "adc",
        "'300'; .* from 1 to 254",
    ),
    "coupling of a family without": (
        {"dark_current.coupling": 0.1},
        "dark_current",
        'coupling belongs to distribution = "ar"',
    ),
    "two dark-current models": (
        {"dark_current.rate_e_per_s": 5.0, "dark_current.at_temperature_k": 300.0},
        "dark_current",
        r"give either fom_na_per_cm2 or rate_e_per_s \(with at_temperature_k\), and not both",
    ),
    "no dark-current model": (
        {"dark_current.fom_na_per_cm2": None},
        "dark_current",
        "the dark current is missing",
    ),
    "a rate of no temperature": (
        {"dark_current.fom_na_per_cm2": None, "dark_current.rate_e_per_s": 5.0},
        "dark_current",
        "its temperature is missing; give at_temperature_k",
    ),
    "weights above one": (
        {"dark_current.components": [UNIFORM, NORMAL]},
        "dark_current",
        "weights of components add up to 1.2; at most 1",
    ),
    "a uniform part with a mean": (
        {"dark_current.components": [UNIFORM | {"mean": 3}]},
        "dark_current.components.0",
        "a uniform component has low and high, and neither mean",
    ),
    "a part upside down": (
        {"dark_current.components": [UNIFORM | {"low": 500}]},
        "dark_current.components.0",
        "low is 500 and high is 440; high must be the larger",
    ),
    "a part of unknown unit": (
        {"dark_current.components": [UNIFORM | {"unit": "adu"}]},
        "dark_current.components.0.unit",
        "is 'adu'; it must be 'e_per_s', 'e' or 'dn'",
    ),
    "two read noises": (
        {"source_follower.read_noise_e": 3.0},
        "source_follower",
        "give either read_noise_e or white_nv_per_rthz",
    ),
    "a band upside down": (
        {"source_follower.band_hz": [1e6, 10.0]},
        "source_follower",
        r"band_hz is \[1000000.0, 10.0\]; its second frequency must be the higher",
    ),
    "value and file": (
        {"quantum_efficiency.value": 0.5, "quantum_efficiency.file": "qe.csv"},
        "quantum_efficiency",
        "give either value or file, and not both",
    ),
    "yield of another length": (
        {"quantum_efficiency.quantum_yield": [1.0]},
        "quantum_efficiency",
        "quantum_yield has 1 values for 2 wavelengths_nm",
    ),
    "wavelengths that fall": (
        {"quantum_efficiency.wavelengths_nm": [700.0, 400.0]},
        "quantum_efficiency",
        "wavelengths_nm must increase",
    ),
    "QE in percent": (
        {"quantum_efficiency.curves": {"mono": [0.6, 60.0]}},
        "quantum_efficiency.curves.mono.1",
        "at most 1 .*if 60 is in percent, write 0.6",
    ),
    "curves without a tile": (
        {"quantum_efficiency.curves": {"R": [0.6, 0.6], "G": [0.5, 0.5]}},
        "quantum_efficiency",
        "several curves need a tile",
    ),
    "a tile of unknown filters": (
        {"quantum_efficiency.tile": [["mono", "B"]]},
        "quantum_efficiency",
        r"tile names 'B', which has no curve; there are \['mono'\]",
    ),
    "a ragged tile": (
        {"quantum_efficiency.tile": [["mono", "mono"], ["mono"]]},
        "quantum_efficiency",
        "tile must be a rectangle",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_contradiction_is_one_sentence_with_field_and_remedy(case: str) -> None:
    """In a file, and in replace, where the sentence begins with the name of the camera."""
    changes, field, said = CASES[case]
    tables = copy.deepcopy(TABLES)
    for dotted, value in changes.items():
        table, key = dotted.split(".")
        tables[table].pop(key, None)
        if value is not None:
            tables[table][key] = value
    for where, make in (
        ("the dict", lambda: ms.load_camera(tables)),
        ("konnik_table1", lambda: TABLE1.replace(**changes)),
    ):
        with pytest.raises(ms.InputError, match=said) as caught:
            make()
        sentence = str(caught.value)
        assert sentence.startswith(f"{where}: {field}"), sentence
        assert "\n" not in sentence and len(sentence) < 420
        assert sentence.endswith(".") and not sentence.endswith("..")


EDGES: dict[str, dict[str, Any]] = {
    "gamma just below e": {"adc.gamma": 2.7182818},
    "missing code": {"adc.dnl_lsb": {"7": -1.0, "4094": 0.1}},
    "coupling at its end": {"readout.dsnu_col_coupling": 0.4999, "pixel.prnu_coupling": 0.45},
    "weights of one": {"dark_current.components": [UNIFORM, NORMAL | {"weight": 0.4}]},
}


@pytest.mark.parametrize("case", EDGES)
def test_what_just_does_not_contradict_itself_is_a_camera_that_works(case: str) -> None:
    camera = TABLE1.replace(**EDGES[case])
    assert ms.expose([[1000.0, 2000.0]], camera, ms.Exposure(0.1)).digital.shape == (1, 1, 2)


def test_a_limit_of_many_digits_is_written_short() -> None:
    with pytest.raises(ms.InputError, match=r"-1; it must be at least 1e-30 "):
        ms.load_camera("bayer_2mp").replace(**{"readout.gain_dn_per_e": -1})
