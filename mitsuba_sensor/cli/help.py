"""What a command says of itself: help of one screen and the whole of it, switches, and what was typed wrongly."""

from __future__ import annotations

import itertools
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar, TypeAlias

import typer
from rich.markup import escape
from typer.core import TyperCommand, TyperGroup

from ..core.number_text import number_hint
from .lines import lines_while_working

Click: TypeAlias = (
    Any  # contexts, parameters and formatters of click, which new versions of typer bring along
)
UsageError: Any = typer.BadParameter.__base__
EXAMPLES = {
    "DIR": ", e.g. -o out/",
    "FILE.toml": ", e.g. my.toml",
    "FILE.npz": ", e.g. -o maps.npz",
    "SCENE": ", e.g. scenes/first_frame.xml",
}
"""Metavar of what is missing → an example of it."""
TRUTHS = ("true", "false")
"""What people write behind a switch, and no file is called."""


class Group(TyperGroup):
    """Commands below a name; the name alone shows its help."""

    def parse_args(self, ctx: Click, args: list[str]) -> list[str]:
        """Exit code 2 where no command is given, because nothing was done."""
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

    def parse_args(self, ctx: Click, args: list[str]) -> list[str]:
        """The arguments that are left. Says of a value behind a switch what to write."""
        typed = list(args)
        switches = {
            name: option
            for option in self.get_params(ctx)
            if getattr(option, "is_flag", False)
            for name in (*option.opts, *option.secondary_opts)
        }
        for name, value in _valued_switches(typed, switches):
            if value.lower() in TRUTHS:
                raise UsageError(_about_switch(switches[name], name, value), ctx)
        try:
            return super().parse_args(ctx, args)
        except UsageError as error:
            said = str(error.format_message())
            for name, value in _valued_switches(typed, switches):
                if "unexpected extra argument" in said or "does not take a value" in said:
                    raise UsageError(_about_switch(switches[name], name, value), ctx) from None
            if hint := self._what_to_write(said, typed, ctx):
                raise UsageError(f"{said.rstrip('.')}; {hint}", ctx) from None
            raise

    def _what_to_write(self, said: str, typed: Sequence[str], ctx: Click) -> str:
        """Behind click's sentence on arguments that do not fit: what to write; empty where that is not known."""
        for one in self.get_params(ctx):
            names = (f"'{one.metavar}'", f"'{one.opts[0]}'")
            if said.startswith("Missing") and any(x in said for x in names) and one.help:
                short, example = _in_short(one), EXAMPLES.get(one.metavar, "")
                if "-o" in example and "-o" not in one.opts:
                    example = ""
                return f"{short[0].lower()}{short[1:]}{example}"
        extra = re.search(r"extra argument(?:\(s\)|s)? \(([^\s)]+)", said)
        if extra is None or extra[1] not in typed:
            return ""
        before = typed[: typed.index(extra[1])]
        if len(before) > 1 and before[-2] == "--set" and "=" not in before[-1]:
            return f"write --set {before[-1]}={extra[1]}"
        if len(before) > 1 and before[-2].startswith("-"):
            value = f"{before[-1]} {extra[1]}"
            meant = number_hint(before[-2], value) or "write a value with blanks in quotes"
            return f"the value of {before[-2]} ends at the blank; {meant}"
        return ""

    def invoke(self, ctx: Click) -> object:
        """Run it; on the way it says how far it is."""
        Command.running = ctx
        with lines_while_working(sys.stderr.isatty()):
            return super().invoke(ctx)

    def format_help(self, ctx: Click, formatter: Click) -> None:
        """The first options, and how many more there are; all of them where no first ones are named."""
        first: Sequence[str] = getattr(self.callback, "first", ())
        if not first:
            return super().format_help(ctx, formatter)
        options = [one for one in self.get_params(ctx) if one.param_type_name == "option"]
        others = [one for one in options if one.name not in (*first, *ALWAYS)]
        shorter = _set_aside(options, {"rich_help_panel": lambda one: None, "help": _in_short})
        with shorter, _set_aside(others, {"hidden": lambda one: True}):
            super().format_help(ctx, formatter)
        typer.echo(
            f" {len(others)} more options, and more on these: {ctx.command_path} --help-all"
        )


def show_all(ctx: typer.Context, asked: bool) -> None:
    """Of ``--help-all``: every option."""
    if asked and not ctx.resilient_parsing:
        command: Click = ctx.command
        TyperCommand.format_help(command, ctx, ctx.make_formatter())
        raise typer.Exit


ALWAYS = ("help", "help_all")
"""Options that every help shows."""


def _with_bare_switches(params: list[Click]) -> list[Click]:
    for one in params:
        if getattr(one, "is_flag", False):
            one.metavar = ""
    return params


def _valued_switches(
    typed: Sequence[str], switches: dict[str, Click]
) -> Iterator[tuple[str, str]]:
    """Each switch that a argument without a dash follows, or that has a value behind a =."""
    for argument, behind in itertools.pairwise([*typed, "-"]):
        name, equals, value = argument.partition("=")
        if argument == "--":
            return
        if name in switches and (equals or not behind.startswith("-")):
            yield name, value if equals else behind


def _about_switch(option: Click, name: str, value: str) -> str:
    """What to write in place of a switch with a value."""
    if option.secondary_opts:
        ways = f"write {option.opts[0]} or {option.secondary_opts[0]} alone"
    else:
        ways = f"{name} alone switches it on, and without it it is off"
    return f"{name} is a switch and takes no value ({value!r}); {ways}"


def _in_short(option: Click) -> str:
    """What an option is, without what else is to be known of it."""
    return re.split(r"\.(?: |$)|; ", option.help or "")[0]


@contextmanager
def _set_aside(
    params: list[Click], changes: dict[str, Callable[[Click], object]]
) -> Iterator[None]:
    """While the block runs, these attributes are what the functions make of each."""
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
