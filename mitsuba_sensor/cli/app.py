"""The app that the commands belong to: help, errors, and output on the terminal.

A command's module is loaded when the command is called, so completion and the list of commands appear at once.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterable, Iterator
from copy import copy
from importlib import import_module
from typing import Annotated, Any, NamedTuple, TypeAlias

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.protocol import is_renderable
from rich.segment import Segment
from rich.text import Text
from typer.core import TyperCommand, TyperGroup

from .. import __version__, stopping
from ..core.printable import printable
from .flag_names import with_flags

Click: TypeAlias = Any
"""Contexts, parameters and formatters of click, which new versions of typer include."""
UsageError: Any = typer.BadParameter.__base__
SHORT_HELP = "mitsuba_sensor.first"
"""Key in the notes of a context: the names of the options that short help shows."""
DEFAULT = re.compile(r"Default: (from the scene or render, else )?(\w+(?:\.\d+)?)(?:[.;]| \()")
"""A default of one word, also with where it is looked for first, which short help keeps."""


class PrintableConsole(Console):
    """A console that escapes the control characters of texts; only our own styles reach the terminal."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield segments; a progress bar's control segments, which move the cursor, stay unchanged."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text, keep="\n"), style, control)


out, err = PrintableConsole(), PrintableConsole(stderr=True)


class Listed(NamedTuple):
    """A command as ``--help`` lists it.  module : of this package, which adds the command to the app."""

    module: str
    panel: str
    summary: str


PICTURES, THINGS, CHECKS = "From a scene to frames", "Cameras and scenes", "Quality and checks"
COMMANDS = {
    "render": Listed("commands", PICTURES, "Render a scene and expose a camera to it."),
    "expose": Listed("commands", PICTURES, "Expose a camera to light from an earlier render."),
    "budget": Listed("budget", PICTURES, "Show the noise from each source, or the SNR curve."),
    "plan": Listed("commands", PICTURES, "Show which sensor stages matter for this light."),
    "cameras": Listed("catalogue", THINGS, "List, show, write and check camera files."),
    "scenes": Listed("catalogue", THINGS, "List, show and copy the included scenes."),
    "fpn-maps": Listed("commands", THINGS, "Write a camera's fixed-pattern noise maps."),
    "lint": Listed(
        "commands", THINGS, "Find parts of a scene that this camera would see black or wrong."
    ),
    "dataset": Listed("datasets", THINGS, "Make thousands of raw frames from one TOML file."),
    "characterize": Listed("laboratory", CHECKS, "Measure a camera as EMVA 1288 requires."),
    "sheet": Listed(
        "sheets", CHECKS, "Measure image quality with test charts, next to theory."
    ),
    "fit": Listed("laboratory", CHECKS, "Fit a camera file to bias, dark and flat frames."),
    "study": Listed("studies", CHECKS, "Compare error and run time; find what can be omitted."),
    "doctor": Listed("commands", CHECKS, "Find out what works on this machine."),
}
"""In the order of use."""


class Group(TyperGroup):
    """Commands under one name; the name alone shows its help."""

    def parse_args(self, ctx: Click, args: list[str]) -> list[str]:
        """Exit with code 2 if no command is given, because nothing was done."""
        if not args and self.no_args_is_help and not ctx.resilient_parsing:
            if text := ctx.get_help():  # rich prints it itself
                typer.echo(text)
            raise typer.Exit(2)
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Click) -> list[Click]:
        """Return the options; a switch is shown without a value."""
        return _with_bare_switches(super().get_params(ctx))


class Command(TyperCommand):
    """A command whose help first shows the options that ``flags(first=…)`` names."""

    def __init__(self, name: str | None, **settings: Click) -> None:
        super().__init__(name, **settings)
        paragraphs = (self.help or "").split("\n\n")
        self.help = escape("\n\n".join(" ".join(one.split()) for one in paragraphs))

    def get_params(self, ctx: Click) -> list[Click]:
        """Return arguments and options; short help shows only the first options, each with its first clause."""
        params = _with_bare_switches(super().get_params(ctx))
        if not ctx.meta.get(SHORT_HELP):
            return params
        params = [copy(param) for param in params]
        for param in params:
            if param.param_type_name == "option":
                param.hidden = param.name not in (*ctx.meta[SHORT_HELP], "help", "help_all")
                default = DEFAULT.search(param.help or "")
                param.help = re.split(r"(?<!e\.g)\. |[;:] |\.$", param.help or "")[0]
                if default:
                    unless = ", or the scene's" if default[1] else ""
                    param.help += escape(f" [default: {default[2]}{unless}]")
                param.rich_help_panel = None
        return params

    def invoke(self, ctx: Click) -> object:
        """Run the command and report its progress."""
        from .progress import lines_while_working

        with lines_while_working(sys.stderr.isatty()):
            return super().invoke(ctx)

    def format_help(self, ctx: Click, formatter: Click) -> None:
        """Show the first options and the number of the others; all options if none are named first."""
        ctx.meta[SHORT_HELP] = getattr(self.callback, "first", ())
        super().format_help(ctx, formatter)
        if ctx.meta[SHORT_HELP]:
            more = sum(getattr(param, "hidden", False) for param in self.get_params(ctx))
            typer.echo(f" {more} more options and details: {ctx.command_path} --help-all")


