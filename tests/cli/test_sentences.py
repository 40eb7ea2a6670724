"""Options that notes, errors and help name: each exists in the command that says so."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from helpers.marks import one_in
from typer.testing import CliRunner

import mitsuba_sensor
from mitsuba_sensor.cli import app
from mitsuba_sensor.cli.sentences import CODE, OPTION, commands_below, options_of, said_by

PROGRAM: Any = typer.main.get_command(app)
COMMANDS = dict(commands_below(PROGRAM))
OF_OTHERS = {"--orientation-method", "--center-method", "--auto-scale-poses", "--data"}
OF_OTHERS |= {"--force-reinstall", "--help", "--version"}
"""Options of other programs, and those of every command."""


@cache
def sentences() -> dict[str, str]:
    """Each text of the package that names an option, and where it stands; docstrings left out."""
    found = {}
    for path in sorted(Path(mitsuba_sensor.__file__).parent.rglob("*.py")):
        source = path.read_text("utf-8")
        if OPTION.search(source):
            for text, line in texts_of(ast.parse(source)):
                found[text] = f"{path.name}:{line}"
    return found


def texts_of(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Texts that name an option, with their lines."""
    nodes = list(ast.walk(tree))
    documents = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and id(node) not in documents and OPTION.search(text):
            yield text, node.lineno


def named(sentence: str) -> set[str]:
    """The options that a sentence names outside whole commands."""
    return {match[1] for match in OPTION.finditer(CODE.sub("", sentence))} - OF_OTHERS


def context_of(name: str) -> Any:
    """As if the command ran."""
    program = PROGRAM.make_context("mitsuba-sensor", ["doctor"])
    command = COMMANDS[name]
    return type(program)(command, parent=program, info_name=name.rpartition(" ")[2])


def test_every_option_of_a_sentence_is_one_of_some_command() -> None:
    known = set().union(*map(options_of, COMMANDS.values()))
    assert len(sentences()) > 60
    unknown = {where: named(text) - known for text, where in sentences().items()}
    assert not {where: names for where, names in unknown.items() if names}


def test_an_option_with_its_value_in_backticks_keeps_both_behind_its_command() -> None:
    """`render --light-groups` auto had lost its value."""
    sentence = "render it with `--light-groups auto` (light_groups='auto'), `--seed 3`."
    there = said_by(context_of("render"), sentence)
    elsewhere = said_by(context_of("expose"), sentence)
    assert there == sentence
    assert elsewhere == sentence.replace("`--light", "`render --light")


def test_no_sentence_names_an_option_and_a_word_as_its_value_outside_of_backticks() -> None:
    """The words that options take: choices, and NAME=VALUE."""
    words = {"auto", "path", "scalar_spectral", "float64", "numpy", "electrons"}
    wrong = {}
    for text, where in sentences().items():
        for option, value in re.findall(r"(--[a-z-]+) ([\w=*,]+)", CODE.sub("", text)):
            takes_a_word = value in words or "=*" in value or "=lamp" in value
            if takes_a_word and not text.startswith("--"):
                wrong[where] = f"{option} {value}"
    assert not wrong, wrong


@pytest.mark.parametrize("name", one_in(3, COMMANDS))
def test_every_command_names_its_own_options_only(name: str) -> None:
    """Whatever sentence of the package it says."""
    context = context_of(name)
    for sentence in sentences():
        said = said_by(context, sentence)
        assert named(said) <= options_of(COMMANDS[name]), said
        assert said_by(context, said) == said


@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_options_of_the_command(name: str) -> None:
    command = COMMANDS[name]
    texts = [command.help or "", *(getattr(one, "help", None) or "" for one in command.params)]
    for text in texts:
        assert named(text) <= options_of(command), text


@pytest.mark.parametrize("name", COMMANDS)
def test_an_example_is_a_command_with_its_options(name: str) -> None:
    example = COMMANDS[name].epilog or ""
    typed = re.match(rf"Example: mitsuba-sensor {name} ([^;]*)", example)
    assert typed or not example
    assert not typed or set(re.findall(r"--[a-z-]+", typed[1])) <= options_of(COMMANDS[name])


def test_an_option_of_another_command_is_named_with_it() -> None:
    context = context_of("expose")
    assert said_by(context, "take more samples (--spp)") == "take more samples (`render --spp`)"
    assert said_by(context, "--spp 64 would do") == "`render --spp 64` would do"
    assert said_by(context, "--exposure-s 0.1 is metered") == "--exposure-s 0.1 is metered"
    assert said_by(context, "see `render --aovs`") == "see `render --aovs`"
    assert said_by(context_of("render"), "more (--spp)") == "more (--spp)"


def test_notes_on_light_name_the_command_that_renders_it(
    cli: Callable[..., Any], light_file: Path, tmp_path: Path
) -> None:
    said = cli("expose", light_file, "-o", tmp_path, "--exposure-s", 10).stdout
    notes = [line for line in said.splitlines() if line.startswith("note")]
    assert notes and "(--spp)" not in said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--noise-ratio", "-1"), "--noise-ratio is -1"),
        (("--spp", "3", "--noise-ratio", "0.1"), "--spp is 3 and --noise-ratio 0.1"),
        (("--wavelength-nm", "0"), "--wavelength-nm is 0"),
    ],
)
def test_an_error_names_the_flag_and_not_the_argument_of_python(
    given: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    done = CliRunner().invoke(app, ["render", "cornell_box", "-o", str(tmp_path), *given])
    assert done.exit_code == 2 and f"error: {said}" in " ".join(done.output.split())
