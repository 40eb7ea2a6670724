"""Killed writers, full disks, power cuts and corrupt files do no damage; tests/attacks/dataset_store.py does more."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from typing import Any

import pytest
from helpers import ATTACKS, ROOT


def attack(name: str, tries: int, script: str = "dataset_store.py") -> dict[str, Any]:
    """What the attack counts; it ends with 1 if anything is damaged."""
    command = [
        sys.executable,
        str(ATTACKS / script),
        name,
        "--tries",
        str(tries),
        "--json",
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, Any] = json.loads(done.stdout)[name]
    if "skipped" in found:
        pytest.skip(found["skipped"])
    return found


@pytest.mark.parametrize("script", ["dataset_store.py", "dataset_shards.py"])
def test_the_page_says_how_often_the_attacks_are_tried(script: str) -> None:
    """As many as the script tries if nothing is said."""
    page = (ROOT / "docs/datasets.md").read_text("utf-8")
    said = " ".join(page[page.index(f"attacks/{script}") :].split("\n\n")[0].split())
    tries = dict(
        re.findall(r'"(\w+)": \(\w+, ([\d_]+)\)', (ATTACKS / script).read_text("utf-8"))
    )
    for name, words in (
        ("kills", "SIGKILLs at random moments"),
        ("writers", "rounds of two to four"),
        ("corruptions", "random corruptions"),
    ):
        counted = re.search(rf"(\d+(?: 000)?) {words}", said)
        assert counted and int(counted[1].replace(" ", "")) == int(tries[name]), name


def test_a_writer_that_is_killed_at_any_moment_leaves_whole_entries_that_a_resumed_run_completes() -> (
    None
):
    found = attack("kills", 15)
    assert (found["tries"], found["damaged"]) == (15, 0)


@pytest.mark.exhaustive
def test_a_writer_may_die_in_any_system_call() -> None:
    found = attack("calls", 1)
    assert found["damaged"] == 0 and found["tries"] > 20


@pytest.mark.exhaustive
def test_several_writers_on_one_folder_do_no_harm() -> None:
    found = attack("writers", 8)
    assert found["damaged"] == 0 and found["killed"]


@pytest.mark.exhaustive
def test_a_full_disk_stops_a_writer_with_a_sentence_and_nothing_is_left_unfinished() -> None:
    found = attack("full", 2)
    assert all(found[error]["damaged"] == 0 for error in ("ENOSPC", "EDQUOT", "EIO", "disks"))
    assert found["disks"]["stopped"] >= 2


@pytest.mark.exhaustive
def test_when_the_power_fails_what_was_committed_is_there() -> None:
    assert attack("power", 1)["damaged"] == 0


def test_every_random_corruption_is_found_and_nothing_else() -> None:
    found = attack("corruptions", 200)
    assert (found["tries"], found["damaged"]) == (200, 0)


@pytest.mark.exhaustive
def test_a_dataset_is_scanned_in_memory_that_does_not_grow() -> None:
    found = attack("speed", 400)
    few, many = (float(one) for one in found["memory"]["scan_mib"].split(" and "))
    assert many - few < 3


@pytest.mark.exhaustive
def test_runs_that_write_parts_of_an_index_may_die_and_meet_full_disks_and_each_other() -> None:
    script = "dataset_index.py"
    for name, tries in (("kills", 5), ("calls", 1), ("shards", 6)):
        found = attack(name, tries, script)
        assert found["damaged"] == 0 and found["tries"] >= tries
    found = attack("full", 1, script)
    assert all(found[error]["damaged"] == 0 for error in ("ENOSPC", "EIO"))
