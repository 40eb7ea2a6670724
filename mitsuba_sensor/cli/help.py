"""Help of one screen and the whole of it, and what a wrong call of a command is told."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from copy import copy
from typing import Any, TypeAlias

import typer
from rich.markup import escape
from typer.core import TyperCommand, TyperGroup

Click: TypeAlias = (
    Any  # contexts, parameters and formatters of click, which new versions of typer bring along
)
UsageError: Any = typer.BadParameter.__base__
ALWAYS_SHOWN = ("help", "help_all")
SHORT = "mitsuba_sensor.first"
"""Key of what short help shows first, in the notes of a context."""


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

    def __init__(self, name: str | None, **settings: Click) -> None:
        super().__init__(name, **settings)
        paragraphs = (self.help or "").split("\n\n")
        self.help = escape("\n\n".join(" ".join(one.split()) for one in paragraphs))

    def get_params(self, ctx: Click) -> list[Click]:
        """Its arguments and options; in short help only the first ones are shown, with the first clause of theirs."""
        params = _with_bare_switches(super().get_params(ctx))
        if not ctx.meta.get(SHORT):
            return params
        params = [copy(one) for one in params]
        for one in params:
            if one.param_type_name == "option":
                one.hidden = one.name not in (*ctx.meta[SHORT], *ALWAYS_SHOWN)
                one.help = re.split(r"\.(?: |$)|; ", one.help or "")[0]
                one.rich_help_panel = None
        return params

    def invoke(self, ctx: Click) -> object:
        """Run it; on the way it says how far it is."""
        from .progress import lines_while_working

        with lines_while_working(sys.stderr.isatty()):
            return super().invoke(ctx)

    def format_help(self, ctx: Click, formatter: Click) -> None:
        """The first options in short, and how many more there are; all of them if no first ones are named."""
        ctx.meta[SHORT] = getattr(self.callback, "first", ())
        super().format_help(ctx, formatter)
        if ctx.meta[SHORT]:
            more = sum(getattr(one, "hidden", False) for one in self.get_params(ctx))
            typer.echo(
                f" {more} more options, and more on these: {ctx.command_path} --help-all"
            )


def show_all(ctx: typer.Context, asked: bool) -> None:
    """Show every option, as ``--help-all`` does."""
    if asked and not ctx.resilient_parsing:
        command: Click = ctx.command
        TyperCommand.format_help(command, ctx, ctx.make_formatter())
        raise typer.Exit


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
