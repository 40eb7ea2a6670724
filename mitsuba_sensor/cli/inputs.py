"""Scene, camera and exposure from the flags of a command, and the sentence about defaults."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

import mitsuba_sensor as ms

from ..camera.camera_file import toml_value
from ..camera.shipped import DEFAULT_CAMERA
from ..capture import SensorView
from ..core import InputError, SensorWarning, first_given
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
from .options import DEFAULT_TEMPERATURE_K, Flag, Flags

NO_SCENE = SceneSettings()


class RenderInput(NamedTuple):
    """A parsed scene with its camera and exposure."""

    scene: ParsedScene
    camera: ms.Camera
    exposure: ms.Exposure | Metering


def render_input(scene: str, flags: Flags) -> tuple[RenderInput, dict[str, Flag]]:
    """Return the scene with the camera and exposure of the flags or the scene itself, and all other flags."""
    parsed = parse(scene, flags)
    camera, exposure = camera_and_exposure(flags, parsed.settings)
    return RenderInput(parsed.in_variant_for(camera), camera, exposure), other_flags(flags)


def render_inputs(scene: str, flags: Flags) -> tuple[dict[str, SensorView], dict[str, Flag]]:
    """Return the scene as each of its sensors sees it, by name, and all other flags."""
    views: dict[str, SensorView] = {}
    noted = set[float]()
    for name, parsed in parse_sensors(scene, flags).items():
        exposure = _exposure(flags, parsed.settings)
        if exposure.temperature_k not in noted:
            note_temperature(exposure.temperature_k)
        noted.add(exposure.temperature_k)
        views[name] = SensorView(parsed, camera_of(flags, parsed.settings), exposure)
    return views, other_flags(flags)


def other_flags(flags: Flags) -> dict[str, Flag]:
    """Return all flags except those of camera and exposure."""
    of_camera = options.CameraFlags.__annotations__
    return {name: value for name, value in flags.items() if name not in of_camera}


def camera_and_exposure(
    flags: Flags, settings: SceneSettings = NO_SCENE
) -> tuple[ms.Camera, ms.Exposure | Metering]:
    """Return the camera of the flags, else the scene's, else the default camera with the scene's lens; and the
    exposure of the flags, else the scene's, else how it is metered."""
    exposure = _exposure(flags, settings)
    note_temperature(exposure.temperature_k)
    return camera_of(flags, settings), exposure


def note_temperature(temperature_k: float) -> None:
    """Print a note on an unusual temperature before the work begins."""
    for note in temperature_note(temperature_k):
        _note(note)


def _note(text: str) -> None:
    err.print(f"note: {with_flags(text)}", highlight=False, soft_wrap=True)


def camera_of(flags: Flags, settings: SceneSettings = NO_SCENE) -> ms.Camera:
    """Return the camera at its gain setting, with --set and --without, or one readout of it.

    The --set fields are set twice: before the scene's lens, because a prescription takes focal length and focus from
    the scene, and after the gain setting, to override its numbers.
    """
    name, changes = flags.get("camera"), changes_of(flags)
    if name is not None:
        camera = ms.load_camera(name)
    else:
        camera = settings.camera or ms.load_camera(DEFAULT_CAMERA)
        camera = settings.applied_to(with_changes(camera, changes) if changes else camera)
    camera = with_changes(camera.at_gain(flags.get("gain")), changes)
    if flags.get("readout") is not None:
        camera = camera.at_readout(flags["readout"])
    return camera.without(*flags.get("without") or ())


def _exposure(flags: Flags, settings: SceneSettings) -> ms.Exposure | Metering:
    temperature_k = first_given(
        flags.get("temperature_k"), settings.temperature_k, DEFAULT_TEMPERATURE_K
    )
    given, meter = flags.get("exposure_s"), flags.get("meter")
    if meter is not None:
        if given not in (None, "auto"):
            raise InputError(
                f"--exposure-s {given:g} sets the time that --meter {meter} would determine; omit one of them."
            )
        return Metering.of_text(meter, temperature_k)
    time_s: float | str | None = first_given(given, settings.exposure_s)
    if time_s is None or isinstance(time_s, str):
        return settings.metering(temperature_k)
    return ms.Exposure(time_s, temperature_k)


def settings_of(irradiance: str, flags: Flags) -> SceneSettings:
    """Return camera and exposure of the render of an irradiance, as scene settings; print a note if it has none."""
    rendered = rendered_for(irradiance)
    if (rendered is None or rendered.camera is None) and flags.get("camera") is None:
        _note(
            f"this irradiance names no camera, so the camera is {DEFAULT_CAMERA}; choose another with --camera"
        )
    if rendered is None:
        return NO_SCENE
    time_s, temperature_k = rendered.exposure.time_s, rendered.exposure.temperature_k
    return SceneSettings(rendered.camera, exposure_s=time_s, temperature_k=temperature_k)


def changes_of(flags: Flags) -> dict[str, Any]:
    """Return the fields that --set changes, for ``Camera.replace``; None unsets a field."""
    return {field: toml_value(text) for field, text in (flags.get("settings") or {}).items()}


def with_changes(camera: ms.Camera, changes: dict[str, Any]) -> ms.Camera:
    """Return the camera with the fields that --set changes; print a note if they replace K."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SensorWarning)
        changed = camera.replace(**changes)
    for warning in caught:
        _note(str(warning.message))
    return changed


def new_file(name: str, example: str, force: bool = True) -> Path:
    """Return the path of a file to write.

    Raises InputError for another suffix than the example's, and for an existing file without ``force``.
    """
    refuse_empty(name, "-o", f"give the name of a file, e.g. {example}")
    path, suffix = Path(name), Path(example).suffix
    if path.suffix != suffix:
        raise InputError(f"{name} does not end in {suffix}; give a name like {example}.")
    if path.exists() and not (force and path.is_file()):
        overwrite = "overwrite it with --force, or " if path.is_file() else ""
        raise InputError(f"{name} already exists; {overwrite}give another name.")
    return path


def written(folder: str | Path, names: Sequence[str]) -> str:
    """Return a sentence about the files in a folder and the earlier results that they replaced.

    names : of all files that a command writes; a ``*`` stands for any text.
    """
    files = sorted(file.name for file in Path(folder).iterdir())
    made = dict.fromkeys(file for name in names for file in files if fnmatch(file, name))
    older = replaced_in(folder)
    replaced = f"; replaced an earlier result ({', '.join(older)})" if older else ""
    return f"wrote in {folder}: {', '.join(made)}{replaced}"


def defaults_line(flags: Flags, settings: SceneSettings, camera: ms.Camera) -> list[str]:
    """Return the sentence about camera, exposure and temperature that neither the user nor the scene set, or nothing.

    settings : of the scene or the light.
    """
    is_metered = flags.get("meter") is None and settings.exposure_s is None
    defaults = {
        "camera": (f"camera {camera.name} (--camera)", settings.camera is None),
        "exposure_s": ("metered exposure time (--exposure-s)", is_metered),
        "temperature_k": (
            f"{DEFAULT_TEMPERATURE_K} K (--temperature-k)",
            settings.temperature_k is None,
        ),
    }
    taken = [
        text
        for name, (text, is_open) in defaults.items()
        if is_open and flags.get(name) is None and (name in flags or name == "camera")
    ]
    return [f"defaults: {', '.join(taken)}"] if taken else []
