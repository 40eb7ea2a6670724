"""What the program says about itself: help of every command, the version, and what a shell completes."""

from __future__ import annotations

import inspect
import os
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
from mitsuba_sensor.render.options import UnitOptions

PROGRAM = typer.main.get_command(app)


def commands(
    group: Any = PROGRAM, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command, those below cameras and study too, with the words that call it."""
    yield path, group
    for name in group.list_commands(None) if hasattr(group, "list_commands") else ():
        yield from commands(group.get_command(None, name), (*path, name))


COMMANDS = dict(commands())


def said(*arguments: str, **options: Any) -> str:
    done = CliRunner().invoke(app, list(arguments), **options)
    assert done.exit_code == 0, done.output
    return str(done.stdout)


def flat(text: str) -> str:
    """Help without frames and line breaks."""
    return " ".join(re.sub(r"[│╭╮╰╯─]", " ", text).split())


SCREEN = 45  # lines
WORK = [path for path, one in COMMANDS.items() if path and not hasattr(one, "list_commands")]
GROUPS = [path for path, one in COMMANDS.items() if hasattr(one, "list_commands")]
OWN = ("help", "help_all", "version", "install_completion", "show_completion")
"""Options that stand in no panel of ours."""


def test_short_help_keeps_defaults_of_one_word() -> None:
    help_of = flat(said("render", "-h", env={"COLUMNS": "80"}))
    assert "[default: konnik_table1, or the scene's]" in help_of and "[default: 72]" in help_of
    help_of = flat(said("budget", "-h", env={"COLUMNS": "80"}))
    assert "[default: auto, or the scene's]" in help_of and "[[" not in help_of


@pytest.mark.parametrize("path", one_in(3, COMMANDS), ids=" ".join)
def test_help_is_a_screen_and_help_all_has_every_flag_in_full(path: tuple[str, ...]) -> None:
    """In a panel of its own, with every value that is allowed; the docstring is there, and [sources] is no markup."""
    short = said(*path, "-h", env={"COLUMNS": "80"})
    assert short == said(*path, "--help", env={"COLUMNS": "80"})
    assert len(short.strip().splitlines()) <= SCREEN
    command = COMMANDS[path]
    names = {one.name: one for one in command.params if one.param_type_name == "option"}
    whole = said(*path, "--help-all" if "help_all" in names else "-h", env={"COLUMNS": "250"})
    for text in (short, whole):
        assert not re.search(r"<bool>|BOOLEAN|--[a-z-]*…|--[a-z-]+ +(?:<str>|<list)", text)
    for name, one in names.items():
        assert max(one.opts, key=len) in whole and (name in OWN or one.rich_help_panel), name
    for kind in (CaptureOptions, UnitOptions):
        for one in declared(kind):
            if one.choices and one.option.flag is not None and one.name in names:
                flag = f"--{one.name.replace('_', '-')}"
                row = re.search(rf"{flag} .*?(?=│ +--|╰)", whole, re.S)
                assert row and all(str(value) in row[0] for value in one.choices), one.name
    if path in WORK:
        about = flat(inspect.getdoc(command.callback) or "").replace("-", "")
        assert about in flat(whole).replace("-", "")


@pytest.mark.parametrize("path", one_in(2, WORK), ids=" ".join)
def test_help_says_how_to_see_the_options_that_it_leaves_out(path: tuple[str, ...]) -> None:
    names = {one.name: one for one in COMMANDS[path].params if one.param_type_name == "option"}
    if "help_all" not in names:
        return
    short = said(*path, "--help")
    assert f" {' '.join(path)} --help-all" in flat(short)
    first = set(COMMANDS[path].callback.first)
    assert first < set(names), "names of options that the command has"
    shown = re.findall(r"^│[* ]+(--?[A-Za-z-]+)", short, flags=re.M)
    for name, one in names.items():
        assert (max(one.opts, key=len) in shown) == (name in {*first, "help_all"}), name


@pytest.mark.parametrize("path", GROUPS, ids=" ".join)
def test_a_group_without_a_command_shows_its_help(path: tuple[str, ...]) -> None:
    done = CliRunner().invoke(app, list(path))
    assert done.stdout.strip() == said(*path, "--help").strip() and done.stderr == ""
    assert done.exit_code == 2


def test_commands_stand_in_the_order_of_use() -> None:
    names = ["render", "expose", "budget", "plan", "cameras", "scenes", "fpn-maps", "lint"]
    names += ["dataset", "characterize", "sheet", "fit", "study", "doctor"]
    assert re.findall(r"^│ ([a-z][a-z-]+) ", said("--help"), flags=re.M) == names
    assert {path[0] for path in COMMANDS if path} == set(names)


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
    "mitsuba-sensor render fir": ["first_frame"],
    "mitsuba-sensor scenes copy still": ["still_life"],
    "mitsuba-sensor render sce": [],  # the shell's own files
    "mitsuba-sensor render scene.xml -o ou": [],
    "mitsuba-sensor render scene.xml --fpn-maps ca": [],
    "mitsuba-sensor render scene.xml --camera ./my": [],
}


@pytest.mark.parametrize("line", CASES)
def test_a_shell_completes_commands_options_and_values(line: str) -> None:
    assert proposed(line) == CASES[line]


def test_bash_completes_files_where_nothing_is_proposed() -> None:
    asked = {"_MITSUBA_SENSOR_COMPLETE": "source_bash"}
    script = CliRunner().invoke(app, [], env=asked, prog_name="mitsuba-sensor")
    assert "complete -o default" in script.stdout
    assert subprocess.run(["bash", "-n"], input=script.stdout, text=True).returncode == 0


def test_the_program_runs_as_a_module() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mitsuba_sensor", "--version"], capture_output=True, text=True
    )
    assert done.stdout == f"mitsuba-sensor {ms.__version__}\n"


QUICK = {
    "the version": (["--version"], {}, {"typer", "rich", "numpy", "pydantic"}),
    "names of commands": (
        [],
        {"COMP_WORDS": "mitsuba-sensor re", "COMP_CWORD": "1"},
        {"numpy"},
    ),
    "options": ([], {"COMP_WORDS": "mitsuba-sensor render --", "COMP_CWORD": "2"}, {"numpy"}),
    "options of a dataset": (
        [],
        {"COMP_WORDS": "mitsuba-sensor dataset run --", "COMP_CWORD": "3"},
        {"numpy"},
    ),
    "cameras": (
        [],
        {"COMP_WORDS": "mitsuba-sensor render a.xml --camera b", "COMP_CWORD": "4"},
        {"numpy"},
    ),
}


@pytest.mark.parametrize("name", one_in(3, QUICK))
def test_version_and_completion_load_nothing_slow(name: str) -> None:
    """0.04 s and 0.2 s of a processor; NumPy alone takes 0.1 s. The clock is not asked."""
    arguments, instruction, slow = QUICK[name]
    environment = {**os.environ, **instruction}
    if instruction:
        environment["_MITSUBA_SENSOR_COMPLETE"] = "complete_bash"
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "mitsuba_sensor", *arguments],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert done.stdout and "Traceback" not in done.stderr
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "mitsuba_sensor" in loaded and not slow & loaded
