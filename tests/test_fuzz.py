"""Short runs of tests/attacks, and what their longer runs have found."""

from __future__ import annotations

from pathlib import Path

import fuzz_arguments
import fuzz_files
import pytest

CASES = 140


def test_damaged_files_are_accepted_or_refused_in_one_sentence(tmp_path: Path) -> None:
    """Both results occur for each kind of file."""
    found = set()
    for kind, number in fuzz_files.byte_cases(7, CASES):
        result, why = fuzz_files.examined(kind, number, tmp_path)
        assert result != "fault", why
        found.add((kind, result))
    assert len(found) == 2 * len(fuzz_files.KINDS)


@pytest.mark.exhaustive
def test_thousands_of_damaged_files_and_fields_of_other_types_are_too() -> None:
    """In another process with limits of time and memory."""
    every = fuzz_files.type_cases()[:2000]
    counts, faults = fuzz_files.report([*fuzz_files.byte_cases(0, 3000), *every])
    assert not faults and sum(counts.values()) == 5000
    assert {name for name, *_ in every} == {kind.name for kind in fuzz_files.kinds()}


@pytest.mark.exhaustive
def test_a_strange_argument_is_right_or_refused() -> None:
    wrong, counts = fuzz_arguments.faults()
    assert not wrong and counts["accepted"] > 100 and counts["refused"] > 500


@pytest.mark.parametrize("kind", fuzz_files.kinds(), ids=lambda kind: kind.name)
def test_the_files_whose_fields_are_replaced_are_right(
    kind: fuzz_files.Kind, tmp_path: Path
) -> None:
    kind.write(tmp_path / kind.name, kind.tables)
    assert fuzz_files.judged(kind.read, tmp_path / kind.name) == ("accepted", "")


@pytest.mark.parametrize(
    ("name", "place", "value", "said"),
    [
        ("ros.yaml", ("distortion_model",), "list", "distortion_model is ['1']"),
        ("ros.xml", ("distortion_model",), "table", "distortion_model is {'a': '1'}"),
        ("transforms.json", ("frames",), "negative", "frames is -3"),
        ("tuning.json", ("algorithms", 1, "rpi.noise"), "list", "rpi.noise is [1]"),
        ("preset.toml", ("qe_curve", "qe"), "list of texts", "qe_curve.qe is 'a'"),
        ("bench.toml", ("stack", 0, "exposure_s"), "huge", "exposure_s is a whole number of 1329"),
        ("camera.toml", ("adc", "bits"), "hexadecimal of many digits", "20001 bits"),
        ("light.exr", ("render_statistics", "passes"), "text", "passes is 'x'"),
        ("light.exr", ("first_pixel",), "nested list", "first_pixel is [[1, [2]]]"),
    ],
)  # fmt: skip
def test_a_field_of_a_wrong_type_is_named_with_its_value(
    name: str, place: fuzz_files.Place, value: str, said: str, tmp_path: Path
) -> None:
    what, why = fuzz_files.examined_type(name, place, value, tmp_path)
    assert what == "refused" and said in why, why


@pytest.mark.parametrize("kind", fuzz_files.KINDS)
def test_the_files_that_are_damaged_are_right(kind: str, tmp_path: Path) -> None:
    suffix = fuzz_files.SUFFIXES.get(kind, ".toml")
    files = fuzz_files.pixel_files()
    if kind != "pixels":
        files = [(suffix, text.encode()) for text in fuzz_files.sources(kind)]
    for one in files:
        found = fuzz_files.examined_file(kind, *one, tmp_path)
        assert found == ("accepted", ""), found
