"""What the program says about itself: help of every command, the version, and what a shell completes."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from helpers.marks import one_in
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.capture_options import CaptureOptions
from mitsuba_sensor.cli import app
from mitsuba_sensor.core.options import declared

PROGRAM = typer.main.get_command(app)


def commands(
    group: Any = PROGRAM, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command, those below cameras and study too, with the words that call it."""
    yield path, group
    for name, one in getattr(group, "commands", {}).items():
        yield from commands(one, (*path, name))


COMMANDS = dict(commands())


def said(*arguments: str, **options: Any) -> str:
    done = CliRunner().invoke(app, list(arguments), **options)
    assert done.exit_code == 0, done.output
    return str(done.stdout)


def flat(text: str) -> str:
    """Help without frames and line breaks."""
    return " ".join(re.sub(r"[│╭╮╰╯─]", " ", text).split())


@pytest.mark.parametrize("path", one_in(3, COMMANDS), ids=" ".join)
def test_h_is_help_and_every_flag_stands_in_a_panel(path: tuple[str, ...]) -> None:
    help_text = said(*path, "--help")
    assert said(*path, "-h") == help_text
    for one in COMMANDS[path].params:
        own = one.param_type_name == "argument" or one.name in (
            "help",
            "version",
            "install_completion",
        )
        assert own or one.name == "show_completion" or one.rich_help_panel, one.name
        assert max(one.opts, key=len) in help_text or one.param_type_name == "argument"


def test_commands_stand_in_the_order_of_use() -> None:
    names = ["render", "expose", "plan", "cameras", "fpn-maps", "lint", "dataset"]
    names += ["characterize", "fit", "study", "doctor"]
    assert re.findall(r"^│ ([a-z][a-z-]+) ", said("--help"), flags=re.M) == names
    assert {path[0] for path in COMMANDS if path} == set(names)


def test_choices_are_shown_as_choices() -> None:
    help_text = flat(said("render", "--help", env={"COLUMNS": "200"}))
    choices = [
        one for one in declared(CaptureOptions) if one.choices and one.option.flag is not None
    ]
    assert len(choices) > 4
    for one in choices:
        if one.option.metavar is None:
            assert "|".join(one.choices) in help_text
        else:  # too long for a narrow terminal: they stand in the sentence
            assert all(re.search(rf"\b{choice}\b", one.option.help) for choice in one.choices)


def test_the_version_is_one_line() -> None:
    assert said("--version") == f"mitsuba-sensor {ms.__version__}\n"


def proposed(line: str) -> list[str]:
    """What a shell is told where the cursor stands at the end of the line."""
    words = line.split(" ")
    instruction = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    environment = {"_MITSUBA_SENSOR_COMPLETE": "complete_bash", **instruction}
    return (
        CliRunner().invoke(app, [], env=environment, prog_name="mitsuba-sensor").stdout.split()
    )


CASES = {
    "mitsuba-sensor re": ["render"],
    "mitsuba-sensor cameras ch": ["check"],
    "mitsuba-sensor study s": ["stress"],
    "mitsuba-sensor render --exp": ["--exposure-s"],
    "mitsuba-sensor render scene.xml --camera bayer": ["bayer_2mp"],
    "mitsuba-sensor cameras new my.toml --like kon": ["konnik_table1"],
    "mitsuba-sensor cameras show rgb": ["rgbir_2mp"],
    "mitsuba-sensor expose light.exr --engine d": ["drjit"],
    "mitsuba-sensor render scene.xml --spectral c": ["cube", "channels"],
    "mitsuba-sensor expose light.exr --set adc.b": ["adc.bits=", "adc.black_level_dn="],
    "mitsuba-sensor render scene.xml --variant ll": ["llvm_ad_spectral"],
    "mitsuba-sensor render sce": [],  # the shell's own files
    "mitsuba-sensor render scene.xml -o ou": [],
    "mitsuba-sensor render scene.xml --fpn-maps ca": [],
    "mitsuba-sensor render scene.xml --camera ./my": [],
}


@pytest.mark.parametrize("line", CASES)
def test_a_shell_completes_commands_options_and_values(line: str) -> None:
    assert proposed(line) == CASES[line]


def test_bash_completes_files_where_nothing_is_proposed() -> None:
    script = CliRunner().invoke(
        app, [], env={"_MITSUBA_SENSOR_COMPLETE": "source_bash"}, prog_name="mitsuba-sensor"
    )
    assert "complete -o default" in script.stdout
    assert subprocess.run(["bash", "-n"], input=script.stdout, text=True).returncode == 0


def test_the_program_runs_as_a_module() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mitsuba_sensor", "--version"], capture_output=True, text=True
    )
    assert done.stdout == f"mitsuba-sensor {ms.__version__}\n"
