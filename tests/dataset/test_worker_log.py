"""Which deaths of a process count against the view that it was making."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mitsuba_sensor.core import DiskFull
from mitsuba_sensor.files.worker_log import (
    fatal_tries,
    is_begun,
    last_said,
    log_of,
    logged,
    note_death,
)

DIES = """
import os, sys
from pathlib import Path
from mitsuba_sensor.files.worker_log import logged
with logged(Path(sys.argv[1]), capture=sys.argv[2] == "worker") as log:
    print("the renderer says", file=sys.stderr, flush=True)
    os.kill(os.getpid(), int(sys.argv[3]))
"""


def died(path: Path, number: int, who: str = "worker") -> None:
    done = subprocess.run(
        [sys.executable, "-c", DIES, str(path), who, str(number)], capture_output=True
    )
    assert done.returncode == -number


def test_a_process_that_is_killed_with_its_run_counts_for_nothing(tmp_path: Path) -> None:
    path = tmp_path / "view.log"
    for _ in range(3):
        died(path, signal.SIGKILL)
    assert fatal_tries(path) == 0 and not is_begun(path)
    note_death(path)
    assert fatal_tries(path) == 1, "the run has seen the last one die"
    note_death(path)
    assert fatal_tries(path) == 1
    assert last_said(path) == "the renderer says"


@pytest.mark.exhaustive
@pytest.mark.parametrize("who", ["worker", "the run itself"])
def test_a_process_that_aborts_says_so_and_counts(who: str, tmp_path: Path) -> None:
    path = tmp_path / "view.log"
    for count in range(1, 4):
        died(path, signal.SIGABRT, who)
        note_death(path)
        assert fatal_tries(path) == count
    assert "Fatal Python error: Aborted" in log_of(path)
    with logged(path, capture=False):
        assert is_begun(path) and fatal_tries(path) == 3
        note_death(path)
        assert fatal_tries(path) == 3, "who still runs has not died"
    assert not path.exists(), "who ends well leaves no log"


def test_a_death_on_another_machine_counts_as_soon_as_the_run_has_seen_it(
    tmp_path: Path,
) -> None:
    path = tmp_path / "view.log"
    note_death(path)
    assert not path.exists(), "none has begun"
    path.write_bytes(b"# begun by elsewhere 1 99999999999\n")
    assert is_begun(path) and fatal_tries(path) == 0
    note_death(path)
    assert not is_begun(path) and fatal_tries(path) == 1


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="the file that is always full exists on Linux only"
)
def test_a_log_that_finds_no_place_is_a_full_disk(tmp_path: Path) -> None:
    (tmp_path / "view.log").symlink_to("/dev/full")
    with (
        pytest.raises(DiskFull, match=r"view\.log"),
        logged(tmp_path / "view.log", capture=True),
    ):
        pass
    assert os.listdir(tmp_path) == []
