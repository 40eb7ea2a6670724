"""Memory that is free, and what is refused because it has no place in it."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.files import memory
from mitsuba_sensor.sensor import expose

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.01)
PHOTONS = np.full((48, 64), 100.0)


def said(folder: Path, monkeypatch: pytest.MonkeyPatch, **files: str) -> float:
    """What is free in a container that has these files, on a machine where 5 MB are free."""
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=5e6))
    monkeypatch.setattr(memory, "CONTAINER", folder)
    return memory.free_memory_bytes()


def test_it_is_that_of_the_machine_or_of_its_container(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert said(tmp_path, monkeypatch) == 5e6
    assert said(tmp_path, monkeypatch, memory_max="max\n", memory_current="7\n") == 5e6
    limited = said(
        tmp_path,
        monkeypatch,
        memory_max="1000000\n",
        memory_current="700000\n",
        memory_stat="anon 5\ninactive_file 200000\n",
    )
    assert limited == 1_000_000 - (700_000 - 200_000)


@pytest.mark.parametrize("keep", [(), ("volts",)])
def test_frames_beyond_memory_are_refused_before_any_is_made(
    keep: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two bytes of the code and eight of each signal that is kept, in every pixel of 10⁸ frames."""
    expected_gb = 1e8 * PHOTONS.size * (2 + 8 * len(keep)) / 1e9
    monkeypatch.delattr(expose, "FrameRunner")  # which makes frames
    with pytest.raises(
        ms.InputError, match=r"frames is 100000000; 100000000 × 64 × 48 pixels"
    ) as raised:
        ms.expose(PHOTONS, CAMERA, EXPOSURE, frames=1e8, keep=keep, engine="numpy")
    found = re.search(r"pixels need ([\d.e+]+) GB, but [\d.]+ GB are free", str(raised.value))
    assert found and float(found[1]) == pytest.approx(expected_gb, rel=5e-3)
    assert "ms.stream" in str(raised.value)


def test_a_stream_of_as_many_frames_keeps_none() -> None:
    frames = ms.stream(PHOTONS, CAMERA, EXPOSURE, frames=100_000_000, engine="numpy")
    assert next(frames).shape == PHOTONS.shape
