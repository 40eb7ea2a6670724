"""Work that is shared by the calling thread and others."""

from __future__ import annotations

import os
import sys
import threading

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.sensor import threads

EXPOSURE, LIGHT = ms.Exposure(0.1), np.full((600, 700), 1e3)


def test_an_error_of_any_thread_arrives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "processors", lambda: 2)
    here, other = threading.current_thread(), threading.Event()

    def work(item: int) -> None:
        if threading.current_thread() is here:
            assert other.wait(20)
        else:
            other.set()
            raise ValueError(f"item {item}")

    with pytest.raises(ValueError, match="item"):
        threads.for_each(work, range(2))


def test_work_inside_of_work_does_not_wait_for_its_own_threads() -> None:
    done: list[int] = []
    threads.for_each(lambda _: threads.for_each(done.append, range(10)), range(20))
    assert len(done) == 200


@pytest.mark.skipif(not hasattr(os, "fork") or sys.platform == "darwin", reason="needs fork")
def test_a_forked_process_has_threads_of_its_own() -> None:
    camera = ms.load_camera("konnik_table1")
    whole = ms.expose(LIGHT, camera, EXPOSURE, engine="numpy").digital
    child = os.fork()
    if child == 0:
        same = np.array_equal(whole, ms.expose(LIGHT, camera, EXPOSURE, engine="numpy").digital)
        os._exit(0 if same else 1)
    assert os.waitpid(child, 0)[1] == 0
