"""A scene, parsed once and loaded once, and its renders: passes → spectral irradiance and render statistics."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import Any, Literal, Unpack

from ..core import Exposure, InputError, check_types, first_given, require_seed
from ..core.options import complete, documents
from ..optics.intrinsics import aperture_f_number, intrinsics
from ..optics.shutter import shutter_of
from ..sensor.camera import Camera
from ..sensor.expose import PreparedExposure, prepare_exposure
from ..sensor.options import ExposeOptions
from .aovs import Aovs, aovs_of, load_for_rays
from .bands import BANDWIDTH_NM, Bands, choose_bands
from .denoise import denoised, library
from .irradiance import Irradiance
from .motion import Motion, read_motion
from .moving_scene import MovingScene
from .options import RenderOptions
from .passes import SAMPLER
from .renderer import Criterion, Renderer
from .scene import Scene, load_scene
from .scene_settings import ParsedScene, SceneSettings, parse, unit_m
from .statistics import RenderStatistics, summary_of, trusted, why_not_trusted
from .stop_criterion import End, Progress, StopCriterion, stop_criterion_of


@documents(RenderOptions)
def render(
    scene: str | os.PathLike[str] | ParsedScene,
    camera: Camera | None = None,
    exposure: Exposure | None = None,
    *,
    seed: int | None = None,
    progress: Progress | None = None,
    **options: Unpack[RenderOptions],
) -> Irradiance:
    """Render a scene file into the irradiance on this camera's focal plane.

    camera, exposure, seed : what is not given is read from the scene's <film type="photosensor">, and so are the
        options wavelength_nm, bandwidth_nm and spectral. A camera that is given brings its own lens; a note says so
        where the scene's <sensor type="camera"> has another.
    progress : called with a :class:`render.stop_criterion.RenderProgress`, also once before the first pass.
    Raises InputError for anything wrong with the arguments or the scene. Ctrl-C is obeyed between passes.
    """
    started = time.monotonic()
    chosen = complete(RenderOptions, options)
    check_options(chosen)
    prepared = prepare(scene, camera, exposure, **chosen)
    return prepared.render(prepared.seed(seed), prepared.stop_criterion(chosen), progress, started=started)


def check_options(options: RenderOptions) -> None:
    """Raise InputError for options that are no use in any scene."""
    if options["denoise"]:
        library()
    if options["subframes"] is not None and options["motion"] is None:
        raise InputError(f"subframes is {options['subframes']!r} and nothing moves; pass a motion, or leave it out.")
    stop_criterion_of(options)


@dataclass(frozen=True, eq=False)
class PreparedRender:
    """A loaded scene that can be rendered for one camera and exposure as often as asked.

    motion : what moves while the shutter is open.  unit_m : metres per scene unit.
    """

    parsed: ParsedScene
    scene: Scene | MovingScene
    camera: Camera
    exposure: Exposure
    bands: Bands
    renderer: Renderer
    denoise: bool
    width: int | None
    motion: Motion
    unit_m: float
    sampler: str = SAMPLER

    @property
    def at_rest(self) -> Scene:
        """The scene without its motion."""
        return self.scene if isinstance(self.scene, Scene) else self.scene.scene

    def seed(self, given: int | None) -> int:
        """The seed that was given, else the scene file's, else 1. Raises InputError."""
        return require_seed("seed", first_given(given, self.parsed.settings.seed, 1))

    def stop_criterion(self, options: RenderOptions) -> StopCriterion:
        """When a render of these bands is good enough."""
        return stop_criterion_of(options, len(self.bands.groups))

    def render(
        self,
        seed: int,
        stop: StopCriterion,
        progress: Progress | None = None,
        *,
        started: float | None = None,
        criterion: Criterion | None = None,
    ) -> Irradiance:
        """One render.

        started : when it began, on the monotonic clock [s]; now by default.  criterion : see :meth:`Renderer.run`.
        """
        began = time.monotonic() if started is None else started
        end = self.renderer.run(seed, stop, progress or (lambda step: None), criterion)
        statistics = self._statistics(stop, end, began)
        halves = self.renderer.halves() if self.denoise else None
        data, error, relative = self.renderer.result()
        if not data.any():
            raise InputError(self._black())
        bands, (column, row) = self.bands, self.scene.view.crop_offset
        light = Irradiance(
            data=data,
            wavelengths_nm=bands.wavelengths_nm,
            bandwidths_nm=bands.bandwidths_nm,
            standard_error=error,
            relative_error=relative,
            statistics=statistics,
            filters=tuple(self.camera.quantum_efficiency.curves) if bands.kind == "channels" else None,
            response=bands.response,
            origin=(row, column),
        )
        return light if halves is None else denoised(light, self.at_rest, halves)

    def sensor(self, options: ExposeOptions) -> PreparedExposure:
        """The exposure of what is rendered, checked before anything is: ``.of(photons).frames()``.

        Seed and serial number are by default the scene file's, else 1. Raises InputError.
        """
        (columns, rows), (column, row) = self.scene.view.crop_size, self.scene.view.crop_offset
        serial = require_seed("serial", first_given(options.get("serial"), self.parsed.settings.serial, 1))
        seeds: ExposeOptions = {**options, "seed": self.seed(options.get("seed")), "serial": serial}
        return prepare_exposure(self.camera, self.exposure, (rows, columns), (row, column), seeds)

    def aovs(self) -> Aovs:
        """Depth, position, normals, … of the same pixels, in a pass of their own."""
        scene = self.at_rest
        if self.motion != Motion():  # a mesh that has moved and come back is off by rounding: built again
            scene = load_for_rays(self.parsed.file, self.camera, self.unit_m, self.width)
        return aovs_of(scene, self.motion, self.unit_m, shutter_of(self.camera, self.exposure))

    def _statistics(self, stop: StopCriterion, end: End, started: float) -> RenderStatistics:
        renderer, passes = self.renderer, self.renderer.passes
        fireflies = renderer.firefly_fraction()
        reliable = trusted(passes, fireflies)
        return RenderStatistics(
            passes=passes,
            samples_per_pixel=renderer.samples_per_pixel,
            seconds=time.monotonic() - started,
            variant=self.parsed.variant.name,
            sampler=self.sampler,
            spectral=self.bands.kind,
            **summary_of(renderer.noise_ratios(), renderer.electrons()[0] > 0, passes),
            noise_ratio_asked=stop.goal if stop.reached == "noise_ratio" else None,
            ended_by=end,
            reliable=reliable,
            firefly_fraction=fireflies,
            negative=renderer.negative,
            non_finite=renderer.non_finite,
            notes=(
                *self._notes(stop, end),
                *(() if reliable else (why_not_trusted(passes, fireflies),)),
                *self._hint(),
            ),
            scene_sha256=self.scene.sha256,
            aperture_f_number=aperture_f_number(self.scene.view, self.camera),
            intrinsics=intrinsics(self.scene.view, self.camera),
        )

    def _notes(self, stop: StopCriterion, end: End) -> tuple[str, ...]:
        """What was replaced in the scene, what of it the camera overrules, other samples than asked for."""
        notes = [*self.scene.notes, *self._overruled()]
        if stop.asked is not None and stop.asked != self.renderer.samples_per_pixel:
            taken = f"{stop.asked} samples per pixel asked for, {self.renderer.samples_per_pixel} taken"
            notes.append(f"{taken}: equal passes, each a full grid" if end == "spp" else f"{taken}: the time was up")
        return tuple(notes)

    def _hint(self) -> tuple[str, ...]:
        return (self.parsed.variant.hint,) if self.parsed.variant.hint else ()

    def _overruled(self) -> list[str]:
        """A note where the camera has another value than the scene file in a field that the file sets."""
        mine, file = self.camera.model_dump(), self.parsed.settings.applied_to(self.camera).model_dump()
        fields = [name for name in self.parsed.settings.fields if _value(mine, name) != _value(file, name)]
        return [f"{', '.join(fields)} of the scene file overruled by the camera that was given"] if fields else []

    def _black(self) -> str:
        non_finite = self.renderer.non_finite
        why = f" ({non_finite} values were not finite)" if non_finite else ""
        remedy = "give it an emitter that lights what the sensor sees, with a spectrum there"
        return f"the scene is black from {self.bands.low_nm:g} to {self.bands.high_nm:g} nm{why}; {remedy}."


