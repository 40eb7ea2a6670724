"""Scene, camera and exposure from the flags of a command, and what is said of those that nobody gave."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

import mitsuba_sensor as ms

from ..camera.camera_file import toml_value
from ..camera.shipped import DEFAULT_CAMERA
from ..capture import SensorView
from ..core import InputError, first_given
from ..files.appearing import refuse_empty, replaced_in
from ..output.exr import rendered_for
from ..render.scene.parse_scene import parse, parse_sensors
from ..render.scene.parsed_scene import ParsedScene
from ..render.scene.scene_settings import SceneSettings
from ..sensor.metering import Metering
from ..stages.usual_range import temperature_note
from . import options
from .app import err
from .flag_names import with_flags
from .options import Flags
from .values import Flag

NO_SCENE = SceneSettings()


class RenderInput(NamedTuple):
    """A parsed scene, and the camera and exposure that it is rendered for."""

    scene: ParsedScene
    camera: ms.Camera
    exposure: ms.Exposure | Metering


def render_input(scene: str, flags: Flags) -> tuple[RenderInput, dict[str, Flag]]:
    """The scene with the camera and exposure that are asked for, or that it names itself; and all other flags."""
    parsed = parse(scene, flags)
    camera, exposure = camera_and_exposure(flags, parsed.settings)
    return RenderInput(parsed.in_variant_for(camera), camera, exposure), other_flags(flags)


def render_inputs(scene: str, flags: Flags) -> tuple[dict[str, SensorView], dict[str, Flag]]:
    """The scene as each of its sensors sees it, by name, parsed once; and all other flags."""
    views = {
        name: SensorView(parsed, *camera_and_exposure(flags, parsed.settings))
        for name, parsed in parse_sensors(scene, flags).items()
    }
    return views, other_flags(flags)


def other_flags(flags: Flags) -> dict[str, Flag]:
    """All flags but those of camera and exposure."""
    own = options.CameraFlags.__annotations__
    return {name: value for name, value in flags.items() if name not in own}


def camera_and_exposure(
    flags: Flags, settings: SceneSettings = NO_SCENE
) -> tuple[ms.Camera, ms.Exposure | Metering]:
    """The named camera as it is, else the scene's own, else the default one behind the scene's lens; the exposure
    likewise the one asked for, else the scene's, else how it is metered."""
    exposure = _exposure(flags, settings)
    tell_of_temperature(exposure.temperature_k)
    return camera_of(flags, settings), exposure


def tell_of_temperature(temperature_k: float) -> None:
    """Print a note on an unusual temperature, before a long render."""
    for note in temperature_note(temperature_k):
        _note(note)


def _note(text: str) -> None:
    err.print(f"note: {with_flags(text)}", highlight=False, soft_wrap=True)


def camera_of(flags: Flags, settings: SceneSettings = NO_SCENE) -> ms.Camera:
    """The camera at its gain setting, with --set and --without, or one read-out of it.

    The --set fields are set before the scene's too, because a prescription takes focal length and focus from the scene.
    They are set after the gain setting, so that they overrule its numbers.
    """
    name, changes = flags.get("camera"), changes_of(flags)
    if name is not None:
        camera = ms.load_camera(name)
    else:
        own = settings.camera or ms.load_camera(DEFAULT_CAMERA)
        camera = settings.applied_to(own.replace(**changes) if changes else own)
    camera = camera.at_gain(flags.get("gain")).replace(**changes)
    if flags.get("readout") is not None:
        camera = camera.at_readout(flags["readout"])
    return camera.without(*flags.get("without") or ())


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


def settings_of(irradiance: str, flags: Flags) -> SceneSettings:
    """Camera and exposure that an irradiance was rendered for, as if a scene named them; says so if it has none."""
    known = rendered_for(irradiance)
    if (known is None or known.camera is None) and flags.get("camera") is None:
        _note(
            f"this irradiance names no camera; the camera is {DEFAULT_CAMERA} unless --camera names another"
        )
    if known is None:
        return NO_SCENE
    exposure = known.exposure
    return SceneSettings(
        known.camera, exposure_s=exposure.time_s, temperature_k=exposure.temperature_k
    )


def changes_of(flags: Flags) -> dict[str, Any]:
    """The fields that --set changes, for ``Camera.replace``; None unsets one."""
    return {field: toml_value(text) for field, text in (flags.get("settings") or {}).items()}


def new_file(name: str, example: str, force: bool = True) -> Path:
    """The path of a file to write. Raises InputError for a name that ends otherwise than the example, and for a file
    that exists unless ``force`` is given."""
    refuse_empty(name, "-o", f"give the name of a file, e.g. {example}")
    path, suffix = Path(name), Path(example).suffix
    if path.suffix != suffix:
        raise InputError(f"{name} does not end in {suffix}; give a name like {example}.")
    if path.exists() and not (force and path.is_file()):
        overwrite = "--force overwrites it, or " if path.is_file() else ""
        raise InputError(f"{name} exists already; {overwrite}give another name.")
    return path


def written(folder: str | Path, names: Sequence[str]) -> str:
    """The files that are in a folder now, and those of an earlier result that they replace.

    names : of all that a command writes; a ``*`` stands for any text.
    """
    files = sorted(file.name for file in Path(folder).iterdir())
    known = dict.fromkeys(file for name in names for file in files if fnmatch(file, name))
    older = replaced_in(folder)
    replaced = f"; an earlier result there was replaced ({', '.join(older)})" if older else ""
    return f"wrote in {folder}: {', '.join(known)}{replaced}"


def taken_by_default(flags: Flags, settings: SceneSettings, camera: ms.Camera) -> list[str]:
    """The sentence about camera, exposure and temperature that neither the user nor the scene gave, or none.

    settings : what the scene, or the light, says of them.
    """
    metered = flags.get("meter") is None and settings.exposure_s is None
    usual = {
        "camera": (f"camera {camera.name} (--camera)", settings.camera is None),
        "exposure_s": ("metered exposure time (--exposure-s)", metered),
        "temperature_k": (
            f"{options.DEFAULT_TEMPERATURE_K} K (--temperature-k)",
            settings.temperature_k is None,
        ),
    }
    taken = [
        said
        for name, (said, is_open) in usual.items()
        if is_open and flags.get(name) is None and (name in flags or name == "camera")
    ]
    return [f"taken by default: {', '.join(taken)}"] if taken else []
