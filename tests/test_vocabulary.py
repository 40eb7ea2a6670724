"""The vocabulary of the field: words that must not come back, and first lines that say what a module computes."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer.main
from helpers import ROOT

from mitsuba_sensor.cli import app


class Word(NamedTuple):
    """A word that is not used in this project, what to use instead, and where the word has another meaning.

    pattern : compared with lower-case text; names like ``snake_case`` and ``CamelCase`` count as several words.
    allowed : a line that matches this pattern is not counted.
    """

    pattern: str
    instead: str
    allowed: str = ""


WORDS = (
    # names of this project's past, for which the field has a term
    Word(r"lanes?", "backend"),
    Word(r"ledgers?", "noise budget"),
    Word(r"accounts?", "noise budget, report"),
    Word(r"one pass share", "firefly fraction"),
    Word(r"yardsticks?", "stop criterion, reference"),
    Word(r"wish(es)?", "render options"),
    Word(r"brimming|flooded", "saturated"),
    Word(r"pedestals?", "black level"),
    Word(r"blinking|blinks?", "RTS (random telegraph signal)"),
    Word(
        r"spend(s|ing|able)?|(un)?spent|unspendable",
        "use, take (time)",
    ),
    Word(r"shoot(s|ing)?", "render a frame"),
    Word(
        r"devices?",
        "sensor window; chip, serial",
        allowed=r"GPU|CUDA|cuda|oidn\.Device|=device-width",
    ),
    Word(r"rooms?", "domain (photons, electrons, volts, DN)", allowed=r"room temperature"),
    Word(r"words?", "random bits; options, arguments; text, label"),
    Word(
        r"truth", "AOVs; reference", allowed=r"include_truth=False|state_groundtruth_estimate0"
    ),  # the keyword of getframes
    Word(
        r"(column|row|pixel) offsets?",
        "DSNU_col, DSNU_row, DSNU_pixel in names",
        allowed=r"(column|row|pixel) off",
    ),
    Word(r"column gains?", "PRNU_col in names", allowed=r"column gain"),
    Word(r"light electrons?", "photoelectrons"),
    Word(r"dark laws?", "dark-current model"),
    Word(r"dark patterns?", "dark-current FPN"),
    Word(r"dark parts?", "dark-current component"),
    Word(r"bent|bends", "distorted; non-linear"),
    Word(r"alive", "unvignetted"),
    Word(r"brims?", "full well"),
    # metaphors
    Word(r"doors?", "interface, entry point, module"),
    Word(r"walks?|walked|walking", "chain, propagation"),
    Word(r"judges?|judged|judging", "check, compare, reference"),
    Word(r"promises?|promised", "limit, guarantee"),
    Word(r"houses?", "package, architecture"),
    Word(r"(the|an|its) eye", "preview"),
    Word(r"guests?", "user"),
)

ANY_WORD = re.compile("|".join(rf"\b(?:{word.pattern})\b" for word in WORDS))

SCANNED = (
    "CHANGELOG.md",
    "README.md",
    "docs",
    "benchmarks",
    "reproduction",
    "examples",
    "mitsuba_sensor",
    "pyproject.toml",
)

RETIRED_OPTIONS = {
    "--columns": "--width",
    "--again": "--force",
    "--patterns": "--fpn-maps",
    "--ground-truth": "--aovs",
    "--noise-budget": "--render-noise",
}
SUFFIXES = (".py", ".md", ".toml", ".xml")


def files_of(name: str) -> list[Path]:
    """The file of this name, or the files below the folder of this name."""
    path = ROOT / name
    return (
        [path]
        if path.is_file()
        else [file for file in sorted(path.rglob("*")) if file.suffix in SUFFIXES]
    )


def faults(text: str, name: str) -> list[str]:
    """What a text says that it must not, as "name:line: 'word': use …"."""
    found = []
    separate = re.sub(r"[_-]+", " ", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", text)).lower()
    lines = zip(text.splitlines(), separate.splitlines(), strict=True)
    for number, (line, apart) in enumerate(lines, 1):
        if not ANY_WORD.search(apart):
            continue
        for word in WORDS:
            match = re.search(rf"\b({word.pattern})\b", apart)
            if match and not (word.allowed and re.search(word.allowed, line)):
                found.append(f"{name}:{number}: {match.group()!r}: use {word.instead}")
    return found


def faults_of_first_line(path: Path) -> list[str]:
    """What is wrong with the first line of a module, which must be one sentence."""
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    first, name = docstring.partition("\n")[0], str(path.relative_to(ROOT))
    if not re.fullmatch(r"([A-Z`(µσ0-9]|[a-z(), -]+: ).{12,}[^.]\.", first) or re.search(
        r"[a-z)]\. [A-Z]", first
    ):
        return [
            f"{name}: the first line must be one sentence that says what the module computes: {first!r}"
        ]
    return faults(first, name)


@pytest.mark.parametrize("name", SCANNED)
def test_no_word_of_the_table_is_used(name: str) -> None:
    assert files_of(name)
    found = [
        fault
        for path in files_of(name)
        for fault in faults(path.read_text("utf-8"), str(path.relative_to(ROOT)))
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", ["benchmarks", "examples", "mitsuba_sensor"])
def test_the_first_line_of_every_module_says_what_it_computes(name: str) -> None:
    modules = [path for path in files_of(name) if path.suffix == ".py"]
    found = [fault for path in modules for fault in faults_of_first_line(path)]
    assert modules and not found, "\n".join(found)


def helps(command: Any, name: str = "mitsuba-sensor") -> dict[str, str]:
    """What the help of a command and of all commands below it says, by name; options with their names."""
    options = [
        " ".join((*option.opts, str(getattr(option, "help", "") or "")))
        for option in command.params
    ]
    found = {name: "\n".join((name, command.help or "", command.epilog or "", *options))}
    if hasattr(command, "list_commands"):
        for inner_name in command.list_commands(None):
            found |= helps(command.get_command(None, inner_name), f"{name} {inner_name}")
    return found


def test_the_help_of_the_command_line_uses_no_word_of_the_table() -> None:
    texts = helps(typer.main.get_command(app))
    found = [fault for name, text in texts.items() for fault in faults(text, name)]
    for name, text in texts.items():
        found += [
            f"{name}: {old}: use {new}"
            for old, new in RETIRED_OPTIONS.items()
            if re.search(rf"{old}\b", text)
        ]
    assert len(texts) > 8 and not found, "\n".join(found)


def test_a_word_is_found_in_names_and_in_prose_but_not_inside_others() -> None:
    assert (
        len(
            faults(
                "class RowOffset: self.column_offset_v = 1\nlanes = 2  # the pedestal", "x.py"
            )
        )
        == 3
    )
    assert not faults("keyword planes doorway reword an eyepiece", "x.py")
    assert not faults("memory of the device on CUDA", "x.py")
