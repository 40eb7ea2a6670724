"""A scene, parsed once and loaded once, and its renders: passes → spectral irradiance and render statistics."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Unpack, cast

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
from ...theory.input_noise import input_noise
from ...theory.plan import prepare_planned_exposure
from ..denoise.network import denoised_if_possible, is_undecided
from ..light.bands import Bands
from ..light.brightness import NOT_LUMINOUS, luminous_weights, scale_to, with_brightness
from ..light.film_channels import with_filters
from ..light.illuminant import rendered_for
from ..light.irradiance import Irradiance
from ..light.photons import metered
from ..lint.electron_share import with_notes_of_shares
from ..lint.refusals import refuse_black
from ..motion.aovs import Aovs, aovs_of, load_for_rays
from ..motion.motion import Motion, read_motion
from ..motion.moving_scene import MovingScene
from ..options import RenderOptions
from ..scene.asked_groups import AskedGroups
from ..scene.light_groups import LightGroup, parts_of_light
from ..scene.parse_scene import SceneInput, parse
from ..scene.parsed_scene import ParsedScene
from ..scene.scene import Scene, load_scene
from ..scene.scene_settings import bands_asked_for
from ..variants import restores_variant
from .denoise_choice import DenoiseChoice
from .estimate import Estimate
from .exposures import render_exposures
from .grouped import render_light_groups
from .noise_goals import SensorNoise
from .passes import SAMPLER
from .render_record import statistics_of
from .renderer import Criterion, Electrons, Renderer
from .row_strip import Kept
from .statistics import (
    NoiseRatios,
    RenderStatistics,
    summary_of,
)
from .stop_criterion import (
    Progress,
    RenderProgress,
    StopCriterion,
    check_options,
    stop_criterion_of,
)
from .told import told_progress

METERING_SPP = 32  # of the render that is metered where the exposure must be known before
BRIGHTNESS_SPP = 64  # of the render that finds the scale of the light


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
    progress : None says every ten seconds on stderr how far it is, in a notebook by a bar; False says nothing; a
        function is called with a :class:`render.passes.stop_criterion.RenderProgress`, also before the first pass.
    Raises InputError for anything wrong with the arguments or the scene. Ctrl-C is obeyed between passes.
    """
    started, chosen = time.monotonic(), denoised_if_possible(complete(RenderOptions, options))
    with told_progress(progress, "render", {}) as tell:
        undecided = is_undecided(complete(RenderOptions, options))
        prepared = prepare(scene, camera_of(camera), exposure, undecided=undecided, **chosen)
        light = prepared.render(
            prepared.seed(seed), prepared.stop_criterion(chosen), tell, started=started
        )
    warn_of(light.notes)
    return light


