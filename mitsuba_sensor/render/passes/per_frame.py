"""A render for every frame, so that render noise differs from frame to frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ...camera.camera import Camera
from ...core import InputError, Photons, first_given
from ...core.options import part_of
from ...sensor.checks import check_numbers
from ...sensor.expose import PreparedExposure
from ...sensor.frame_times import FrameTimes
from ...sensor.metering import AskedExposure
from ...sensor.options import ExposeOptions
from ..light.irradiance import Irradiance
from ..light.light_source import CollectedLight
from ..light.photons import photons_of
from ..options import FrameSeriesOptions, RenderOptions
from ..samples import hashed_seed
from ..scene.parse_scene import SceneInput
from ..scene.parsed_scene import ParsedScene
from .prepared import PreparedRender, prepare
from .stop_criterion import Progress, RenderProgress


@dataclass(frozen=True, eq=False)
class FrameSeries:
    """Loaded scene with a render for every frame.  sensor : exposure of one frame.  count : number of frames."""

    prepared: PreparedRender
    sensor: PreparedExposure
    count: int

    @classmethod
    def prepare(
        cls,
        scene: SceneInput | ParsedScene,
        camera: Camera | None,
        exposure: AskedExposure | None,
        options: FrameSeriesOptions,
    ) -> FrameSeries:
        """Check the options and load the scene. Raises InputError."""
        if options["denoise"]:
            raise InputError(
                "denoise and render_noise='per-frame' exclude each other, because denoising correlates the noise of "
                "neighbouring pixels; omit one of them."
            )
        if FrameTimes.of(options).period_s is not None:
            raise InputError(
                "render_noise='per-frame' renders one instant, but fps is given; omit one of them."
            )
        numbers = options["frames"], options["first_frame"], first_given(options["seed"], 1)
        check_numbers(*numbers)
        rendering: RenderOptions = {**part_of(RenderOptions, options), "denoise": False}
        prepared = prepare(scene, camera, exposure, usual="channels", **rendering)
        if prepared.camera.sensor.dual_pixel:
            raise InputError(
                f"{prepared.camera.name} has dual pixels, whose half-pupil light is rendered once; omit render_noise."
            )
        prepared = prepared.metered_first()
        sensor = prepared.sensor({**part_of(ExposeOptions, options), "frames": 1})
        return cls(prepared, sensor, options["frames"])

    def renders(
        self, progress: Progress | None = None
    ) -> Iterator[tuple[PreparedExposure, Irradiance, Photons]]:
        """Yield exposure, light and photons of each frame."""
        sensor, prepared = self.sensor, self.prepared
        stop = prepared.stop_criterion(prepared.options)
        for number in range(sensor.first.index, sensor.first.index + self.count):

            def step(now: RenderProgress, number: int = number) -> None:
                if progress is not None:
                    progress(replace(now, frame=number))

            light = prepared.render(hashed_seed(sensor.first.seed, -1, number), stop, step)
            photons = photons_of(light, prepared.camera, prepared.exposure)
            photons = photons.changed(source=CollectedLight.of(light, per_frame=True))
            yield sensor.of(photons, number), light, photons
