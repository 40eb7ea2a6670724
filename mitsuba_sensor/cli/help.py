"""Help of one screen and the whole of it, and what a wrong call of a command is told."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar, TypeAlias

import typer
from rich.markup import escape
from typer.core import TyperCommand, TyperGroup

from .lines import lines_while_working

Click: TypeAlias = (
    Any  # contexts, parameters and formatters of click, which new versions of typer bring along
)
UsageError: Any = typer.BadParameter.__base__
ALWAYS_SHOWN = ("help", "help_all")


class Group(TyperGroup):
    """Commands below a name; the name alone shows its help."""

    def parse_args(self, ctx: Click, args: list[str]) -> list[str]:
        """Exit code 2 if no command is given, because nothing was done."""
        if not args and self.no_args_is_help and not ctx.resilient_parsing:
            if text := ctx.get_help():  # rich prints it itself
                typer.echo(text)
            raise typer.Exit(2)
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Click) -> list[Click]:
        """Its options; a switch is shown without a value."""
        return _with_bare_switches(super().get_params(ctx))


class Command(TyperCommand):
    """A command whose help shows the options that are used first, if ``flags(first=…)`` names them."""

    running: ClassVar[Click | None] = None  # the context of the one that was called last

    def __init__(self, name: str | None, **settings: Click) -> None:
        super().__init__(name, **settings)
        paragraphs = (self.help or "").split("\n\n")
        self.help = escape("\n\n".join(" ".join(one.split()) for one in paragraphs))

    def get_params(self, ctx: Click) -> list[Click]:
        """Its arguments and options; a switch is shown without a value."""
        return _with_bare_switches(super().get_params(ctx))

    def invoke(self, ctx: Click) -> object:
        """Run it; on the way it says how far it is."""
        Command.running = ctx
        with lines_while_working(sys.stderr.isatty()):
            return super().invoke(ctx)

    def format_help(self, ctx: Click, formatter: Click) -> None:
        """The first options, and how many more there are; all of them if no first ones are named."""
        first: Sequence[str] = getattr(self.callback, "first", ())
        if not first:
            return super().format_help(ctx, formatter)
        options = [one for one in self.get_params(ctx) if one.param_type_name == "option"]
        others = [one for one in options if one.name not in (*first, *ALWAYS_SHOWN)]
        shorter = _changed(options, {"rich_help_panel": lambda one: None, "help": _in_short})
        with shorter, _changed(others, {"hidden": lambda one: True}):
            super().format_help(ctx, formatter)
        typer.echo(
            f" {len(others)} more options, and more on these: {ctx.command_path} --help-all"
        )


def show_all(ctx: typer.Context, asked: bool) -> None:
    """Show every option, as ``--help-all`` does."""
    if asked and not ctx.resilient_parsing:
        command: Click = ctx.command
        TyperCommand.format_help(command, ctx, ctx.make_formatter())
        raise typer.Exit


def flags_typed() -> dict[str, str]:
    """The arguments of the running command that were typed: name in Python → flag, as noise_ratio → --noise-ratio."""
    context = Command.running
    flags = {}
    for one in context.command.params if context else ():
        long = next((flag for flag in one.opts if flag.startswith("--")), "")
        source = context.get_parameter_source(one.name) if context else None
        if long and source is not None and source.name == "COMMANDLINE":
            flags[str(one.name)] = long
    return flags


def commands_below(group: Click, names: str = "") -> Iterator[tuple[str, Click]]:
    """Each command with the names that call it, in the order of use."""
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "list_commands"):
            yield from commands_below(command, f"{names}{name} ")
        else:
            yield f"{names}{name}", command


def _with_bare_switches(params: list[Click]) -> list[Click]:
    for one in params:
        if getattr(one, "is_flag", False):
            one.metavar = ""
    return params


def _in_short(option: Click) -> str:
    """The first clause of an option's help."""
    return re.split(r"\.(?: |$)|; ", option.help or "")[0]


@contextmanager
def _changed(
    params: list[Click], changes: dict[str, Callable[[Click], object]]
) -> Iterator[None]:
    """While the block runs, these attributes are what the functions make of each parameter."""
    before = [{name: getattr(one, name) for name in changes} for one in params]
    for one in params:
        for name, changed in changes.items():
            setattr(one, name, changed(one))
    try:
        yield
    finally:
        for one, values in zip(params, before, strict=True):
            for name, value in values.items():
                setattr(one, name, value)
