"""Scene, camera and exposure from the flags of a command."""

from __future__ import annotations

from typing import Any, NamedTuple

import mitsuba_sensor as ms

from ..camera.camera_file import toml_value
from ..camera.shipped import DEFAULT_CAMERA
from ..capture import SensorView
from ..core import InputError, first_given
from ..render.light.irradiance import RenderedFor
from ..render.scene.parse_scene import parse, parse_sensors
from ..render.scene.parsed_scene import ParsedScene
from ..render.scene.scene_settings import SceneSettings
from ..sensor.metering import Metering
from ..stages.usual_range import temperature_note
from . import options
from .app import err
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
    return {
        name: value
        for name, value in flags.items()
        if name not in options.CameraFlags.__annotations__
    }


def camera_and_exposure(
    flags: Flags, settings: SceneSettings = NO_SCENE
) -> tuple[ms.Camera, ms.Exposure | Metering]:
    """The named camera as it is, else the scene's own, else the default one behind the scene's lens; the exposure
    likewise the one asked for, else the scene's, else how it is metered."""
    exposure = _exposure(flags, settings)
    tell_of_temperature(exposure.temperature_k)
    return _camera(flags, settings), exposure


def tell_of_temperature(temperature_k: float) -> None:
    """Print a note on an unusual temperature, before a long render."""
    for note in temperature_note(temperature_k):
        err.print(f"note: {note}", highlight=False, soft_wrap=True)


def _camera(flags: Flags, settings: SceneSettings) -> ms.Camera:
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


def settings_of(known: RenderedFor | None, flags: Flags) -> SceneSettings:
    """Camera and exposure that an irradiance was rendered for, as if a scene named them; says so if it has none."""
    if (known is None or known.camera is None) and flags.get("camera") is None:
        default = f"the camera is {DEFAULT_CAMERA} unless --camera names another"
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
