"""Ctrl-C and SIGTERM: the program ends at once, wherever it is, undoes what is not finished and says so."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.datasets import SCENES
from helpers.marks import exhaustive
from helpers.waiting import WAIT_S, wait_until

from mitsuba_sensor import stopping

PROGRAM = [sys.executable, "-m", "mitsuba_sensor"]
NOTHING_YET = "stopped; 0 samples are complete; the same command continues from there"
SMALL = """
name = "small"
render = { width = 16, spp = 2000000 }
scenes = [{ name = "flat", file = "flat_field.xml" }]
cameras = [{ camera = "konnik_table1" }]
"""


@contextmanager
def program(*arguments: object, temporary: Path) -> Iterator[subprocess.Popen[str]]:
    """The program in a process of its own, which does not ignore Ctrl-C as a shell's background jobs do."""
    child = subprocess.Popen(
        [*PROGRAM, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        start_new_session=True,
    )
    try:
        yield child
    finally:
        child.kill()


def stop(child: subprocess.Popen[str], number: signal.Signals) -> tuple[int, str]:
    """Exit code and stderr; what it was asked for would have taken longer than this waits."""
    child.send_signal(number)
    _, said = child.communicate(timeout=WAIT_S)
    return child.returncode, said


@pytest.mark.parametrize(
    ("number", "code", "variant"),
    [
        (signal.SIGINT, 130, None),
        exhaustive(signal.SIGINT, 130, "scalar_spectral"),
        exhaustive(signal.SIGTERM, 143, "scalar_spectral"),
        exhaustive(signal.SIGTERM, 143, None),
    ],
)
def test_a_stopped_render_leaves_nothing_behind(
    number: signal.Signals, code: int, variant: str | None, scene_file: Path, tmp_path: Path
) -> None:
    """In the midst of a render of many minutes, for which Mitsuba catches Ctrl-C itself."""
    (out := tmp_path / "results").mkdir()
    asked = ["--spp", 10_000_000, *(("--variant", variant) if variant else ())]
    with program(
        "render", scene_file, "-o", out / "new" / "out", *asked, temporary=out
    ) as child:
        wait_until((out / "new" / "out").exists)
        time.sleep(1.0)
        found, said = stop(child, number)
    assert (found, said) == (code, "stopped; nothing was written\n")
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("after_s", [exhaustive(0.1), 0.3, exhaustive(0.6)])
def test_a_program_that_still_imports_can_be_stopped(
    after_s: float, scene_file: Path, tmp_path: Path
) -> None:
    (out := tmp_path / "results").mkdir()
    with program("render", scene_file, "-o", out / "new", temporary=out) as child:
        time.sleep(after_s)
        found, said = stop(child, signal.SIGTERM)
    assert found in (143, -signal.SIGTERM) and said in (
        "",
        "stopped; nothing was written\n",
    )  # before it began at all
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("after_s", [*map(exhaustive, (0.1, 0.4, 0.7)), 1.0])
def test_ctrl_c_that_workers_get_too_while_they_begin_says_one_sentence(
    after_s: float, tmp_path: Path
) -> None:
    """As from a terminal, which gives it to all processes of a command: those that begin take it later, in silence."""
    (tmp_path / "small.toml").write_text(SMALL, encoding="utf-8")
    arguments = [
        "dataset",
        "run",
        tmp_path / "small.toml",
        "-o",
        tmp_path / "out",
        "--root",
        SCENES,
        "--workers",
        2,
    ]
    with program(*arguments, temporary=tmp_path) as child:
        wait_until((tmp_path / "out" / "dataset.json").exists)
        time.sleep(after_s)
        os.killpg(child.pid, signal.SIGINT)
        _, said = child.communicate(timeout=WAIT_S)
    assert (child.returncode, said) == (130, f"{NOTHING_YET}\n")
    assert not list(tmp_path.rglob(".*"))


@pytest.mark.parametrize("prepare", ["stop_at_signals", "undo_when_terminated"])
def test_a_signal_that_the_caller_ignores_stays_ignored(prepare: str) -> None:
    """As under nohup, or in a background job of a script."""
    code = (
        "import os, signal, time\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        f"from mitsuba_sensor.stopping import {prepare}\n"
        f"{prepare}(); os.kill(os.getpid(), signal.SIGINT); time.sleep(0.3); print('alive')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "alive\n" and done.returncode == 0, done.stderr


def test_what_another_thread_writes_while_the_program_stops_is_removed_too(
    tmp_path: Path,
) -> None:
    """A thread that fills the scratch folder as fast as it can; it ends with the process."""
    code = (
        "import os, signal, sys, threading\nfrom pathlib import Path\n"
        "from mitsuba_sensor.stopping import stop_at_signals\n"
        "stop_at_signals()\n"
        "from mitsuba_sensor.files.appearing import output_folder\n"
        "with output_folder(Path(sys.argv[1]), ['a']) as scratch:\n"
        "    for n in range(10**9):\n"
        "        (scratch / str(n)).write_bytes(b'x' * 1000)\n"
        "        if n == 500: os.kill(os.getpid(), signal.SIGTERM)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "out"], capture_output=True, text=True
    )
    assert done.returncode == 143 and done.stderr == "stopped; nothing was written\n"
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_complete_are_named(tmp_path: Path) -> None:
    stopping.begin_command()
    (tmp_path / "a").touch()
    for name in ("a", "b", "a"):
        stopping.note_written(tmp_path / name)
    assert stopping.sentence() == f"stopped; complete: {tmp_path / 'a'}"
    stopping.begin_command()
    assert stopping.sentence() == "stopped; nothing was written"
