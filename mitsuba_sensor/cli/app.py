"""The command line's trunk: the app that commands hang on, where errors end, and the only two places that print."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.markup import escape
from typer.core import TyperGroup

import mitsuba_sensor as ms

from ..core.checks import first_given
from ..core.errors import InputError
from ..io import files
from ..io.metadata import Shot
from ..sensor.camera import toml_value
from . import options

if TYPE_CHECKING:
    from ..render.scene_settings import SceneSettings

out = Console()
err = Console(stderr=True)


class CommandGroup(TyperGroup):
    """Where every command ends: what a user did wrong is one sentence on stderr and exit code 2."""

    def invoke(self, ctx: Any) -> Any:
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
    help="From a 3D scene to the raw numbers of a camera, with every noise that physics puts in.\n\n"
    "Start here: [bold]mitsuba-sensor render scenes/cornell_box.xml -o out/[/]",
)
cameras = typer.Typer(no_args_is_help=True, help="The camera files that come along, and what may stand in one.")
app.add_typer(cameras, name="cameras")


def chosen_shot(camera: str, settings: list[str] | None, exposure: ms.Exposure, **asked: Any) -> Shot:
    """The camera with its --set fields, and what is asked of it; all checked. asked : other fields of Shot."""
    return Shot(changed(ms.load_camera(camera), settings), exposure, **asked)


def scene_setup(scene: Path, parameters: dict[str, str], variant: str | None) -> SceneSettings:
    """What the scene file says of camera, exposure and seeds."""
    from ..render.scene_settings import read_settings
    from ..render.variants import choose_variant, use

    use(choose_variant(variant))
    return read_settings(scene, parameters)


def scene_camera(name: str | None, setup: SceneSettings, settings: list[str] | None = None) -> ms.Camera:
    """The named camera behind the scene's lens, else the scene's own, else the default one; with its --set fields.

    These are set first too, because a prescription among them takes focal length and focus from the scene.
    """
    base = setup.camera if name is None and setup.camera is not None else None
    base = base or ms.load_camera(options.DEFAULT_CAMERA if name is None else name)
    return changed(setup.applied_to(changed(base, settings)), settings)


def scene_exposure(exposure_s: float | None, temperature_k: float | None, setup: SceneSettings) -> ms.Exposure:
    """The exposure that was asked for, else the scene's, else the default one."""
    return ms.Exposure(
        first_given(exposure_s, setup.exposure_s, options.DEFAULT_EXPOSURE_S),
        first_given(temperature_k, setup.temperature_k, options.DEFAULT_TEMPERATURE_K),
    )


def refuse_lens(settings: list[str] | None) -> None:
    """The lens has made the light already: another one needs another render."""
    for field in options.pairs("--set", settings):
        if field.startswith("lens."):
            raise InputError(f"--set {field} comes too late: the light is behind the lens already; set it in `render`.")


def changed(camera: ms.Camera, settings: list[str] | None) -> ms.Camera:
    """The camera with its --set fields, checked again."""
    changes = {key: toml_value(text) for key, text in options.pairs("--set", settings).items()}
    return camera.replace(**changes) if changes else camera


def show(what: Any, as_json: bool) -> None:
    """JSON plain and whole, everything else as rich shows it."""
    if as_json:
        typer.echo(files.to_json(what))
    else:
        out.print(what, highlight=False)


def _sentence(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return f"not enough memory ({error}); render a smaller picture, fewer bands or fewer frames."
    if isinstance(error, OSError):
        return f"{error.filename or 'the system'}: {error.strerror or error}."
    return str(error)
