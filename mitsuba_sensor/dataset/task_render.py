"""The render of a task: scene, camera and exposure as a dataset asks for them, and the light that comes of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

from ..camera.camera import Camera
from ..camera.camera_file import camera_from
from ..core import Exposure
from ..core.options import complete
from ..output.dng import check_dng
from ..render.light.illuminant import illuminant_of
from ..render.light.irradiance import Irradiance
from ..render.motion.aovs import Aovs
from ..render.options import RenderOptions
from ..render.passes.prepared import METERING_SPP, PreparedRender, prepare
from ..render.scene.parse_scene import parse
from ..render.scene.parsed_scene import ParsedScene
from ..render.scene.scene_settings import SceneSettings
from ..render.variants import fastest_variant, use
from ..sensor.metering import Metering
from .keys import Config, key_of, seed_of
from .plan import Task


class TaskRender:
    """The render of a task, for the camera of its lead. Raises InputError.

    Its scene is loaded when the light is asked for, or its AOVs.
    """

    def __init__(self, task: Task) -> None:
        self.task, self.options = task, scene_options(task)
        self._parsed = parsed_scene(task, self.options)

    @property
    def settings(self) -> SceneSettings:
        """What the scene file says of camera and exposure."""
        return self._parsed.settings

    @property
    def _is_cube(self) -> bool:
        return bool(self.task.config["render"]["spectral"] == "cube")

    @cached_property
    def camera(self) -> Camera:
        """That it is rendered for: of a cube one that is flat over the band."""
        camera = camera_of(self.task.lead)
        if self._is_cube:
            return flat_camera(camera)
        return camera

    @cached_property
    def prepared(self) -> PreparedRender:
        """The scene, loaded."""
        use(self._parsed.variant)
        lead = self.task.lead
        asked, stops = exposure_of(self.settings, lead), lead["exposure"]["ev"]
        if is_timed(self.task):
            asked = _timed(self._parsed, self.camera, asked, stops, self.options)
        return prepare(self._parsed, self.camera, asked, **self.options)

    def aovs(self) -> Aovs:
        """Depth, position, normals, …, traced now."""
        prepared = self.prepared
        use(self._parsed.variant)  # a task of another camera may have been rendered between
        return prepared.aovs()

    def light(self) -> Irradiance:
        """The light, rendered now."""
        prepared, config = self.prepared, self.task.config
        if "dng" in self.task.lead["outputs"]:
            columns, rows = prepared.scene.view.crop_size
            check_dng(camera_of(self.task.lead), (rows, columns))
        stop = prepared.stop_criterion(complete(RenderOptions, self.options))
        light = prepared.render(seed_of(key_of(config)), stop)
        if not self._is_cube or light.rendered_for is None:
            return light
        illuminant = illuminant_of(prepared.at_rest, self.camera.band_nm[1])
        known = replace(
            light.rendered_for, illuminant=illuminant
        )  # for cameras with filters too
        return replace(light, rendered_for=known)


def without_times(light: Irradiance) -> Irradiance:
    """The light as all machines render it: the seconds that it took are left out."""
    still = replace(light.statistics, seconds=0.0, seconds_per_sample=0.0)
    return replace(light, statistics=still)


def camera_of(config: Config) -> Camera:
    """The camera of a sample at its gain: as a dataset names it, whatever fields the scene sets."""
    return camera_from(config["camera"], "of the sample").at_gain(config["gain"])


def exposure_of(settings: SceneSettings, config: Config) -> Exposure | Metering:
    """The exposure that a sample asks for, without its stops: else the scene file's, else metered."""
    time_s, kelvin = config["exposure"]["time_s"], config["exposure"]["temperature_k"]
    if time_s is None:
        asked = settings.exposure
        if kelvin is None:
            return asked
        return replace(asked, temperature_k=kelvin)
    if time_s == "auto":
        return settings.metering(kelvin)
    return Exposure(time_s, settings.metering(kelvin).temperature_k)


def scene_options(task: Task) -> RenderOptions:
    """The options of the render."""
    config = task.config
    names = (
        "parameters",
        "traverse",
        "look_at",
        "scene_unit",
        "integrator",
        "ignore_polarization",
        "motion",
        "sensor",
    )
    of_scene = {name: config.get(name) for name in names}
    if "start_s" in config:
        of_scene["start_s"] = config["start_s"]
    of_scene["traverse"] = of_scene["traverse"] or None
    decided = {"denoise": bool(config["render"].get("denoise")), "repeatable": True}
    return {**config["render"], **of_scene, **decided}  # type: ignore[typeddict-item]


def parsed_scene(task: Task, options: RenderOptions) -> ParsedScene:
    """The scene of a task, for whose camera the variant is set. Raises InputError."""
    use(fastest_variant("llvm"))  # whatever is set: CUDA adds in any order
    return parse(task.scene_file, options).in_variant_for(camera_of(task.lead))


def is_timed(task: Task) -> bool:
    """Whether the exposure time decides the light: where something moves, or a noise ratio is asked for."""
    return "motion" in task.config or bool(task.config["render"]["noise_ratio"])


def flat_camera(camera: Camera) -> Camera:
    """One that detects every photon of the band: light rendered for it is for all cameras of the band."""
    low, high = camera.band_nm
    flat = {"curves": {"mono": [1.0, 1.0]}, "wavelengths_nm": [low, high], "tile": None}
    return camera.replace(
        **{f"quantum_efficiency.{name}": value for name, value in flat.items()}
    )


def _timed(
    parsed: ParsedScene,
    camera: Camera,
    asked: Exposure | Metering,
    stops: float,
    options: RenderOptions,
) -> Exposure:
    """The exposure with its stops, metered by a short render at rest if need be."""
    known = asked
    if isinstance(asked, Metering):
        still: Any = {
            **options,
            "motion": None,
            "subframes": None,
            "noise_ratio": None,
            "max_spp": None,
            "spp": METERING_SPP,
        }
        known = prepare(parsed, camera, asked, **still).metered_first().exposure
    assert isinstance(known, Exposure)
    return Exposure(known.time_s * 2.0**stops, known.temperature_k)