def prepare(
    scene: str | os.PathLike[str] | ParsedScene,
    camera: Camera | None = None,
    exposure: Exposure | None = None,
    *,
    usual: Literal["auto", "channels"] = "auto",
    sampler: str = SAMPLER,
    **options: Unpack[RenderOptions],
) -> PreparedRender:
    """Check all that was asked for, read what was not from the scene file, and load the scene; no ray is traced.

    usual : the value of ``spectral`` where neither the options nor the scene file ask for anything.
    sampler : see :func:`render.scene.load_scene`; not an option of :func:`render`, because no other is better
        (benchmarks/render_passes.py).
    Raises InputError.
    """
    check_types(camera, exposure, optional=True)
    chosen = complete(RenderOptions, options)
    check_options(chosen)
    parsed = scene if isinstance(scene, ParsedScene) else parse(scene, chosen["parameters"], chosen["variant"])
    settings = parsed.settings
    camera, exposure = camera_and_exposure(settings, camera, exposure)
    bands = _bands(chosen, settings, camera, usual)
    unit: str | float | None = first_given(chosen["scene_unit"], settings.unit_m)
    metres = 1.0 if unit is None else unit_m(unit)
    at_rest = load_scene(parsed.file, bands, {}, camera, chosen["scene_unit"], width=chosen["width"], sampler=sampler)
    loaded: Scene | MovingScene = at_rest
    motion = Motion() if chosen["motion"] is None else read_motion(chosen["motion"])
    if chosen["motion"] is not None:
        loaded = MovingScene(at_rest, motion, camera, exposure, chosen["subframes"], metres)
    return PreparedRender(
        parsed=parsed,
        scene=loaded,
        camera=camera,
        exposure=exposure,
        bands=bands,
        renderer=Renderer(loaded, camera, exposure, bands, halves=chosen["denoise"]),
        denoise=chosen["denoise"],
        width=chosen["width"],
        motion=motion,
        unit_m=metres,
        sampler=sampler,
    )


