"""A short run of tests/attacks/fuzz_files.py, and what its longer runs have found."""

from __future__ import annotations

from pathlib import Path

import fuzz_cases
import fuzz_types
import pytest
from fuzz_files import report

CASES, TYPES = 210, 600


def test_damaged_files_are_accepted_or_refused_in_one_sentence() -> None:
    """In a process of its own with a limit of time; both results occur for each kind of file."""
    found = report(CASES, first=7)
    assert found["faults"] == []
    assert found["cases"] == CASES and len(found["counts"]) == 2 * len(fuzz_cases.KINDS)


@pytest.mark.exhaustive
def test_a_field_of_any_type_is_accepted_or_refused_in_one_sentence() -> None:
    """A part of all fields of all kinds of files, each replaced by a value of each type; all are right as they are."""
    every = fuzz_types.cases()
    wrong, counts = fuzz_types.faults(every[:TYPES])
    assert not wrong and counts["accepted"] > 100 and counts["refused"] > 100, wrong
    assert {kind.name for kind, _, _ in every[:TYPES]} == {
        kind.name for kind in fuzz_types.kinds()
    }


@pytest.mark.parametrize("kind", fuzz_types.kinds(), ids=lambda kind: kind.name)
def test_the_files_whose_fields_are_replaced_are_right(
    kind: fuzz_types.Kind, tmp_path: Path
) -> None:
    kind.write(tmp_path / kind.name, kind.tables)
    said = kind.read(tmp_path / kind.name)
    assert not isinstance(said, str) or not said


@pytest.mark.parametrize(
    ("name", "place", "value", "said"),
    [
        ("ros.yaml", ("distortion_model",), "list", "distortion_model is ['1']; it must be one of"),
        ("opencv.xml", ("distortion_coefficients", "data"), "nested table", "has no distortion_coefficients"),
        ("ros.xml", ("distortion_model",), "table", "distortion_model is {'a': '1'}"),
        ("transforms.json", ("frames",), "negative", "frames is -3; it must be a list of tables"),
        ("tuning.json", ("algorithms", 0), "zero", "algorithms is 0; it must be a table"),
        ("tuning.json", ("algorithms", 1, "rpi.noise"), "list", "rpi.noise is [1]; it must be a table"),
        ("table.json", ("A_100", "iso"), "table", "iso is {'a': 1}"),
        ("preset.toml", ("resolution",), "negative", "resolution is -3; it must be a list of numbers"),
        ("preset.toml", ("qe_curve", "qe"), "list of texts", "qe_curve.qe is 'a'"),
        ("bench.toml", ("stack", 0, "exposure_s"), "huge", "exposure_s is a whole number of 1329 bits"),
        ("camera.toml", ("adc", "bits"), "hexadecimal of many digits", "a whole number has 20001 bits"),
        ("iset.json", ("surfaces", 0, "radius"), "huge", "not numbers for radius"),
        ("light.exr", ("render_statistics", "passes"), "text", "passes is 'x'"),
        ("light.exr", ("bandwidths_nm",), "no list", "bandwidths_nm is []"),
        ("light.exr", ("first_pixel",), "nested list", "first_pixel is [[1, [2]]]"),
    ],
)  # fmt: skip
def test_a_field_of_a_wrong_type_is_named_with_its_value(
    name: str, place: fuzz_types.Place, value: str, said: str, tmp_path: Path
) -> None:
    kind = next(kind for kind in fuzz_types.kinds() if kind.name == name)
    what, why = fuzz_types.result(kind, place, value, tmp_path)
    assert what == "refused" and said in why, why


@pytest.mark.parametrize("kind", fuzz_cases.KINDS)
def test_the_files_that_are_damaged_are_right(kind: str, tmp_path: Path) -> None:
    suffix = fuzz_cases.SUFFIXES.get(kind, ".toml")
    files = (
        [(suffix, text.encode()) for text in fuzz_cases.sources(kind)]
        if kind != "pixels"
        else fuzz_cases.pixel_files()
    )
    for one in files:
        found = fuzz_cases.examined_file(kind, *one, tmp_path)
        assert found == ("accepted", ""), found
