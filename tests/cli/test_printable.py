"""What stands in files and names of strangers reaches the terminal, sentences and JSON as printable text."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from helpers.marks import one_in
from helpers.waiting import WAIT_S
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.camera.field_catalogue import toml_of
from mitsuba_sensor.cli import app
from mitsuba_sensor.core.printable import printable, printable_json, printable_toml
from mitsuba_sensor.files.texts import to_json

PROGRAM = (sys.executable, "-m", "mitsuba_sensor")
STRANGE = "a\x1b[31m\x1b]0;t\x07\x9b2Jé×µ\u00a0\u202e\u2028\u200f\x7f\r\n\tb\udcff😀\U000e0001"
"""Colours, the title of the window, C1 controls, bidi overrides, line breaks, a byte that is no text; and letters."""
LETTERS = "é×µ\u00a0😀"


def toml_text(text: str) -> str:
    """A text of TOML, every letter escaped."""
    letters = "".join(f"\\U{ord(letter):08X}" for letter in text)
    return f'"{letters}"'


@pytest.fixture
def camera_text() -> str:
    """A camera whose texts hold all that TOML can hold of it."""
    texts = toml_text(STRANGE.replace("\udcff", ""))
    text = ms.load_camera("konnik_table1").to_toml()
    for field in ("name", "description"):
        line = next(row for row in text.split("\n") if row.startswith(f"{field} ="))
        text = text.replace(line, f"{field} = {texts}")
    return text


def is_printable(text: str) -> bool:
    return all(one.isprintable() or one in "\n\u00a0" for one in text)


def test_letters_stay_and_all_else_is_escaped() -> None:
    shown = printable(STRANGE)
    assert all(letter in shown for letter in LETTERS)
    assert is_printable(shown) and "\n" not in shown and shown == printable(shown)
    for escaped in (
        r"\x1b[31m",
        r"\x07",
        r"\x9b",
        r"\u202e",
        r"\u2028",
        r"\x7f",
        r"\r\n\tb\udcff",
        r"\U000e0001",
    ):
        assert escaped in shown


def test_every_code_point_is_either_the_same_or_escaped() -> None:
    """Python's own literal of the escape is the code point."""
    for number in [*range(0x3000), *range(0xD7F0, 0xE010), *range(0xE0000, 0xE0100)]:
        shown = printable(chr(number))
        assert shown == chr(number) or json.loads(
            printable_json(json.dumps(chr(number)))
        ) == chr(number)
        assert eval(f"'{shown}'" if number not in (0x27, 0x5C) else ascii(chr(number))) == chr(
            number
        )


def test_json_and_toml_say_the_same_as_before() -> None:
    assert json.loads(to_json({STRANGE: [STRANGE]})) == {STRANGE: [STRANGE]}
    assert is_printable(to_json({STRANGE: STRANGE}))
    text = STRANGE.replace("\udcff", "")
    assert is_printable(toml_of(text)) and tomllib.loads(f"x = {toml_of(text)}") == {"x": text}
    assert printable_toml("\U000e0001") == r"\U000e0001"


def test_a_sentence_is_one_printable_line_of_bounded_length() -> None:
    assert str(ms.InputError(f"{STRANGE} is wrong.")) == f"{printable(STRANGE)} is wrong."
    assert len(str(ms.InputError("x" * 10**6 + "; give y."))) < 1500
    assert str(ms.InputError("x" * 10**6 + "; give y.")).endswith("; give y.")


@pytest.mark.parametrize(
    "arguments", one_in(3, [("show",), ("show", "--json"), ("show", "--toml"), ("check",)])
)
def test_names_in_a_camera_file_do_not_reach_the_terminal_raw(
    arguments: tuple[str, ...], camera_text: str, tmp_path: Path
) -> None:
    """Whole and wrong, as keys and as values; our own styles are not on, because nobody watches."""
    (tmp_path / "a.toml").write_text(camera_text)
    (tmp_path / "b.toml").write_text(f"{toml_text(STRANGE[:20])} = 1\n{camera_text}")
    (tmp_path / "c.toml").write_text(
        camera_text.replace("bits = ", f"bits = {toml_text(STRANGE[:20])} # ")
    )
    for name in ("a", "b", "c"):
        done = CliRunner().invoke(
            app, ["cameras", *arguments[:1], str(tmp_path / f"{name}.toml"), *arguments[1:]]
        )
        assert is_printable(done.output), ascii(done.output)
        silent = (name, *arguments) == ("a", "check")  # nothing is wrong
        assert silent or r"\x1b[31m" in done.output or r"\u001b[31m" in done.output
        assert done.exit_code == (0 if name == "a" else 2)


def test_our_own_styles_and_the_cursor_of_progress_bars_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from mitsuba_sensor.cli.app import PrintableConsole

    monkeypatch.setenv("TERM", "xterm")  # a dumb terminal has no cursor
    console = PrintableConsole(force_terminal=True, width=60, color_system="standard")
    with console.capture() as taken:
        console.print("[bold red]error:[/] \x1b[32m\x9b", highlight=False)
    assert (
        taken.get().startswith("\x1b[1;31merror:\x1b[0m ")
        and r"\x1b[32m" in taken.get()
        and r"\x9b" in taken.get()
    )
    with console.capture() as taken:
        console.clear()
    assert taken.get() == "\x1b[2J\x1b[H"


def run(*arguments: Any, **options: Any) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [*PROGRAM, *arguments], capture_output=True, timeout=WAIT_S, **options
    )


@pytest.mark.exhaustive
def test_a_file_whose_name_is_no_text_is_read_and_named(tmp_path: Path) -> None:
    """Of a camera, of what is imported into one, and of what is not there."""
    folder = os.fsencode(tmp_path)
    camera, other = folder + b"/\xff\x1b[31m.toml", folder + b"/\xfe.json"
    with open(camera, "w") as file:
        file.write(ms.load_camera("konnik_table1").to_toml())
    with open(other, "w") as file:
        json.dump({"fl_x": 100, "w": 64, "h": 48}, file)
    assert ms.load_camera(os.fsdecode(camera)).name == "konnik_table1"
    made = run("cameras", "import", other, "-o", folder + b"/\xfd.toml", "--json")
    assert made.returncode == 0 and json.loads(made.stdout)["name"] == r"\udcfe", made.stderr
    with pytest.raises(ms.InputError, match=r"\\udcff.toml cannot be read"):
        ms.load_camera(os.fsdecode(b"\xff.toml"))
    with pytest.raises(ms.InputError, match="not UTF-8"):
        ms.render(os.fsdecode(camera), ms.load_camera("konnik_table1"), ms.Exposure(0.01))


@pytest.mark.parametrize(
    ("arguments", "exit_code"),
    one_in(
        6,
        [
            (("--help",), 0),
            (("render", "--help-all"), 0),
            (("cameras",), 2),
            (("cameras", "schema"), 0),
            (("cameras", "show", "bayer_2mp"), 0),
            (("cameras", "check", "no_camera"), 2),
        ],
        several=True,
    ),
)
def test_a_pipe_that_nobody_reads_changes_nothing(
    arguments: tuple[str, ...], exit_code: int
) -> None:
    """As `| head -0` does: the pipe is closed before anything is written."""
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [*PROGRAM, *arguments], stdout=writer, stderr=subprocess.PIPE, timeout=WAIT_S
    )
    os.close(writer)
    assert done.returncode == exit_code and b"Traceback" not in done.stderr
    assert b"Broken pipe" not in done.stderr
