"""The descriptor of EMVA 1288: a text file that lists the images of a measurement with exposure times and photons.

Lines begin with a letter: ``n bits width height``; ``b exposure photons`` and ``d exposure`` begin the images of a flat
field and of darkness, exposure in nanoseconds; ``i file`` names one image of it, relative to the descriptor, with
slashes of either kind. What follows a ``#`` is a comment.
"""

from __future__ import annotations

from pathlib import Path

from ...core import InputError
from ...core.errors import shown
from ...files.texts import Facts, text_of_file
from .manifest import Group

REMEDY = "give a folder of raw frames, a bench.toml or a descriptor of EMVA 1288"
SECONDS_PER_NS = 1e-9
ARGUMENTS = {"v": 1, "n": 3, "b": 2, "d": 1, "i": 1}
"""Numbers of arguments behind each letter."""


def read_descriptor(path: Path) -> tuple[Facts, list[Group]]:
    """What a descriptor says of all images, and the images of each stack. Raises InputError with file and line."""
    lines = text_of_file(path, REMEDY).splitlines()
    facts: Facts = {}
    stacks: list[Group] = []
    for number, line in enumerate(lines, start=1):
        letter, *arguments = line.split("#")[0].split(maxsplit=1) or [""]
        if not letter:
            continue
        where = f"{path}, line {number}"
        values = _arguments(where, letter, "".join(arguments))
        if letter == "n":
            facts["bits"] = int(_number(where, values[0]))
        elif letter in ("b", "d"):
            stacks.append(_stack(where, letter, values))
        elif letter == "i":
            if not stacks:
                raise InputError(f"{where}: the first image is before a line b or d.")
            stacks[-1].files.append(_image(where, path, values[0]))
    stacks = [stack for stack in stacks if stack.files]
    if not stacks:
        raise InputError(
            f"{path} is no descriptor of EMVA 1288: no line b or d with images (i file); give a folder, a bench.toml "
            "or a descriptor."
        )
    return {**facts, "stack": [stack.settings for stack in stacks]}, stacks


def _arguments(where: str, letter: str, text: str) -> list[str]:
    """The arguments of a line; the name of an image may have spaces."""
    if letter not in ARGUMENTS:
        letters = ", ".join(ARGUMENTS)
        raise InputError(f"{where} begins with {shown(letter)}; a line begins with {letters}.")
    values = text.split()
    if letter == "i":
        values = [text.strip()]
    if len(values) != ARGUMENTS[letter] or not all(values):
        raise InputError(
            f"{where}: {letter} has {len(values)} arguments; it must have {ARGUMENTS[letter]}."
        )
    return values


def _number(where: str, text: str) -> float:
    """A number of at least 0, with a point or a comma."""
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise InputError(f"{where}: {shown(text)} must be a number of at least 0.")
    return value


def _stack(where: str, letter: str, values: list[str]) -> Group:
    """An empty stack of a flat field or of darkness."""
    settings: Facts = {"exposure_s": SECONDS_PER_NS * _number(where, values[0])}
    if letter == "d":
        return Group(where, [], "dark", settings)
    settings["photons"] = _number(where, values[1])
    return Group(where, [], "flat", settings)


def _image(where: str, descriptor: Path, name: str) -> Path:
    """The file of an image, which must be there."""
    file = descriptor.parent / name.replace("\\", "/")
    if not file.is_file():
        raise InputError(f"{where}: there is no {file}; correct the name, or add the image.")
    return file
