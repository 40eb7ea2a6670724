"""Sentences of the package as a command says them: an option that the command does not have is named with one that has.

A note on noisy light says "take more samples (--spp)". ``render`` has that option; ``expose`` says "(`render --spp`)".
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from .help import Click, Command

OPTION = re.compile(r"(?<![\w-])(--[a-z][a-z-]*)((?:[ =]\d+(?:\.\d+)?(?:e[+-]?\d+)?)?)")
ARGUMENT = re.compile(r"(?:^|(?<= and ))[a-z]+(?:_[a-z]+)*(?= (?:is|has) | [\d.'-]+[;,])")
"""Name of an argument, where a sentence about its value begins."""

CODE = re.compile(r"`[^`]*`|mitsuba-sensor .*")
"""Whole commands in a sentence, which stay as they are."""


def said_here(sentence: str) -> str:
    """The sentence as the running command says it; as it is where none runs."""
    running = Command.running
    if running is None:
        return sentence
    return said_by(running, sentence)


def said_by(context: Click, sentence: str) -> str:
    """The sentence with each option that the command lacks as ``COMMAND --option``; others as they are.

    context : in which the command runs.
    """
    own = options_of(context.command)

    def named(match: re.Match[str]) -> str:
        if match[1] in own:
            return match[0]
        program = context.find_root().command
        owners = (name for name, one in commands_below(program) if match[1] in options_of(one))
        owner = next(owners, None)
        if owner is None:
            return match[0]
        return f"`{owner} {match[0]}`"

    def with_owner(code: str) -> str:
        """An option with its value in backticks, behind the command that has it."""
        option = OPTION.match(code, 1)
        if option is None:
            return code
        called = named(option)
        if not called.startswith("`"):
            return code
        return called[:-1] + code[option.end() :]

    kept, at = [], 0
    for code in CODE.finditer(sentence):
        kept += [OPTION.sub(named, sentence[at : code.start()]), with_owner(code.group())]
        at = code.end()
    return "".join([*kept, OPTION.sub(named, sentence[at:])])


def with_flags(sentence: str) -> str:
    """An error of a function as the running command says it: "noise_ratio is -1" as "--noise-ratio is -1", where the
    command was given that flag; a scene file has fields of the same names."""
    running = Command.running
    if running is None:
        return said_here(sentence)
    flags = dict[str, str]()
    for one in running.command.params:
        long = [flag for flag in one.opts if flag.startswith("--")]
        source = running.get_parameter_source(str(one.name))
        if long and source is not None and source.name == "COMMANDLINE":
            flags[str(one.name)] = long[0]
    return said_here(ARGUMENT.sub(lambda match: flags.get(match[0], match[0]), sentence))


def options_of(command: Click) -> set[str]:
    """Every way to write one of its options."""
    names: set[str] = set()
    for one in command.params:
        names |= {*one.opts, *one.secondary_opts}
    return names


def commands_below(group: Click, names: str = "") -> Iterator[tuple[str, Click]]:
    """Each command with the names that call it, in the order of use."""
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "list_commands"):
            yield from commands_below(command, f"{names}{name} ")
        else:
            yield f"{names}{name}", command