def camera_and_exposure(
    settings: SceneSettings, camera: Camera | None, exposure: Exposure | None
) -> tuple[Camera, Exposure]:
    """What was given; else what the scene file says. Raises InputError."""
    camera = settings.camera if camera is None else camera
    exposure = settings.exposure if exposure is None else exposure
    for name, value, field in (("camera", camera, "camera"), ("exposure", exposure, "exposure_s")):
        if value is None:
            raise InputError(
                f'no {name} is given and the scene has none; pass one, or put <film type="photosensor"> with {field} '
                "into its sensor."
            )
    assert camera is not None and exposure is not None
    return camera, exposure


def _bands(options: RenderOptions, settings: SceneSettings, camera: Camera, usual: str) -> Bands:
    """The channels asked for, else those of the scene file, else the ``usual`` ones. Raises InputError."""
    wavelength_nm = first_given(options["wavelength_nm"], settings.wavelength_nm)
    in_scene = "auto" if options["wavelength_nm"] else settings.spectral
    spectral = first_given(options["spectral"], in_scene, "auto")
    if spectral == "auto":  # channels have no width, and no electrons in bursts
        bands = wavelength_nm is not None or options["bandwidth_nm"] is not None
        spectral = "auto" if bands or camera.quantum_efficiency.quantum_yield else usual
    width_nm = first_given(options["bandwidth_nm"], settings.bandwidth_nm, BANDWIDTH_NM)
    return choose_bands(camera, wavelength_nm, width_nm, spectral)


def _value(fields: Any, name: str) -> Any:
    """A nested field by its dotted name."""
    for part in name.split("."):
        fields = fields[part]
    return fields
