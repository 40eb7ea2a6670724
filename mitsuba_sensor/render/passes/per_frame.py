"""Renders for frames that each have one of their own, so that the noise of the renders is that of the frames."""

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
    """A loaded scene that is rendered anew for every frame.  sensor : the exposure of one frame.  count : of frames."""

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
        """Check everything that was asked for, and load the scene. Raises InputError."""
        if options["denoise"]:
            raise InputError(
                "denoise and a render for every frame exclude each other: what a denoiser leaves of the noise is alike "
                "in neighbouring pixels; leave one of them out."
            )
        if FrameTimes.of(options).period_s is not None:
            raise InputError(
                "a render for every frame is of one instant, and fps is given; leave one of them out."
            )
        numbers = options["frames"], options["first_frame"], first_given(options["seed"], 1)
        check_numbers(*numbers)
        rendering: RenderOptions = {**part_of(RenderOptions, options), "denoise": False}
        prepared = prepare(scene, camera, exposure, usual="channels", **rendering)
        if prepared.camera.sensor.dual_pixel:
            raise InputError(
                f"{prepared.camera.name} has dual pixels, whose halves of the pupil are rendered once; leave "
                "render_noise out."
            )
        prepared = prepared.metered_first()
        sensor = prepared.sensor({**part_of(ExposeOptions, options), "frames": 1})
        return cls(prepared, sensor, options["frames"])

    def renders(
        self, progress: Progress | None = None
    ) -> Iterator[tuple[PreparedExposure, Irradiance, Photons]]:
        """Yield the exposure of each frame, its light and its photons."""
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
