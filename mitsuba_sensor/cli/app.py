"""The app that the commands belong to: what errors become, and output on the terminal.

The module of a command is loaded when the command is called: a shell completes, and the commands are listed, at once.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from importlib import import_module
from typing import Annotated, Any, NamedTuple

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.protocol import is_renderable
from rich.segment import Segment
from rich.text import Text

from .. import __version__, stopping
from ..core.printable import printable
from .flag_names import with_flags
from .help import Click, Command, Group, UsageError


class PrintableConsole(Console):
    """A console whose styles are our own: control characters in the texts themselves are escaped."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Pieces of text with a style; those of a progress bar that move the cursor stay as they are."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text, keep="\n"), style, control)


out, err = PrintableConsole(), PrintableConsole(stderr=True)


class Listed(NamedTuple):
    """A command as ``--help`` lists it.  module : of this package, which adds the command to the app."""

    module: str
    panel: str
    summary: str


PICTURES, THINGS, CHECKS = (
    "From a scene to frames",
    "Cameras and scenes",
    "How good, and whether it works",
)
COMMANDS = {
    "render": Listed("commands", PICTURES, "Render a scene and expose a camera to it."),
    "expose": Listed(
        "commands", PICTURES, "Expose a camera to light that is rendered already."
    ),
    "budget": Listed("budget", PICTURES, "How much noise each source of a camera adds."),
    "plan": Listed("commands", PICTURES, "Which noise sources matter here, and which do not."),
    "cameras": Listed("catalogue", THINGS, "Cameras by name, and camera files of your own."),
    "scenes": Listed("scenes", THINGS, "Scenes by name, and copies of them to change."),
    "fpn-maps": Listed("commands", THINGS, "Write the fixed-pattern noise maps of one camera."),
    "lint": Listed("commands", THINGS, "Say what in a scene is black or wrong for a camera."),
    "dataset": Listed("datasets", THINGS, "Raw frames by the thousand, from one TOML file."),
    "characterize": Listed("laboratory", CHECKS, "Measure a camera as EMVA 1288 does."),
    "sheet": Listed(
        "sheets", CHECKS, "Charts in front of a camera, every figure beside theory."
    ),
    "fit": Listed("twins", CHECKS, "Fit a camera file to bias, dark and flat frames."),
    "study": Listed("studies", CHECKS, "Error against run time, and what can be left out."),
    "doctor": Listed("commands", CHECKS, "Find out what works on this machine."),
}
"""In the order of use."""


class Program(Group):
    """Runs a command: what a user did wrong becomes one sentence on stderr and exit code 2 (a full disk: 3)."""

    only_names = False

    def list_commands(self, ctx: Click) -> list[str]:
        """Those of COMMANDS."""
        return list(COMMANDS)

    def get_command(self, ctx: Click, cmd_name: str) -> Click:
        """The command with all its options, or, where commands are only listed, its name and summary."""
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
        """The commands by name and summary."""
        self.only_names = True
        super().format_help(ctx, formatter)
        self.only_names = False

    def shell_complete(self, ctx: Click, incomplete: str) -> Click:
        """Names of commands and of the program's own options."""
        self.only_names = True
        proposals = super().shell_complete(ctx, incomplete)
        self.only_names = False
        return proposals

    def make_context(self, *given: Click, **more: Click) -> Click:
        """The program's own options are read here."""
        try:
            return super().make_context(*given, **more)
        except UsageError as error:
            _say(error, False)
            raise typer.Exit(2) from None

    def invoke(self, ctx: Click) -> object:
        """Run the command that was called; errors end here."""
        from ..core import DiskFull, InputError, SensorWarning
        from ..render.variants import variant_restored

        stopping.begin_command()
        as_json = "--json" in (*ctx._protected_args, *ctx.args)
        try:
            with warnings.catch_warnings(), variant_restored():
                warnings.simplefilter("ignore", SensorWarning)  # the notes are printed
                return super().invoke(ctx)
        except DiskFull as error:
            _say(error, as_json)
            raise typer.Exit(3) from None
        except (InputError, OSError, MemoryError, UsageError) as error:
            _say(error, as_json)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:  # where no signals can be waited for (Windows)
            err.print(stopping.sentence(), markup=False, highlight=False, soft_wrap=True)
            raise typer.Exit(130) from None


def _say(error: Exception, as_json: bool) -> None:
    """One sentence on stderr; for programs that read JSON also {"error": sentence} on stdout."""
    with stopping.whole_step:  # not if a stop has removed what this thread misses now
        said = with_flags(_sentence(error))
        err.print(f"[bold red]error:[/] {escape(said)}", highlight=False, soft_wrap=True)
        if as_json:
            show({"error": said}, True)


app = typer.Typer(
    cls=Program,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},  # of all commands
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="From a 3D scene to the raw frames of a camera, with the noise of every physical source.\n\n"
    "Start here: [bold]mitsuba-sensor render first_frame -o out/[/]",
)


def _show_version(asked: bool) -> None:
    if asked:
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
    """What is asked of the program itself."""


def show(found: object, as_json: bool, shown: object = None) -> None:
    """Print JSON whole and plain; for people ``shown``, or lines and tables of the same."""
    if as_json:
        from ..files.texts import to_json

        typer.echo(to_json(found))
        return
    what = found if shown is None else shown
    if isinstance(what, str):
        typer.echo(printable(what, keep="\n\t"))
    else:
        from .tables import view

        what = what if is_renderable(what) else view(what)
        out.print(what, highlight=False, crop=False)


def show_remarks(as_json: bool, remarks: Iterable[str]) -> None:
    """Lines below a result, which JSON does not have."""
    for remark in () if as_json else remarks:
        out.print(Text(with_flags(remark)), highlight=False)


def _sentence(error: BaseException) -> str:
    if isinstance(error, UsageError):
        usage: Any = error
        path = " ".join(
            ["mitsuba-sensor", *(usage.ctx.command_path.split()[1:] if usage.ctx else ())]
        )
        return f"{usage.format_message().rstrip('.')}; see: {path} -h"
    if isinstance(error, MemoryError):
        return f"not enough memory ({error}); render a smaller picture (--width), fewer bands or fewer frames."
    if isinstance(error, OSError):
        return f"{error.filename or 'the system'}: {error.strerror or error}."
    return str(error)
