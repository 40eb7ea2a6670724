"""Render of a scene that is parsed once and loaded once: passes → spectral irradiance and render statistics."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, Unpack, cast

import numpy as np

from ...camera.camera import Camera
from ...camera.camera_file import AnyCamera, camera_of
from ...camera.exposure_times import later_exposures
from ...core import Exposure, Float64Array, InputError, first_given, warn_of
from ...core.options import complete, documents
from ...optics.shutter import shutter_of
from ...optics.waveform import Waveform
from ...sensor.expose import PreparedExposure
from ...sensor.metering import AUTO, AskedExposure, Metering, checked_exposure
from ...sensor.options import ExposeOptions
from ...stages.usual_range import warn_of_temperature
from ...theory.plan import prepare_planned_exposure
from ..light.bands import with_filters
from ..light.brightness import NOT_LUMINOUS, luminous_weights, scale_to
from ..light.irradiance import Irradiance
from ..light.photons import metered, photons_per_irradiance
from ..lint.refusals import refuse_black
from ..load.scene import Scene, load_scene
from ..motion.aovs import Aovs, aovs_of, load_for_rays
from ..motion.moving_scene import MovingScene
from ..options import RenderOptions
from ..samples import hashed_seed, row_strips
from ..scene.asked import AskedGroups
from ..scene.light_groups import LightGroup, parts_of_light
from ..scene.motion import Motion, read_motion
from ..scene.parse_scene import SceneInput, parse
from ..scene.parsed_scene import ParsedScene
from ..scene.scene_settings import bands_asked_for
from ..variants import restores_variant
from .grouped import render_light_groups
from .loaded_render import LoadedRender
from .passes import Passes, radiance_of
from .stop_criterion import (
    End,
    Progress,
    RenderProgress,
    StopCriterion,
    check_options,
    stop_criterion_of,
    told_progress,
)

METERING_SPP = 32  # of the short render that meters an exposure which must be known in advance
BRIGHTNESS_SPP = 64  # of the short render that finds the scale of the light


@documents(RenderOptions)
@restores_variant
def render(
    scene: SceneInput | ParsedScene,
    camera: AnyCamera | None = None,
    exposure: AskedExposure | None = None,
    *,
    seed: int | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[RenderOptions],
) -> Irradiance:
    """Render a scene into the irradiance on this camera's focal plane.

    ::

        light = ms.render("cornell_box", "konnik_table1", ms.Exposure(0.1), width=64)
        frames = ms.expose(light, frames=16)

    camera, exposure, seed : defaults are those of the scene's <film type="photosensor">, as for the options
        wavelength_nm, bandwidth_nm and spectral. A camera brings its own lens; a note reports if the scene's
        <sensor type="camera"> has another lens, or if neither names a camera and konnik_table1 is used. An exposure of
        "auto", or no exposure, is metered: ``statistics.metering`` has the result.
    progress : None writes the state to stderr every ten seconds, False writes nothing. A function is called with a
        :class:`render.passes.stop_criterion.RenderProgress`, also before the first pass.
    Raises InputError for invalid arguments or scenes. Ctrl-C takes effect between passes.
    """
    started = time.monotonic()
    with told_progress(progress, "render", {}) as tell:
        prepared = prepare(scene, camera_of(camera), exposure, **options)
        stop = prepared.stop_criterion(prepared.options)
        light = prepared.render(prepared.seed(seed), stop, tell, started=started)
    warn_of(light.notes)
    return light


@dataclass(frozen=True, eq=False)
class PreparedRender(LoadedRender):
    """Loaded scene that can be rendered repeatedly for one camera and exposure."""

    def seed(self, given: int | None) -> int:
        """Return the given seed, else the seed of the scene file, else 1, for this sensor. Raises InputError."""
        return self.parsed.seed(given)

    def stop_criterion(self, options: RenderOptions) -> StopCriterion:
        """Return the stop criterion for a render of these bands."""
        return stop_criterion_of(options, len(self.bands.groups))

    def render(
        self,
        seed: int,
        stop: StopCriterion,
        progress: Progress | None = None,
        *,
        started: float | None = None,
    ) -> Irradiance:
        """Return the light of one render.  started : start on the monotonic clock [s]."""
        began = time.monotonic() if started is None else started
        later = later_exposures(self.camera, self.exposure, self.begin_s)
        if later and isinstance(self.scene, MovingScene) and not self.one_exposure:
            return self._render_exposures(later, seed, stop, progress, began)
        if self.light_groups:
            return render_light_groups(self, seed, stop, progress, began)
        tell = progress or (lambda step: None)
        passes, end, sample_s = self._passes(seed, stop, tell)
        raw = self._with_glare(passes.electrons())
        exposure = self._exposure_for(raw[0])
        before = self._noise_ratios(exposure, raw, passes, passes.count)
        denoised = None
        if self._is_to_be_denoised(passes, before):
            seconds = time.monotonic() - began
            tell(RenderProgress(passes.count, passes.count, seconds=seconds, doing="denoising"))
            denoised = self._denoised(passes)
        statistics = self._statistics(passes, stop, end, before, raw)
        statistics = replace(statistics, seconds_per_sample=sample_s)
        kept = None
        if denoised is not None and self.options["raw_light"]:
            kept = self._light(passes, raw, None, statistics, keep=True)
        light = self._light(passes, raw, denoised, statistics)
        if not (light.data.any() or self.groups):
            refuse_black(self.bands.ends_nm, passes.lost, self.at_rest.findings)
        if self.metering is not None and not self.metered:
            exposure = metered(light, self.camera, self.metering)
        light = self._described(light, passes, exposure, raw, denoised, began)
        if kept is None:
            return light
        ratios = self._noise_ratios(exposure, raw, passes, passes.count)
        statistics = replace(light.statistics, denoised=None, **ratios)
        return replace(light, raw=replace(kept, statistics=statistics))

    def _passes(
        self, seed: int, stop: StopCriterion, tell: Progress
    ) -> tuple[Passes, End, float]:
        """Render until ``stop``; return the passes, the reason for the end, and the seconds of one sample in all pixels
        (without the first pass, which compiles)."""
        view, scene = self.scene.view, self.scene
        electrons = float(
            photons_per_irradiance(
                self.camera, self.exposure, [self.bands.reference_nm], [1.0]
            )[0]
        )
        per_radiance = self._solid_angle * (electrons * self.bands.light_scale)
        tile = np.array(self.camera.tile)
        passes = Passes(self.bands, per_radiance, tile, view.crop_offset[::-1])
        groups = self.bands.groups if stop.grouped else (slice(0, len(self.bands)),)
        passes.samples = stop.samples * len(groups)
        if self.bands.kind == "cube":
            scene.restrict_wavelengths(*self.bands.ends_nm)
        strips, most = row_strips(view.crop_size, stop.samples), stop.most
        end: End | None = None
        began, first_s, ratio = time.monotonic(), 0.0, np.nan
        tell(RenderProgress(0, most * len(strips)))
        while end is None:
            if isinstance(scene, MovingScene):
                scene.begin_pass(seed, passes.count)
            passes.count += 1
            for number, rows in enumerate(strips):
                if number:
                    done, seconds = (passes.count - 1) * len(strips), time.monotonic() - began
                    tell(RenderProgress(done + number, most * len(strips), ratio, seconds))
                pass_seed = hashed_seed(seed, number, passes.count - 1)
                radiance = radiance_of(scene, self.bands, groups, pass_seed, stop.samples, rows)
                passes.add(radiance, rows[0])
            seconds = time.monotonic() - began
            first_s = first_s or seconds
            if stop.goal is not None and passes.count > 1:
                ratio = self._ratio_reached(passes, stop.percentile)
            end = stop.finished(passes.count, ratio, seconds)
            most = passes.count if end and most else most
            tell(RenderProgress(passes.count * len(strips), most * len(strips), ratio, seconds))
        later = max(passes.count - 1, 1)
        sample_s = (seconds - (first_s if passes.count > 1 else 0.0)) / later / passes.samples
        return passes, end, sample_s

    def _ratio_reached(self, passes: Passes, percentile: float) -> float:
        """Return the percentile of the noise ratio of the lit pixels; infinite if no pixel is lit yet."""
        light = self._with_glare(passes.electrons())
        ratios = self._noise_ratios(self._exposure_for(light[0]), light, passes, passes.count)
        if not light[0].any():
            return np.inf
        return ratios["noise_ratio_median" if percentile == 50 else "noise_ratio_p95"]

    def _exposure_for(self, mean_e: Float64Array) -> Exposure:
        """Return the exposure of light with ``mean_e`` photoelectrons in the exposure of the render."""
        lit_e = mean_e[(mean_e > 0) & np.isfinite(mean_e)]
        if self.metering is None or self.metered or not lit_e.size:
            return self.exposure
        time_s = self.metering.time_of(lit_e, self.camera, self.exposure)
        return replace(self.exposure, time_s=time_s)

    def _render_exposures(
        self,
        later: Mapping[str, tuple[Exposure, float]],
        seed: int,
        stop: StopCriterion,
        progress: Progress | None,
        began: float,
    ) -> Irradiance:
        """Return the light of the first exposure of a camera whose readouts follow each other, with the light of the
        later exposures in ``later``; each exposure takes the same number of samples."""
        first, lights = replace(self, one_exposure=True), dict[str, Irradiance]()
        assert isinstance(self.scene, MovingScene)
        light = first.render(seed, stop, progress, started=began)
        for number, (name, (exposure, begin_s)) in enumerate(later.items()):
            moved = first.moved_to(self.motion, begin_s, exposure, self.scene.asked_subframes)
            lights[name] = moved.render(hashed_seed(seed, -4, number), stop, progress)
        return replace(light, later=lights)

    def exposure_of(self, light: Irradiance) -> Exposure:
        """Return the exposure of this light, given or metered."""
        metering = light.statistics.metering
        if metering is None:
            return self.exposure
        return replace(self.exposure, time_s=metering["exposure_s"])

    def moved_to(
        self,
        motion: Motion,
        begin_s: float,
        exposure: Exposure,
        subframes: int | None,
        waveform: Waveform | None = None,
    ) -> PreparedRender:
        """Return the same scene with a motion, for a frame that starts at ``begin_s``. Raises InputError."""
        asked = self.camera, exposure, subframes, self.unit_m, begin_s, waveform
        moving = MovingScene(self.at_rest, motion, *asked)
        return replace(self, scene=moving, motion=motion, exposure=exposure, metered=True)

    def metered_first(self) -> PreparedRender:
        """Return the same render with a known exposure; a short render meters it if needed. Raises InputError."""
        if self.metering is None or self.metered:
            return self
        plain = replace(self, options={**self.options, "denoise": False})
        light = plain.render(self.seed(None), stop_criterion_of({"spp": METERING_SPP}))
        return replace(self, exposure=self.exposure_of(light), metered=True)

    def at_luminance(self, luminance: float) -> PreparedRender:
        """Return the same render with all emitters scaled to this median luminance [cd/m²]. Raises InputError.

        A short render finds the scale for all frames. It is denoised if possible, because a noisy median is too low.
        """
        light = self.render(self.seed(None), stop_criterion_of({"spp": BRIGHTNESS_SPP}))
        return replace(self, bands=replace(self.bands, light_scale=scale_to(luminance, light)))

    def sensor(self, options: ExposeOptions) -> PreparedExposure:
        """Return the checked exposure of this render before any light is there: ``.of(photons).frames()``. Defaults of
        seed and serial number are those of the scene file, else 1. Raises InputError."""
        (columns, rows), (column, row) = self.scene.view.crop_size, self.scene.view.crop_offset
        seeds: ExposeOptions = {
            **options,
            "seed": self.seed(options.get("seed")),
            "serial": self.parsed.serial(options.get("serial")),
        }
        return prepare_planned_exposure(
            self.camera, self.exposure, (rows, columns), (row, column), seeds
        )

    def aovs(self) -> Aovs:
        """Return depth, position, normals and other AOVs of the same pixels, from a separate pass."""
        scene = self.at_rest
        if (
            self.motion != Motion()
        ):  # a mesh that moved and returned has rounding errors: load it again
            width = self.options["width"]
            scene = load_for_rays(self.parsed, self.camera, self.unit_m, width)
        shutter = shutter_of(self.camera, self.exposure, self.begin_s)
        return aovs_of(scene, self.motion, self.unit_m, shutter)

    def of_light_group(self, group: LightGroup) -> PreparedRender:
        """Return the render of one group of emitters, for the same camera, exposure and bands."""
        at_rest = self.group_scenes.get(group.name) or load_scene(
            self.parsed,
            self.bands,
            {},
            group.camera(self.camera),
            self.unit_m,
            width=self.options["width"],
            emitters=group.emitters,
        )
        count = len(self.light_groups)
        still = replace(self, scene=at_rest, light_groups=(), groups=count)
        if isinstance(self.scene, Scene):
            return still
        self.group_scenes[group.name] = at_rest
        waveform, subframes = self.waveforms.get(group.name), self.scene.asked_subframes
        return still.moved_to(self.motion, self.begin_s, self.exposure, subframes, waveform)


def prepare(
    scene: SceneInput | ParsedScene,
    camera: Camera | None = None,
    exposure: AskedExposure | None = None,
    *,
    usual: Literal["auto", "channels"] = "auto",
    **options: Unpack[RenderOptions],
) -> PreparedRender:
    """Check the options, read missing ones from the scene file, and load the scene.

    usual : default of ``spectral`` if neither the options nor the scene file have it.
    No ray is traced, unless a metered exposure decides what is rendered (motion, light groups, noise ratio). Then a
    short render at rest finds the exposure. Raises InputError.
    """
    asked, chosen = checked_exposure(camera, exposure), complete(RenderOptions, options)
    check_options(chosen)
    parsed = scene if isinstance(scene, ParsedScene) else parse(scene, chosen)
    parsed = parsed if camera is not None else parsed.with_camera()
    settings = parsed.settings
    camera = cast(Camera, first_given(camera, settings.camera)).at_gain(chosen["gain"])
    asked = settings.metering() if asked is AUTO else first_given(asked, settings.exposure)
    parsed = parsed.in_variant_for(camera)
    metering = asked if isinstance(asked, Metering) else None
    given = asked.unit_exposure if isinstance(asked, Metering) else asked
    warn_of_temperature(given.temperature_k)
    bands = with_filters(bands_asked_for(chosen, settings, camera, usual), camera)
    groups = parts_of_light(parsed, cast(AskedGroups | None, chosen["light_groups"]), camera)
    unit, width = chosen["scene_unit"], chosen["width"]
    at_rest = load_scene(parsed, bands, {}, camera, unit, width=width)
    motion = read_motion(chosen["motion"])
    still = PreparedRender(parsed, at_rest, camera, given, bands, chosen, metering=metering)
    if chosen["luminance"] is not None:
        if luminous_weights(bands) is None:
            raise InputError(NOT_LUMINOUS)
        still = still.at_luminance(chosen["luminance"])
    if groups:
        still = replace(still.metered_first(), light_groups=groups)
    if chosen["motion"] is None:
        return still if chosen["noise_ratio"] is None else still.metered_first()
    still = still.metered_first()
    return still.moved_to(motion, chosen["start_s"], still.exposure, chosen["subframes"])
