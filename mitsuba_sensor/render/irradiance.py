"""Render passes → spectral irradiance at the focal plane, with its Monte Carlo variance."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.checks import check_types, first_given
from ..core.errors import InputError, require_seed
from ..core.exposure import Exposure
from ..optics.intrinsics import intrinsics
from ..optics.view import aperture_f_number
from .bands import Bands, choose_bands
from .denoise import denoised, library
from .motion import Motion, read_motion
from .moving_scene import MovingScene
from .passes import SAMPLER
from .renderer import Criterion, Progress, Renderer
from .scene import Scene, load_scene
from .scene_settings import SceneSettings, read_settings, unit_m
from .statistics import RenderStatistics, summary_of, trusted, why_not_trusted
from .stop_criterion import End, StopCriterion, stop_criterion_of
from .variants import Variant, choose_variant, use

if TYPE_CHECKING:
    from ..sensor.camera import Camera

BANDWIDTH_NM = 10.0


@dataclass(frozen=True, eq=False)
class Irradiance:
    """Spectral irradiance at the focal plane, and how sure it is.

    data : (H, W, B) mean over pixel and band [W m⁻² nm⁻¹]; float32, as in a file.
    wavelengths_nm, bandwidths_nm : (B,) centres and widths of the bands.
    standard_error : (H, W, B) of the Monte Carlo mean, same unit.
    relative_error : (H, W) relative standard error of the detected electrons of the camera that it was rendered for;
        kept beside ``standard_error`` because the bands of a pixel are correlated.
    filters : None, or the colour filters whose responses took the place of bands: ``data`` [W m⁻²] is then what would
        be detected with a quantum efficiency of 1 at ``wavelengths_nm``.  response : the fingerprint of that camera.
    origin : (row, column) of the first pixel on the sensor: where the film's crop window begins.
    """

    data: NDArray[np.float32]
    wavelengths_nm: NDArray[np.float64]
    bandwidths_nm: NDArray[np.float64]
    standard_error: NDArray[np.float32]
    relative_error: NDArray[np.float32]
    statistics: RenderStatistics
    filters: tuple[str, ...] | None = None
    response: str | None = None
    origin: tuple[int, int] = (0, 0)


def render(
    scene: str | os.PathLike[str],
    camera: Camera | None = None,
    exposure: Exposure | None = None,
    *,
    seed: int | None = None,
    spp: int | None = None,
    noise_ratio: float | None = None,
    max_seconds: float | None = None,
    max_spp: int | None = None,
    wavelength_nm: float | None = None,
    bandwidth_nm: float | None = None,
    spectral: str | None = None,
    scene_unit: str | float | None = None,
    columns: int | None = None,
    motion: str | os.PathLike[str] | Mapping[str, Any] | Motion | None = None,
    subframes: int | None = None,
    denoise: bool = False,
    parameters: Mapping[str, Any] | None = None,
    variant: str | None = None,
    progress: Progress | None = None,
) -> Irradiance:
    """Render a scene file into the irradiance on this camera's focal plane.

    camera, exposure, seed, wavelength_nm, bandwidth_nm, spectral : what is not given is read from the scene's
        <film type="photosensor">; failing that, seed 1, bands of 10 nm over the camera's range. A camera that is given
        brings its own lens; a note says so where the scene's <sensor type="camera"> has another.
    spp : samples per pixel over all passes, 128 by default; the certificate has the number that the sampler made of it.
    noise_ratio : instead of spp, render on until the median over the pixels of the render's variance over the sensor's
        own is below it; 0.01 makes a frame 0.5 % too noisy.  max_seconds, max_spp : but no longer than that.
    wavelength_nm : one band about this wavelength; by default adjacent bands of ``bandwidth_nm`` over the camera's.
    spectral : "auto", bands with the least noise in this camera's frame; "cube", the same bands with the least noise in
        each of them, for other cameras; "channels", only what this camera's filters detect.
    scene_unit : "m", "mm", … or metres: what a length of 1 in the scene is; by default what the scene says, else 1 m.
    columns : the same view in fewer columns of pixels, and rows in proportion, as if the scene's film were so small;
        behind a prescription, whose pixels have their size, a window of it.
    motion : what moves while the shutter is open, a file or a mapping (see render/motion.py).
    subframes : instants of one exposure of what moves; by default so many that nothing moves by more than half a pixel.
    denoise : smooth the result with Open Image Denoise; its bias is measured and certified. Needs the extra "denoise".
    parameters : values for the ``<default>`` names of the scene.
    variant : a spectral Mitsuba variant; by default the one already set, else the fastest that is safe.
    progress : called with a :class:`render.stop_criterion.Step`, also once before the first pass.
    Raises InputError for anything wrong with the arguments or the scene. Ctrl-C is obeyed between passes.
    """
    started = time.monotonic()
    options = RenderOptions(
        spp, noise_ratio, max_seconds, max_spp, wavelength_nm, bandwidth_nm, spectral, scene_unit, columns,
        motion, subframes, denoise, parameters, variant,
    )  # fmt: skip
    options.budget()  # refuses before anything is loaded
    job = prepare(scene, camera, exposure, options)
    budget = options.budget(len(job.bands.groups))
    return job.irradiance(job.seed(seed), budget, progress or (lambda step: None), started)


@dataclass(frozen=True, eq=False)
class RenderOptions:
    """What may be asked of a render beside scene, camera, exposure and seed: the words of :func:`render`."""

    spp: int | None = None
    noise_ratio: float | None = None
    max_seconds: float | None = None
    max_spp: int | None = None
    wavelength_nm: float | None = None
    bandwidth_nm: float | None = None
    spectral: str | None = None
    scene_unit: str | float | None = None
    columns: int | None = None
    motion: str | os.PathLike[str] | Mapping[str, Any] | Motion | None = None
    subframes: int | None = None
    denoise: bool = False
    parameters: Mapping[str, Any] | None = None
    variant: str | None = None

    def check(self) -> None:
        """Raise InputError for words that are no use in any scene."""
        if not isinstance(self.denoise, bool):
            raise InputError(f"denoise is {self.denoise!r}; it must be True or False.")
        if self.denoise:
            library()
        if self.subframes is not None and self.motion is None:
            raise InputError(f"subframes is {self.subframes!r} and nothing moves; pass a motion, or leave it out.")
        if self.variant is not None and not isinstance(self.variant, str):
            raise InputError(f"variant is {self.variant!r}; it must be a name, e.g. 'scalar_spectral'.")

    def budget(self, groups: int = 1) -> StopCriterion:
        """How many passes, or until when, for so many groups of bands. Raises InputError."""
        return stop_criterion_of(self.spp, self.noise_ratio, self.max_seconds, self.max_spp, groups)

    def bands(self, setup: SceneSettings, camera: Camera, usual: str) -> Bands:
        """The channels asked for, else those of the scene file, else the ``usual`` ones. Raises InputError."""
        wavelength_nm = first_given(self.wavelength_nm, setup.wavelength_nm)
        spectral = first_given(self.spectral, "auto" if self.wavelength_nm else setup.spectral, "auto")
        if spectral == "auto":  # channels have no width, and no electrons in bursts
            bands = wavelength_nm is not None or self.bandwidth_nm is not None
            spectral = "auto" if bands or camera.quantum_efficiency.quantum_yield else usual
        width_nm = first_given(self.bandwidth_nm, setup.bandwidth_nm, BANDWIDTH_NM)
        return choose_bands(camera, wavelength_nm, width_nm, spectral)


@dataclass(frozen=True, eq=False)
class Job:
    """A scene, ready to be rendered for one camera and exposure as often as asked."""

    scene: Scene | MovingScene
    camera: Camera
    exposure: Exposure
    bands: Bands
    variant: Variant
    setup: SceneSettings
    renderer: Renderer
    denoise: bool
    sampler: str = SAMPLER

    def seed(self, given: int | None) -> int:
        """The seed that was given, else the scene file's, else 1. Raises InputError."""
        return require_seed("seed", first_given(given, self.setup.seed, 1))

    def irradiance(
        self, seed: int, budget: StopCriterion, progress: Progress, started: float, criterion: Criterion | None = None
    ) -> Irradiance:
        """One render. started : when it began, on the monotonic clock [s].  yardstick : see :meth:`Renderer.run`."""
        end = self.renderer.run(seed, budget, progress, criterion)
        statistics = self._certificate(budget, end, started)
        halves = self.renderer.halves() if self.denoise else None
        data, error, relative = self.renderer.result()
        if not data.any():
            raise InputError(self._black())
        bands = self.bands
        filters = tuple(self.camera.quantum_efficiency.curves) if bands.kind == "channels" else None
        column, row = self.scene.view.crop_offset
        light = Irradiance(
            data, bands.wavelengths_nm, bands.bandwidths_nm, error, relative, statistics, filters, bands.response,
            (row, column),
        )  # fmt: skip
        return light if halves is None else denoised(light, self, halves)

    def _certificate(self, budget: StopCriterion, end: End, started: float) -> RenderStatistics:
        renderer, passes = self.renderer, self.renderer.passes
        share, notes = renderer.firefly_fraction(), [*self.scene.notes, *self._overruled()]
        if budget.asked is not None and budget.asked != renderer.samples_per_pixel:
            taken = f"{budget.asked} samples per pixel asked for, {renderer.samples_per_pixel} taken"
            notes.append(f"{taken}: equal passes, each a full grid" if end == "spp" else f"{taken}: the time was up")
        if not trusted(passes, share):
            notes.append(why_not_trusted(passes, share))
        if self.variant.hint:
            notes.append(self.variant.hint)
        return RenderStatistics(
            passes=passes,
            samples_per_pixel=renderer.samples_per_pixel,
            seconds=time.monotonic() - started,
            variant=self.variant.name,
            sampler=self.sampler,
            spectral=self.bands.kind,
            **summary_of(renderer.noise_ratios(), renderer.electrons()[0] > 0, passes),
            noise_ratio_asked=budget.goal if budget.reached == "noise_ratio" else None,
            ended_by=end,
            reliable=trusted(passes, share),
            firefly_fraction=share,
            negative=renderer.negative,
            non_finite=renderer.non_finite,
            notes=tuple(notes),
            scene_sha256=self.scene.sha256,
            aperture_f_number=aperture_f_number(self.scene.view, self.camera),
            intrinsics=intrinsics(self.scene.view, self.camera),
        )

    def _overruled(self) -> list[str]:
        """A note where the camera has another value than the scene file in a field that the file sets."""
        mine, file = self.camera.model_dump(), self.setup.applied_to(self.camera).model_dump()
        fields = [name for name in self.setup.fields if _value(mine, name) != _value(file, name)]
        return [f"{', '.join(fields)} of the scene file overruled by the camera that was given"] if fields else []

    def _black(self) -> str:
        non_finite = self.renderer.non_finite
        why = f" ({non_finite} values were not finite)" if non_finite else ""
        remedy = "give it an emitter that lights what the sensor sees, with a spectrum there"
        return f"the scene is black from {self.bands.low_nm:g} to {self.bands.high_nm:g} nm{why}; {remedy}."


