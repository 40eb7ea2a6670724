"""A scene, parsed once and loaded once, and its renders: passes → spectral irradiance and render statistics."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, Unpack, cast

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...camera.camera_file import AnyCamera, camera_of
from ...camera.exposure_times import later_exposures
from ...core import Caution, Exposure, Float64Array, InputError, first_given, warn_of
from ...core.heap import trim_heap
from ...core.options import complete, documents
from ...optics.f_number_law import solid_angle_sr
from ...optics.image_record import image_record
from ...optics.intrinsics import aperture_f_number
from ...optics.shutter import shutter_of
from ...optics.veiling_glare import glare_sentence, veiling_glare_of
from ...optics.waveform import Waveform
from ...sensor.expose import PreparedExposure
from ...sensor.metering import AUTO, AskedExposure, Metering, checked_exposure
from ...sensor.options import ExposeOptions
from ...stages.usual_range import warn_of_temperature
from ...theory.input_noise import input_noise
from ...theory.plan import prepare_planned_exposure
from ..denoise.denoise import PASSES_MIN, PIXELS_MIN, Denoised, denoise, is_noisy
from ..denoise.guides import Guides, detected_quarters, rays_for, trace_guides
from ..denoise.network import is_installed
from ..light.bands import Bands
from ..light.brightness import NOT_LUMINOUS, luminous_weights, scale_to, with_brightness
from ..light.film_channels import radiance_of, with_filters
from ..light.illuminant import rendered_for
from ..light.irradiance import Irradiance
from ..light.photons import electrons_per_irradiance, metered, photons_per_irradiance
from ..light.statistics import (
    POOLED,
    NoiseRatios,
    RenderStatistics,
    pooled,
    relative_errors,
    sum_error,
    summary_of,
    why_not_trusted,
)
from ..lint.electron_share import with_notes_of_shares
from ..lint.refusals import refuse_black
from ..motion.aovs import Aovs, aovs_of, load_for_rays
from ..motion.motion import Motion, read_motion
from ..motion.moving_scene import MovingScene, pose_m
from ..options import RenderOptions
from ..samples import SAMPLER, hashed_seed, row_strips
from ..scene.asked_groups import AskedGroups
from ..scene.light_groups import LightGroup, parts_of_light
from ..scene.parse_scene import SceneInput, parse
from ..scene.parsed_scene import ParsedScene
from ..scene.scene import Scene, load_scene
from ..scene.scene_settings import bands_asked_for
from ..variants import mitsuba, restores_variant
from .grouped import render_light_groups
from .light_of_passes import agree_with_filters, in_band_of, raw_bands
from .passes import Electrons, Passes
from .stop_criterion import (
    End,
    Progress,
    RenderProgress,
    StopCriterion,
    check_options,
    stop_criterion_of,
)
from .told import told_progress

METERING_SPP = 32  # of the render that is metered where the exposure must be known before
BRIGHTNESS_SPP = 64  # of the render that finds the scale of the light
GUIDE_SEED = 1


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
    """Render a scene file into the irradiance on this camera's focal plane.

    ::

        light = ms.render("cornell_box", "konnik_table1", ms.Exposure(0.1), width=64)
        frames = ms.expose(light, frames=16)

    camera, exposure, seed : what is not given is read from the scene's <film type="photosensor">, and so are the
        options wavelength_nm, bandwidth_nm and spectral. A camera that is given brings its own lens; a note says so
        where the scene's <sensor type="camera"> has another, or where nobody names one and konnik_table1 is taken.
        An exposure of "auto", or none anywhere, is metered: ``statistics.metering`` has what was found.
    progress : None says every ten seconds on stderr how far it is; False says nothing; a
        function is called with a :class:`render.passes.stop_criterion.RenderProgress`, also before the first pass.
    Raises InputError for anything wrong with the arguments or the scene. Ctrl-C is obeyed between passes.
    """
    started = time.monotonic()
    with told_progress(progress, "render", {}) as tell:
        prepared = prepare(scene, camera_of(camera), exposure, **options)
        stop = prepared.stop_criterion(prepared.options)
        light = prepared.render(prepared.seed(seed), stop, tell, started=started)
    warn_of(light.notes)
    return light


@dataclass(frozen=True, eq=False)
class PreparedRender:
    """A loaded scene that can be rendered for one camera and exposure as often as asked.

    metering : how the exposure is found, or was; None where it was given.  metered : whether it is known; otherwise it
        is one second, and each light has :meth:`exposure_of` its own.
    light_groups : that are rendered apart; none: all light together.  groups : of how many it is one, which may be
        black; 0 where it is the whole.
    one_exposure : whether it is of one exposure alone, also where read-outs of the camera follow each other.
    group_scenes, waveforms : of the groups where something moves, by name; the scenes for later frames.
    """

    parsed: ParsedScene
    scene: Scene | MovingScene
    camera: Camera
    exposure: Exposure
    bands: Bands
    options: RenderOptions
    motion: Motion = field(default_factory=Motion)
    metering: Metering | None = None
    metered: bool = False
    light_groups: tuple[LightGroup, ...] = ()
    groups: int = 0
    one_exposure: bool = False
    group_scenes: dict[str, Scene] = field(default_factory=dict)
    waveforms: Mapping[str, Waveform] = field(default_factory=dict)

    @property
    def at_rest(self) -> Scene:
        """The scene without its motion."""
        return self.scene if isinstance(self.scene, Scene) else self.scene.scene

    @property
    def begin_s(self) -> float:
        """When the frame begins, in the time of the motion [s]."""
        return 0.0 if isinstance(self.scene, Scene) else self.scene.begin_s

    @property
    def unit_m(self) -> float:
        """Metres per unit of the scene."""
        return self.parsed.settings.metres(self.options["scene_unit"]) or 1.0

    @cached_property
    def _solid_angle(self) -> Float64Array:
        return solid_angle_sr(self.scene.view, self.camera)

    def seed(self, given: int | None) -> int:
        """The seed that was given, else the scene file's, else 1, as this sensor has it. Raises InputError."""
        return self.parsed.seed(given)

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
    ) -> Irradiance:
        """Return the light of one render.  started : when it began, on the monotonic clock [s]."""
        began = time.monotonic() if started is None else started
        later = later_exposures(self.camera, self.exposure, self.begin_s)
        if later and isinstance(self.scene, MovingScene) and not self.one_exposure:
            return self._render_exposures(later, seed, stop, progress, began)
        if self.light_groups:
            return render_light_groups(self, seed, stop, progress, began)
        tell = progress or (lambda step: None)
        passes, end, sample_s = self._passes(seed, stop, tell)
        raw = self._behind_glare(passes.electrons())
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
        """Render until nothing more is asked for; return the passes, why they end, and the seconds of one sample in
        every pixel, without the first pass, which compiles."""
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
                    done = (passes.count - 1) * len(strips) + number
                    tell(
                        RenderProgress(
                            done, most * len(strips), ratio, time.monotonic() - began
                        )
                    )
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
        """The noise ratio that so many percent of the lit pixels stay below; infinite where none is lit yet."""
        light = self._behind_glare(passes.electrons())
        ratios = self._noise_ratios(self._exposure_for(light[0]), light, passes, passes.count)
        if not light[0].any():
            return np.inf
        return ratios["noise_ratio_median" if percentile == 50 else "noise_ratio_p95"]

    def _exposure_for(self, mean_e: Float64Array) -> Exposure:
        """The exposure of light that has so many photoelectrons in that of the render."""
        lit_e = mean_e[(mean_e > 0) & np.isfinite(mean_e)]
        if self.metering is None or self.metered or not lit_e.size:
            return self.exposure
        time_s = self.metering.time_of(lit_e, self.camera, self.exposure)
        return replace(self.exposure, time_s=time_s)

    def noise_ratio(self, exposure: Exposure, light: Electrons) -> Float64Array:
        """Render variance over sensor variance of each pixel.  light : in the exposure of the render."""
        longer = exposure.time_s / self.exposure.time_s if self.exposure.time_s else 1.0
        noise = input_noise(self.camera, exposure)
        return noise.ratio(light[0] * longer, light[1] * longer**2)

    def _noise_ratios(
        self, exposure: Exposure, light: Electrons, passes: Passes, count: int
    ) -> NoiseRatios:
        """Noise ratios of the lit pixels.  count : of the passes that measured the variance, many if pooled."""
        lit = (light[0] > 0) & ~passes.infinite
        return summary_of(self.noise_ratio(exposure, light), lit, count)

    def _behind_glare(self, light: Electrons) -> Electrons:
        """Photoelectrons behind the veiling glare of the lens."""
        glare = veiling_glare_of(self.camera, self.scene.view)
        if glare is None:
            return light
        origin = self.scene.view.crop_offset[::-1]
        return glare.of_electrons(*light, self.camera.filter_index(light[0].shape, origin))

    def _is_to_be_denoised(self, passes: Passes, before: NoiseRatios) -> bool:
        """Whether that was asked for, or nobody said otherwise and the render ends above the sensor's noise; never of
        few passes or pixels, nor where no camera sees the noise."""
        asked = self.options["denoise"]
        if asked is None:
            asked = is_installed() and before["noise_ratio_p95"] * max(self.groups, 1) > 1
        periods = self.camera.sensor.polarizer_periods
        enough = passes.infinite.size >= PIXELS_MIN * np.prod(periods)
        return bool(
            asked and enough and passes.count >= PASSES_MIN and is_noisy(*passes.electrons())
        )

    def _denoised(self, passes: Passes) -> Denoised:
        """The photoelectrons behind each filter, denoised; guided by rays where they are not traced in Python."""
        height, guides = self.scene.view.crop_size[1], None
        if not mitsuba().variant().startswith("scalar"):
            weights = electrons_per_irradiance(self.camera, self.exposure, self.bands)
            sums = passes.bands if self.bands.first_filter else passes.filters
            spectrum = (
                sums.mean.mean(axis=(0, 1), dtype=np.float64)
                * self.bands.scale[: len(self.bands)]
            )
            typical_nm = detected_quarters(weights, spectrum, self.bands.wavelengths_nm)
            rays = rays_for(passes.count * passes.samples)

            def make(seed: int, rows: tuple[int, int]) -> NDArray[np.float32]:
                return trace_guides(self.at_rest, typical_nm, seed, rays, rows)

            if isinstance(self.scene, Scene):
                values = make(GUIDE_SEED, (0, height))
            else:
                values = self.scene.averaged(make, GUIDE_SEED, (0, height))
            guides = Guides(values[..., :-3], values[..., -3:])
        trim_heap()
        factor = (passes.per_radiance * passes.unit).astype(np.float32)[..., None]
        variance = passes.filters.variance(passes.count) * factor * factor
        share = ((passes.count + 1) // 2) / passes.count
        periods = self.camera.sensor.polarizer_periods
        return denoise(passes.halves(), variance, share, guides, periods)

    def _light(
        self,
        passes: Passes,
        raw: Electrons,
        denoised: Denoised | None,
        statistics: RenderStatistics,
        keep: bool = False,
    ) -> Irradiance:
        """The irradiance of the passes.  keep : whether their sums are needed afterwards."""
        before, infinite = passes.electrons(), passes.infinite
        weights = electrons_per_irradiance(self.camera, self.exposure, self.bands)
        of_passes: Electrons = before[0], np.asarray(pooled(before[0], before[1], passes.count))
        of_filters = None
        if denoised is not None:
            factor = (passes.per_radiance * passes.unit).astype(np.float32)[..., None]
            of_filters = passes.filters.mean * factor
        data, error = raw_bands(passes, self.bands, self._solid_angle, keep)
        light = of_passes
        if denoised is not None and of_filters is not None:
            light = (
                passes.own(denoised.mean),
                np.asarray(passes.own(denoised.variance), np.float64),
            )
            gain = np.divide(
                light[0], before[0], out=np.zeros_like(before[0]), where=before[0] > 0
            )
            before_error, error_now = (
                relative_errors(mean, variance, infinite)
                for mean, variance in (of_passes, light)
            )
            relative = gain, before_error, error_now
            agree_with_filters(data, error, weights, of_filters, denoised, relative)
        glare = veiling_glare_of(self.camera, self.scene.view)
        if glare is not None:
            light = self._behind_glare(light)
            if denoised is None:
                light = light[0], np.asarray(pooled(raw[0], raw[1], passes.count), np.float64)
            glare.add_to_bands(data, error)
        data[infinite] = error[infinite] = np.inf
        names = self.camera.filter_names if self.bands.kind == "channels" else None
        return Irradiance(
            data,
            self.bands.wavelengths_nm,
            self.bands.bandwidths_nm,
            error,
            relative_errors(*light, infinite),
            statistics,
            filters=names,
            response=self.bands.response,
            polarizers=self.at_rest.polarizers,
            origin=self.scene.view.crop_offset[::-1],
            in_band=in_band_of(passes, light[0], data, weights) if self.bands.filters else None,
            pass_error=relative_errors(light[0], raw[1], infinite),
        )

    def _described(
        self,
        light: Irradiance,
        passes: Passes,
        exposure: Exposure,
        raw: Electrons,
        denoised: Denoised | None,
        began: float,
    ) -> Irradiance:
        """The light with what it was rendered for, its noise in this exposure, brightness and notes."""
        ratios, record = self._noise_ratios(exposure, raw, passes, passes.count), None
        if denoised is not None:
            record = {
                **denoised.record,
                "guided": self.parsed.variant.backend != "scalar",
                "raw_noise_ratio_median": ratios["noise_ratio_median"],
                "raw_noise_ratio_p95": ratios["noise_ratio_p95"],
            }
            found = passes.own(denoised.mean), passes.own(denoised.variance)
            ratios = self._noise_ratios(exposure, self._behind_glare(found), passes, POOLED)
        statistics = replace(
            light.statistics,
            seconds=time.monotonic() - began,
            denoised=record,
            metering=None if self.metering is None else self.metering.record(exposure),
            **ratios,
        )
        known = rendered_for(self.at_rest, self.camera, exposure, self.parsed.serial(None))
        light = replace(light, statistics=statistics, rendered_for=known)
        light = with_notes_of_shares(light, self.camera, self.at_rest.findings)
        return light if self.groups else with_brightness(light, self)

    def _statistics(
        self, passes: Passes, stop: StopCriterion, end: End, ratios: NoiseRatios, raw: Electrons
    ) -> RenderStatistics:
        """How a render came about, before it is denoised and metered."""
        samples, fireflies = passes.count * passes.samples, passes.firefly_fraction()
        doubt = why_not_trusted(passes.count, fireflies, passes.lost)
        notes = [*self.scene.notes]
        if self.parsed.settings.is_default_camera:
            notes.append(
                f"rendered for {self.camera.name}, because no camera was given and the scene names none (--camera)"
            )
        notes += self.parsed.settings.unused_note(self.camera)
        if self.camera.lens.veiling_glare > 0:
            notes.append(glare_sentence(self.camera))
        if (
            self.options["denoise"] is None
            and ratios["noise_ratio_p95"] > 1
            and not is_installed()
        ):
            notes.append(
                "not denoised: Open Image Denoise is not installed; pip install pyoidn"
            )
        notes += stop.notes(end, samples)
        notes += [Caution(doubt)] if doubt else []
        notes += [self.parsed.variant.hint] if self.parsed.variant.hint else []
        view = self.scene.view
        pose = pose_m(self.at_rest, self.motion, self.unit_m, self.begin_s)
        return RenderStatistics(
            passes=passes.count,
            samples_per_pixel=samples,
            seconds=0.0,
            variant=self.parsed.variant.name,
            sampler=SAMPLER,
            spectral=self.bands.kind,
            **ratios,
            noise_ratio_asked=stop.goal if stop.reached == "noise_ratio" else None,
            ended_by=end,
            reliable=not doubt,
            firefly_fraction=fireflies,
            negative=passes.negative,
            non_finite=passes.non_finite,
            notes=tuple(notes),
            facts=tuple(str(one) for one in self.at_rest.findings if one.level == "fact"),
            scene_sha256=self.scene.sha256,
            aperture_f_number=aperture_f_number(view, self.camera),
            intrinsics=image_record(view, self.camera),
            camera_to_world=pose.tolist(),
            sum_error=sum_error(*raw),
            motion=self.scene.time_sampling(),
        )

    def _render_exposures(
        self,
        later: Mapping[str, tuple[Exposure, float]],
        seed: int,
        stop: StopCriterion,
        progress: Progress | None,
        began: float,
    ) -> Irradiance:
        """The light of the first exposure of a frame of a camera whose read-outs follow each other, which knows that of
        the later ones; each has as many samples."""
        first, lights = replace(self, one_exposure=True), dict[str, Irradiance]()
        assert isinstance(self.scene, MovingScene)
        light = first.render(seed, stop, progress, started=began)
        for number, (name, (exposure, begin_s)) in enumerate(later.items()):
            one = first.moved_to(self.motion, begin_s, exposure, self.scene.asked_subframes)
            lights[name] = one.render(hashed_seed(seed, -4, number), stop, progress)
        return replace(light, later=lights)

    def exposure_of(self, light: Irradiance) -> Exposure:
        """The exposure of this light: what was given, or found when it was metered."""
        if (found := light.statistics.metering) is None:
            return self.exposure
        return replace(self.exposure, time_s=found["exposure_s"])

    def moved_to(
        self,
        motion: Motion,
        begin_s: float,
        exposure: Exposure,
        subframes: int | None,
        waveform: Waveform | None = None,
    ) -> PreparedRender:
        """The same scene with a motion, in a frame that begins at ``begin_s``. Raises InputError."""
        asked = self.camera, exposure, subframes, self.unit_m, begin_s, waveform
        moving = MovingScene(self.at_rest, motion, *asked)
        return replace(self, scene=moving, motion=motion, exposure=exposure, metered=True)

    def metered_first(self) -> PreparedRender:
        """The same, its exposure known: where it is to be metered, by a short render from now on. Raises InputError."""
        if self.metering is None or self.metered:
            return self
        plain = replace(self, options={**self.options, "denoise": False})
        light = plain.render(self.seed(None), stop_criterion_of({"spp": METERING_SPP}))
        return replace(self, exposure=self.exposure_of(light), metered=True)

    def at_luminance(self, luminance: float) -> PreparedRender:
        """The same with all emitters scaled, so that the picture has this median luminance [cd/m²]. Raises InputError.

        A short render finds the scale, which all frames share. It is denoised if possible: a noisy median is too low.
        """
        light = self.render(self.seed(None), stop_criterion_of({"spp": BRIGHTNESS_SPP}))
        return replace(self, bands=replace(self.bands, light_scale=scale_to(luminance, light)))

    def sensor(self, options: ExposeOptions) -> PreparedExposure:
        """The exposure of what is rendered, checked before anything is: ``.of(photons).frames()``. Seed and serial
        number are by default the scene file's, else 1. Raises InputError."""
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
        """Depth, position, normals, … of the same pixels, in a pass of their own."""
        scene = self.at_rest
        if (
            self.motion != Motion()
        ):  # a mesh that has moved and come back is off by rounding: built again
            width = self.options["width"]
            scene = load_for_rays(self.parsed, self.camera, self.unit_m, width)
        shutter = shutter_of(self.camera, self.exposure, self.begin_s)
        return aovs_of(scene, self.motion, self.unit_m, shutter)

    def of_light_group(self, group: LightGroup) -> PreparedRender:
        """The render of one group of emitters, for the same camera, exposure and bands."""
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
    """Check all that was asked for, read what was not from the scene file, and load the scene.

    usual : the value of ``spectral`` where neither the options nor the scene file ask for anything.
    No ray is traced, except where an exposure that is to be metered decides what is rendered, with a motion or a noise
    ratio: a short render at rest finds it. Raises InputError.
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
    known = asked.unit_exposure if isinstance(asked, Metering) else asked
    warn_of_temperature(known.temperature_k)
    bands = with_filters(bands_asked_for(chosen, settings, camera, usual), camera)
    groups = parts_of_light(parsed, cast(AskedGroups | None, chosen["light_groups"]), camera)
    unit, width = chosen["scene_unit"], chosen["width"]
    at_rest = load_scene(parsed, bands, {}, camera, unit, width=width)
    motion = read_motion(chosen["motion"])
    still = PreparedRender(parsed, at_rest, camera, known, bands, chosen, metering=metering)
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