def show_all(ctx: typer.Context, is_given: bool) -> None:
    """Show every option for ``--help-all``."""
    if is_given and not ctx.resilient_parsing:
        command: Click = ctx.command
        TyperCommand.format_help(command, ctx, ctx.make_formatter())
        raise typer.Exit


def commands_below(group: Click, names: str = "") -> Iterator[tuple[str, Click]]:
    """Yield each command with the names that call it, in the order of use."""
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "list_commands"):
            yield from commands_below(command, f"{names}{name} ")
        else:
            yield f"{names}{name}", command


def _with_bare_switches(params: list[Click]) -> list[Click]:
    for param in params:
        if getattr(param, "is_flag", False):
            param.metavar = ""
    return params


class Program(Group):
    """Runs a command. A user's mistake becomes one sentence on stderr and exit code 2 (a full disk: 3)."""

    only_names = False

    def list_commands(self, ctx: Click) -> list[str]:
        """Return the names of COMMANDS."""
        return list(COMMANDS)

    def get_command(self, ctx: Click, cmd_name: str) -> Click:
        """Return the command with all options, or only its name and summary while commands are listed."""
        listed = COMMANDS.get(cmd_name)
        if self.only_names and listed:
            return Command(cmd_name, help=listed.summary, rich_help_panel=listed.panel)
        if cmd_name in self.commands:
            return self.commands[cmd_name]
        for module in {one.module for one in COMMANDS.values() if listed in (one, None)}:
            import_module(f".{module}", __package__)
        commands: Any = typer.main.get_command(app)
        self.commands.update(commands.commands)
        return self.commands.get(cmd_name)

    def format_help(self, ctx: Click, formatter: Click) -> None:
        """Show the commands by name and summary."""
        self.only_names = True
        super().format_help(ctx, formatter)
        self.only_names = False

    def shell_complete(self, ctx: Click, incomplete: str) -> Click:
        """Propose the commands and the program's own options."""
        self.only_names = True
        proposals = super().shell_complete(ctx, incomplete)
        self.only_names = False
        return proposals

    def make_context(
        self, info_name: str | None, args: list[str], parent: Click = None, **extra: Click
    ) -> Click:
        """Read the program's own options."""
        as_json = "--json" in args
        try:
            return super().make_context(info_name, args, parent, **extra)
        except UsageError as error:
            _tell(error, as_json)
            raise typer.Exit(2) from None

    def invoke(self, ctx: Click) -> object:
        """Run the command that was called and turn errors into sentences."""
        from ..core import DiskFull, InputError, SensorWarning
        from ..render.variants import variant_restored

        stopping.begin_command()
        as_json = "--json" in (*ctx._protected_args, *ctx.args)
        try:
            with warnings.catch_warnings(), variant_restored():
                warnings.simplefilter("ignore", SensorWarning)  # commands print the notes
                return super().invoke(ctx)
        except (InputError, OSError, MemoryError, UsageError) as error:
            _tell(error, as_json)
            raise typer.Exit(3 if isinstance(error, DiskFull) else 2) from None
        except KeyboardInterrupt:  # where signals cannot be waited for (Windows)
            err.print(stopping.sentence(), markup=False, highlight=False, soft_wrap=True)
            raise typer.Exit(130) from None


def _tell(error: Exception, as_json: bool) -> None:
    """Print one sentence on stderr, and with ``--json`` also {"error": sentence} on stdout."""
    with stopping.whole_step:  # silent if a stop has removed what this thread misses now
        sentence = with_flags(_sentence(error))
        err.print(f"[bold red]error:[/] {escape(sentence)}", highlight=False, soft_wrap=True)
        if as_json:
            show({"error": sentence}, True)


def _sentence(error: Exception) -> str:
    if isinstance(error, UsageError):
        usage: Any = error
        names = usage.ctx.command_path.split()[1:] if usage.ctx else ()
        path = " ".join(["mitsuba-sensor", *names])
        return f"{usage.format_message().rstrip('.')}; see: {path} -h"
    if isinstance(error, MemoryError):
        return f"not enough memory ({error}); render a smaller image (--width), fewer bands or fewer frames."
    if isinstance(error, OSError):
        return f"{error.filename or 'the system'}: {error.strerror or error}."
    return str(error)


app = typer.Typer(
    cls=Program,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="Turn a 3D scene into the raw frames of a camera, with the noise of every physical source.\n\n"
    "Start here: [bold]mitsuba-sensor render first_frame -o out/[/]",
)


def _show_version(is_given: bool) -> None:
    if is_given:
        typer.echo(f"mitsuba-sensor {__version__}")
        raise typer.Exit


@app.callback()
def program(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            is_eager=True,
            callback=_show_version,
            help="Show the version and exit.",
        ),
    ] = False,
) -> None:
    """Read the program's own options."""


def show(facts: object, as_json: bool, shown: object = None) -> None:
    """Print facts as plain JSON; for people print ``shown``, else lines and tables of the facts."""
    if as_json:
        from ..files.texts import to_json

        typer.echo(to_json(facts))
        return
    shown = facts if shown is None else shown
    if isinstance(shown, str):
        typer.echo(printable(shown, keep="\n\t"))
    else:
        from .tables import view

        out.print(shown if is_renderable(shown) else view(shown), highlight=False, crop=False)


def show_remarks(as_json: bool, remarks: Iterable[str]) -> None:
    """Print lines below a result; JSON output omits them."""
    for remark in () if as_json else remarks:
        out.print(Text(with_flags(remark)), highlight=False)