def prepare(
    scene: str | os.PathLike[str],
    camera: Camera | None,
    exposure: Exposure | None,
    options: RenderOptions,
    usual: str = "auto",
    *,
    sampler: str = SAMPLER,
) -> Job:
    """Check all that was asked for, read what was not from the scene file, and load the scene.

    usual : "auto" or "channels", where nobody asks for anything.  sampler : see :func:`render.scene.load_scene`; not an
    option of :func:`render`, because no other is better (benchmarks/render_passes.py).  Raises InputError.
    """
    parameters = {} if options.parameters is None else options.parameters
    check_types(camera, exposure, optional=True)
    if not isinstance(scene, str | os.PathLike):
        raise InputError(f"scene is {scene!r}; pass the path of a scene file, e.g. 'scenes/cornell_box.xml'.")
    if not isinstance(parameters, Mapping):
        raise InputError(f"parameters is {parameters!r}; pass a dict of the scene's <default> names and their values.")
    options.check()
    chosen = choose_variant(options.variant)
    use(chosen)
    setup = read_settings(scene, parameters)
    camera, exposure = _camera_and_exposure(setup, camera, exposure)
    bands = options.bands(setup, camera, usual)
    loaded: Scene | MovingScene = load_scene(
        scene, bands, parameters, camera, options.scene_unit, width=options.columns, sampler=sampler
    )
    if options.motion is not None:
        metres = unit_m(first_given(options.scene_unit, setup.unit_m, 1.0))
        loaded = MovingScene(loaded, read_motion(options.motion), camera, exposure, options.subframes, metres)
    renderer = Renderer(loaded, camera, exposure, bands, halves=options.denoise)
    return Job(loaded, camera, exposure, bands, chosen, setup, renderer, options.denoise, sampler)


def _camera_and_exposure(
    setup: SceneSettings, camera: Camera | None, exposure: Exposure | None
) -> tuple[Camera, Exposure]:
    """What was given; else what the scene file says."""
    camera = setup.camera if camera is None else camera
    exposure = setup.exposure if exposure is None else exposure
    for name, value, word in (("camera", camera, "camera"), ("exposure", exposure, "exposure_s")):
        if value is None:
            raise InputError(
                f'no {name} is given and the scene has none; pass one, or put <film type="photosensor"> with {word} '
                "into its sensor."
            )
    return camera, exposure  # type: ignore[return-value]


def _value(fields: Any, name: str) -> Any:
    """A nested field by its dotted name."""
    for part in name.split("."):
        fields = fields[part]
    return fields
