"""Arrays that are kept for the next run: whole or missing, and never an error."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mitsuba_sensor.files.user_cache import cache_folder, keep, kept_file, read_kept

ARRAYS = {"data": np.arange(2000.0), "widths": np.ones(3)}
KEEP_AGAIN = """
import numpy as np
from mitsuba_sensor.files.user_cache import keep
for number in range(20):
    keep("light", {"data": np.full(20_000, float(number))})
"""


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path


def test_what_is_kept_is_read_and_nothing_else_lies_in_the_folder(folder: Path) -> None:
    assert read_kept("light") is None
    keep("light", ARRAYS)
    kept = read_kept("light")
    assert kept is not None and set(kept) == set(ARRAYS)
    np.testing.assert_array_equal(kept["data"], ARRAYS["data"])
    assert [one.name for one in (folder / "mitsuba-sensor").iterdir()] == ["light.npz"]


def test_a_torn_file_counts_as_missing_and_is_written_over() -> None:
    keep("light", ARRAYS)
    whole = kept_file("light").read_bytes()
    for length in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        kept_file("light").write_bytes(whole[:length])
        assert read_kept("light") is None, length
    keep("light", ARRAYS)
    assert read_kept("light") is not None


@pytest.mark.exhaustive
def test_two_processes_that_keep_the_same_leave_a_whole_file_at_every_time() -> None:
    keep("light", {"data": np.full(20_000, -1.0)})
    writers = [subprocess.Popen([sys.executable, "-c", KEEP_AGAIN]) for _ in range(2)]
    while any(one.poll() is None for one in writers):
        kept = read_kept("light")
        assert kept is not None and np.ptp(kept["data"]) == 0
    assert [one.returncode for one in writers] == [0, 0]
    assert len(list(cache_folder().iterdir())) == 1


def test_a_folder_that_cannot_be_written_keeps_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "file").write_text("no folder")
    for base in (str(folder / "file"), "/proc"):
        monkeypatch.setenv("XDG_CACHE_HOME", base)
        keep("light", ARRAYS)
        assert read_kept("light") is None


def test_a_user_without_a_home_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container that runs under a number without a name."""

    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", no_home)
    keep("light", ARRAYS)
    assert read_kept("light") is None
