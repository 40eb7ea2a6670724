"""io/journal.py: what was measured is not measured again, and never stands under another question."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.io.journal import Journal

QUESTION = {"study": "error-time", "camera": {"adc": {"bits": 12}, "pixel": {"pitch": 5.0}}, "seeds": (1, 2)}


def filled(path: Path) -> Journal:
    journal = Journal(path, QUESTION)
    journal["first"] = {"seconds": [0.25, 1 / 3], "error": math.inf, "none": None, "not": math.nan}
    journal["second"] = [1, 2, 3]
    return journal


def test_a_later_process_reads_every_bit_of_what_was_measured(tmp_path: Path) -> None:
    here, later = filled(tmp_path / "new" / "m.jsonl"), Journal(tmp_path / "new" / "m.jsonl", QUESTION)
    assert list(later) == ["first", "second"] and len(later) == 2
    assert later["first"]["seconds"] == [0.25, 1 / 3] and later["first"]["error"] == math.inf
    assert math.isnan(later["first"]["not"]) and later["first"]["none"] is None
    assert repr(dict(here)) == repr(dict(later))


@pytest.mark.parametrize("lost", [1, 5, 11])
def test_a_line_that_was_cut_short_is_measured_again(tmp_path: Path, lost: int) -> None:
    filled(tmp_path / "m.jsonl")
    whole = (tmp_path / "m.jsonl").read_bytes()
    (tmp_path / "m.jsonl").write_bytes(whole[:-lost])
    resumed = Journal(tmp_path / "m.jsonl", QUESTION)
    assert list(resumed) == ["first"]
    resumed["second"] = [1, 2, 3]
    assert (tmp_path / "m.jsonl").read_bytes() == whole


def test_another_question_is_refused_and_loses_nothing(tmp_path: Path) -> None:
    filled(tmp_path / "m.jsonl")
    before = (tmp_path / "m.jsonl").read_bytes()
    other = {**QUESTION, "camera": {"adc": {"bits": 14}, "pixel": {"pitch": 5.0}}}
    with pytest.raises(ms.InputError, match=r"another question \(camera\.adc\.bits\).*--force"):
        Journal(tmp_path / "m.jsonl", other)
    assert (tmp_path / "m.jsonl").read_bytes() == before
    assert not len(Journal(tmp_path / "m.jsonl", other, again=True))


@pytest.mark.parametrize("content", ["not JSON\n", "[1, 2]\n", '{"question": {}}\n{"name": "x"}\n', "3\n"])
def test_a_file_that_is_no_journal_is_left_alone(tmp_path: Path, content: str) -> None:
    (tmp_path / "m.jsonl").write_text(content, encoding="utf-8")
    with pytest.raises(ms.InputError, match="no journal of a study"):
        Journal(tmp_path / "m.jsonl", QUESTION)
    assert (tmp_path / "m.jsonl").read_text(encoding="utf-8") == content


def test_a_journal_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ms.InputError, match="cannot write"):
        Journal(tmp_path / "file" / "m.jsonl", QUESTION)["first"] = 1


def test_nothing_is_written_or_forgotten_before_the_first_measurement(tmp_path: Path) -> None:
    Journal(tmp_path / "new" / "m.jsonl", QUESTION)
    assert not (tmp_path / "new").exists()
    filled(tmp_path / "m.jsonl")
    anew = Journal(tmp_path / "m.jsonl", QUESTION, again=True)
    assert len(Journal(tmp_path / "m.jsonl", QUESTION)) == 2
    anew["third"] = 3
    assert list(Journal(tmp_path / "m.jsonl", QUESTION)) == ["third"]
