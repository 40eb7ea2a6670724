"""The app that the commands belong to: what errors become, camera and exposure from flags, output on the terminal."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Annotated, Any, NamedTuple

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.segment import Segment
from typer.core import TyperGroup

import mitsuba_sensor as ms

from .. import stopping
from ..camera.camera_file import toml_value
from ..core import DiskFull, InputError, SensorWarning, first_given
from ..core.printable import printable
from ..files import texts
from ..files.output_pipe import BROKEN_PIPE, silence_output
from ..render.light.irradiance import RenderedFor
from ..render.scene.scene_settings import ParsedScene, SceneSettings, parse
from ..render.variants import variant_restored
from ..sensor.metering import Metering
from . import options
from .options import Flag, Flags


class PrintableConsole(Console):
    """A console whose styles are our own: control characters in the texts themselves are escaped."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Pieces of text with a style; those of a progress bar that move the cursor stay as they are."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text, keep="\n"), style, control)

    def on_broken_pipe(self) -> None:
        """Nobody reads any more."""
        silence_output()
        raise SystemExit(BROKEN_PIPE)


NO_SCENE = SceneSettings()
out, err = PrintableConsole(), PrintableConsole(stderr=True)


UsageError: Any = (
    typer.BadParameter.__base__
)  # of click, which new versions of typer bring along
PICTURES, THINGS, CHECKS = (
    "From a scene to frames",
    "Cameras and scenes",
    "How good, and whether it works",
)
COMMANDS = (
    "render",
    "expose",
    "plan",
    "cameras",
    "fpn-maps",
    "lint",
    "dataset",
    "characterize",
    "fit",
    "study",
    "doctor",
)  # as --help lists them


class CommandGroup(TyperGroup):
    """Runs a command: what a user did wrong becomes one sentence on stderr and exit code 2 (a full disk: 3)."""

    def list_commands(self, ctx: Any) -> list[str]:
        """In the order of use."""
        return sorted(self.commands, key=COMMANDS.index)

    def invoke(self, ctx: Any) -> object:
        """Run the command that was called; errors end here."""
        stopping.begin_command()
        try:
            with warnings.catch_warnings(), variant_restored():
                warnings.simplefilter("ignore", SensorWarning)  # the notes are printed
                return super().invoke(ctx)
        except DiskFull as error:
            _say(error)
            raise typer.Exit(3) from None
        except BrokenPipeError:  # whoever reads the output, head for example, has enough
            silence_output()
            raise typer.Exit(BROKEN_PIPE) from None
        except (InputError, OSError, MemoryError, UsageError) as error:
            _say(error)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:  # where no signals can be waited for (Windows)
            err.print(stopping.sentence(), markup=False, highlight=False, soft_wrap=True)
            raise typer.Exit(130) from None


def _say(error: Exception) -> None:
    """One sentence on stderr."""
    with stopping.whole_step:  # not if a stop has removed what this thread misses now
        err.print(
            f"[bold red]error:[/] {escape(_sentence(error))}", highlight=False, soft_wrap=True
        )


app = typer.Typer(
    cls=CommandGroup,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},  # of all commands
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="From a 3D scene to the raw frames of a camera, with the noise of every physical source.\n\n"
    "Start here: [bold]mitsuba-sensor render scenes/first_frame.xml -o out/[/]",
)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"mitsuba-sensor {ms.__version__}")
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


class RenderInput(NamedTuple):
    """A parsed scene, and the camera and exposure that it is rendered for."""

    scene: ParsedScene
    camera: ms.Camera
    exposure: ms.Exposure | Metering


def render_input(scene: str, flags: Flags) -> tuple[RenderInput, dict[str, Flag]]:
    """The scene with the camera and exposure that are asked for, or that it names itself; and all other flags."""
    parsed = parse(scene, flags)
    return RenderInput(parsed, *camera_and_exposure(flags, parsed.settings)), other_flags(flags)


def other_flags(flags: Flags) -> dict[str, Flag]:
    """All flags but those of camera and exposure."""
    return {
        name: value
        for name, value in flags.items()
        if name not in options.CameraFlags.__annotations__
    }


def camera_and_exposure(
    flags: Flags, settings: SceneSettings = NO_SCENE
) -> tuple[ms.Camera, ms.Exposure | Metering]:
    """The named camera behind the scene's lens, else the scene's own, else the default one; the exposure likewise, else
    how it is metered.

    The --set fields are set before the scene's too, because a prescription takes focal length and focus from the scene.
    They are set after the gain setting, so that they overrule its numbers.
    """
    name, changes = flags.get("camera"), changes_of(flags)
    camera = settings.camera if name is None else None
    camera = camera or ms.load_camera(options.DEFAULT_CAMERA if name is None else name)
    camera = settings.applied_to(camera.replace(**changes) if changes else camera)
    camera = camera.at_gain(flags.get("gain")).replace(**changes)
    return camera.without(*flags.get("without") or ()), _exposure(flags, settings)


def _exposure(flags: Flags, settings: SceneSettings) -> ms.Exposure | Metering:
    temperature_k = first_given(
        flags.get("temperature_k"), settings.temperature_k, options.DEFAULT_TEMPERATURE_K
    )
    asked, meter = flags.get("exposure_s"), flags.get("meter")
    if meter is not None:
        if asked not in (None, "auto"):
            raise InputError(
                f"--exposure-s {asked:g} gives the time that --meter {meter} is to find; leave one out."
            )
        return Metering.of_text(meter, temperature_k)
    time_s: float | str | None = first_given(asked, settings.exposure_s)
    if time_s is None or isinstance(time_s, str):
        return settings.metering(temperature_k)
    return ms.Exposure(time_s, temperature_k)


def settings_of(known: RenderedFor | None, flags: Flags) -> SceneSettings:
    """Camera and exposure that an irradiance was rendered for, as if a scene named them; says so if it has none."""
    if (known is None or known.camera is None) and flags.get("camera") is None:
        default = f"the camera is {options.DEFAULT_CAMERA} unless --camera names another"
        err.print(
            f"note: this irradiance names no camera; {default}", highlight=False, soft_wrap=True
        )
    if known is None:
        return NO_SCENE
    return SceneSettings(
        known.camera,
        exposure_s=known.exposure.time_s,
        temperature_k=known.exposure.temperature_k,
    )


def changes_of(flags: Flags) -> dict[str, Any]:
    """The fields that --set changes, for ``Camera.replace``; None unsets one."""
    return {field: toml_value(text) for field, text in (flags.get("settings") or {}).items()}


def show(what: object, as_json: bool) -> None:
    """JSON and text plain and whole, everything else as rich shows it."""
    if as_json or isinstance(what, str):
        typer.echo(texts.to_json(what) if as_json else printable(str(what), keep="\n\t"))
    else:
        out.print(what, highlight=False)


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