@dataclass(frozen=True, eq=False)
class PreparedRender:
    """A loaded scene that can be rendered for one camera and exposure as often as asked.

    unit_m : metres per unit.  denoise : None where nobody has decided; not denoised then.  undecided : whether a
    forecast may leave denoising out.  raw_light : whether what is denoised is kept as it was, too.  metering : how the
    exposure is found, or was; None where it was given.  metered : whether it is known; otherwise it is one second, and
    each light has :meth:`exposure_of` its own.  light_groups : that are rendered apart; none: all light together.
    is_group : whether it is of one of these groups, which may be black.
    one_exposure : whether it is of one exposure alone, also where read-outs of the camera follow each other.
    group_scenes, waveforms : of the groups where something moves, by name; the scenes for later frames.
    """

    parsed: ParsedScene
    scene: Scene | MovingScene
    camera: Camera
    exposure: Exposure
    bands: Bands
    renderer: Renderer
    denoise: bool | None
    raw_light: bool
    width: int | None
    motion: Motion
    unit_m: float
    sampler: str = SAMPLER
    metering: Metering | None = None
    metered: bool = False
    light_groups: tuple[LightGroup, ...] = ()
    is_group: bool = False
    one_exposure: bool = False
    group_scenes: dict[str, Scene] = field(default_factory=dict)
    undecided: bool = False
    waveforms: Mapping[str, Waveform] = field(default_factory=dict)

    @property
    def _kept(self) -> Kept:
        return Kept.of(self.denoise, self.raw_light or self.undecided)

    @property
    def at_rest(self) -> Scene:
        """The scene without its motion."""
        return self.scene if isinstance(self.scene, Scene) else self.scene.scene

    @property
    def begin_s(self) -> float:
        """When the frame begins, in the time of the motion [s]."""
        return 0.0 if isinstance(self.scene, Scene) else self.scene.begin_s

    @property
    def _is_followed(self) -> bool:
        """Whether other exposures of the same frame see the scene at another time."""
        moves = isinstance(self.scene, MovingScene) and not self.one_exposure
        return moves and bool(later_exposures(self.camera, self.exposure))

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
        criterion: Criterion | None = None,
    ) -> Irradiance:
        """One render; started : when it began, on the monotonic clock [s]; criterion : see :meth:`Renderer.run`."""
        if self._is_followed:
            return render_exposures(self, seed, stop, progress, started, criterion)
        if self.light_groups:
            return render_light_groups(self, seed, stop, progress, started)
        began, renderer = time.monotonic() if started is None else started, self.renderer
        renderer.choice = DenoiseChoice(self, stop) if self.denoise and self.undecided else None
        end = renderer.run(
            seed, stop, progress or (lambda step: None), criterion or SensorNoise(self, stop)
        )
        raw, kept = renderer.electrons(), None
        if self.denoise and renderer.denoises():
            if progress is not None:
                seconds = time.monotonic() - began
                progress(
                    RenderProgress(
                        renderer.passes, renderer.passes, seconds=seconds, doing="denoising"
                    )
                )
            kept = renderer.result(keep=True) if self.raw_light else None
            renderer.denoise(last=True)
        found = renderer.result()
        if not (found.data.any() or self.is_group):
            refuse_black(self.bands.ends_nm, renderer.lost, self.at_rest.findings)
        exposure, serial = self.exposure, self.parsed.serial(None)
        light = self._irradiance(
            found, raw, statistics_of(self, stop, end, began, exposure, raw)
        )
        if self.metering is not None and not self.metered:
            exposure = metered(light, self.camera, self.metering)
            light = replace(
                light, statistics=statistics_of(self, stop, end, began, exposure, raw)
            )
        light = replace(
            light, rendered_for=rendered_for(self.at_rest, self.camera, exposure, serial)
        )
        light = with_notes_of_shares(light, self.camera, self.at_rest.findings)
        if not self.is_group:
            light = with_brightness(light, self)
        renderer.choice = None  # a cycle, which would keep the scene loaded for a while
        if kept is None or renderer.denoised is None:
            return light
        ratios = self.noise_ratios(exposure, raw, renderer.passes)
        return replace(
            light,
            raw=self._irradiance(kept, raw, replace(light.statistics, denoised=None, **ratios)),
        )

    def _irradiance(
        self, found: Estimate, raw: Electrons, statistics: RenderStatistics
    ) -> Irradiance:
        names = self.camera.filter_names if self.bands.kind == "channels" else None
        return Irradiance(
            **found._asdict(),
            wavelengths_nm=self.bands.wavelengths_nm,
            bandwidths_nm=self.bands.bandwidths_nm,
            statistics=statistics,
            filters=names,
            response=self.bands.response,
            polarizers=self.at_rest.polarizers,
            origin=self.scene.view.crop_offset[::-1],
            pass_error=self.renderer.pass_error(raw, statistics.denoised is not None),
        )

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
        renderer = Renderer(moving, self.camera, exposure, self.bands, self._kept)
        moved = replace(self, scene=moving, motion=motion, renderer=renderer)
        return replace(moved, exposure=exposure, metered=True)

    def metered_first(self) -> PreparedRender:
        """The same, its exposure known: where it is to be metered, by a short render from now on. Raises InputError."""
        if self.metering is None or self.metered:
            return self
        light = replace(self, denoise=False).render(
            self.seed(None), stop_criterion_of({"spp": METERING_SPP})
        )
        exposure = self.exposure_of(light)
        renderer = Renderer(self.scene, self.camera, exposure, self.bands, self._kept)
        return replace(self, exposure=exposure, renderer=renderer, metered=True)

    def at_luminance(self, luminance: float) -> PreparedRender:
        """The same with all emitters scaled, so that the picture has this median luminance [cd/m²]. Raises InputError.

        A short render finds the scale, which all frames share. It is denoised if possible: a noisy median is too low.
        """
        light = self.render(self.seed(None), stop_criterion_of({"spp": BRIGHTNESS_SPP}))
        bands = replace(self.bands, light_scale=scale_to(luminance, light))
        renderer = Renderer(self.scene, self.camera, self.exposure, bands, self._kept)
        return replace(self, bands=bands, renderer=renderer)

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
            scene = load_for_rays(self.parsed, self.camera, self.unit_m, self.width)
        shutter = shutter_of(self.camera, self.exposure, self.begin_s)
        return aovs_of(scene, self.motion, self.unit_m, shutter)

    def noise_ratios(
        self, exposure: Exposure, electrons: Electrons, passes: int
    ) -> NoiseRatios:
        """Render variance over sensor variance in an exposure. passes : that measured the variance, many if pooled."""
        in_pixel = electrons[0] + self.renderer.beside_e, electrons[1]
        ratio = self.noise_ratio(exposure, in_pixel)
        return summary_of(ratio, (electrons[0] > 0) & ~self.renderer.infinite(), passes)

    def noise_ratio(self, exposure: Exposure, in_pixel: Electrons) -> Float64Array:
        """The same of pixels.  in_pixel : mean photoelectrons of all light, and the variance of the render's mean."""
        (mean_e, variance_e2), known = in_pixel, exposure == self.exposure
        longer = 1.0 if known else exposure.time_s / self.exposure.time_s
        noise = self.renderer.noise if known else input_noise(self.camera, exposure)
        return noise.ratio(mean_e * longer, variance_e2 * longer**2)

    def of_light_group(self, group: LightGroup) -> PreparedRender:
        """The render of one group of emitters, for the same camera, exposure and bands."""
        at_rest = self.group_scenes.get(group.name) or load_scene(
            self.parsed,
            self.bands,
            {},
            group.camera(self.camera),
            self.unit_m,
            width=self.width,
            sampler=self.sampler,
            emitters=group.emitters,
        )
        renderer = Renderer(at_rest, self.camera, self.exposure, self.bands, self._kept)
        still = replace(self, scene=at_rest, renderer=renderer, light_groups=(), is_group=True)
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
    sampler: str = SAMPLER,
    undecided: bool = False,
    **options: Unpack[RenderOptions],
) -> PreparedRender:
    """Check all that was asked for, read what was not from the scene file, and load the scene.

    usual : the value of ``spectral`` where neither the options nor the scene file ask for anything.
    sampler : of Mitsuba; no other is better.  undecided : whether a forecast may leave out denoising.
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
    metres = settings.metres(chosen["scene_unit"]) or 1.0
    asked_groups = cast(AskedGroups | None, chosen["light_groups"])
    groups = parts_of_light(parsed, asked_groups, camera)
    at_rest = load_scene(
        parsed,
        bands,
        {},
        camera,
        chosen["scene_unit"],
        width=chosen["width"],
        sampler=sampler,
    )
    motion, kept = (
        read_motion(chosen["motion"]),
        Kept.of(chosen["denoise"], chosen["raw_light"] or undecided),
    )
    renderer = Renderer(at_rest, camera, known, bands, kept)
    asked_for = chosen["denoise"], chosen["raw_light"], chosen["width"]
    loaded = parsed, at_rest, camera, known, bands, renderer
    still = PreparedRender(
        *loaded, *asked_for, Motion(), metres, sampler, metering, undecided=undecided
    )
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
