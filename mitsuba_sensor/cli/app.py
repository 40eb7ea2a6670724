"""The app that the commands belong to: what errors become, camera and exposure from flags, output on the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.markup import escape
from typer.core import TyperGroup

import mitsuba_sensor as ms

from ..core import InputError, first_given
from ..io import files
from ..sensor.camera import toml_value
from . import options
from .options import Flag, Flags

if TYPE_CHECKING:
    from ..render.scene_settings import ParsedScene, SceneSettings

out = Console()
err = Console(stderr=True)


class CommandGroup(TyperGroup):
    """Runs a command: what a user did wrong becomes one sentence on stderr and exit code 2."""

    def invoke(self, ctx: Any) -> object:
        """Run the command that was called; errors end here."""
        try:
            return super().invoke(ctx)
        except (InputError, OSError, MemoryError) as error:
            err.print(f"[bold red]error:[/] {escape(_sentence(error))}", highlight=False, soft_wrap=True)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            err.print("stopped; nothing was written", highlight=False)
            raise typer.Exit(130) from None


app = typer.Typer(
    cls=CommandGroup,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="From a 3D scene to the raw frames of a camera, with the noise of every physical source.\n\n"
    "Start here: [bold]mitsuba-sensor render scenes/cornell_box.xml -o out/[/]",
)
cameras = typer.Typer(
    no_args_is_help=True, help="The cameras that ship with the package, their lenses, and the format of a camera file."
)
app.add_typer(cameras, name="cameras")


@dataclass(frozen=True, eq=False)
class RenderInput:
    """A parsed scene, and the camera and exposure that it is rendered for."""

    scene: ParsedScene
    camera: ms.Camera
    exposure: ms.Exposure


def render_input(scene: Path, flags: Flags) -> tuple[RenderInput, dict[str, Flag]]:
    """The scene with the camera and exposure that are asked for, or that it names itself; and all other flags."""
    from ..render.scene_settings import parse

    parsed = parse(scene, flags.get("parameters"), flags.get("variant"))
    camera, exposure = scene_camera(flags, parsed.settings), scene_exposure(flags, parsed.settings)
    asked = {name: value for name, value in flags.items() if name not in options.CameraFlags.__annotations__}
    return RenderInput(parsed, camera, exposure), asked


def scene_camera(flags: Flags, settings: SceneSettings) -> ms.Camera:
    """The named camera behind the scene's lens, else the scene's own, else the default one; with its --set fields.

    These are set first too, because a prescription among them takes focal length and focus from the scene.
    """
    name, changes = flags.get("camera"), flags.get("settings")
    base = settings.camera if name is None and settings.camera is not None else None
    base = base or ms.load_camera(options.DEFAULT_CAMERA if name is None else name)
    return changed(settings.applied_to(changed(base, changes)), changes)


def scene_exposure(flags: Flags, settings: SceneSettings) -> ms.Exposure:
    """The exposure that was asked for, else the scene's, else the default one."""
    return ms.Exposure(
        first_given(flags.get("exposure_s"), settings.exposure_s, options.DEFAULT_EXPOSURE_S),
        first_given(flags.get("temperature_k"), settings.temperature_k, options.DEFAULT_TEMPERATURE_K),
    )


def given_camera(flags: Flags) -> ms.Camera:
    """The named camera, else the default one, with its --set fields; where there is no scene."""
    return changed(ms.load_camera(flags.get("camera") or options.DEFAULT_CAMERA), flags.get("settings"))


def given_exposure(flags: Flags) -> ms.Exposure:
    """The exposure that was asked for, else the default one; where there is no scene."""
    return ms.Exposure(
        first_given(flags.get("exposure_s"), options.DEFAULT_EXPOSURE_S),
        first_given(flags.get("temperature_k"), options.DEFAULT_TEMPERATURE_K),
    )


def refuse_lens(settings: Mapping[str, str] | None) -> None:
    """The irradiance is behind the lens already: another lens needs another render."""
    for field in settings or ():
        if field.startswith("lens."):
            raise InputError(
                f"--set {field} comes too late: the irradiance is behind the lens already; set it in `render`."
            )


def changed(camera: ms.Camera, settings: Mapping[str, str] | None) -> ms.Camera:
    """The camera with its --set fields, checked again."""
    changes = {key: toml_value(text) for key, text in (settings or {}).items()}
    return camera.replace(**changes) if changes else camera


def show(what: object, as_json: bool) -> None:
    """JSON and text plain and whole, everything else as rich shows it."""
    if as_json or isinstance(what, str):
        typer.echo(files.to_json(what) if as_json else what)
    else:
        out.print(what, highlight=False)


def _sentence(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return f"not enough memory ({error}); render a smaller picture (--width), fewer bands or fewer frames."
    if isinstance(error, OSError):
        return f"{error.filename or 'the system'}: {error.strerror or error}."
    return str(error)
