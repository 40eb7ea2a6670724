"""Makes a view and its samples: one render, exposed to every camera, and the files of each sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from ...camera.camera import Camera
from ...camera.camera_file import camera_from
from ...camera.dual_pixels import has_several_readouts
from ...core import Exposure
from ...core.options import complete
from ...core.versions import versions
from ...files import png, tiff
from ...files.readout_pages import READOUTS
from ...output import exr
from ...output.dng import check_dng, dng_names, write_dng
from ...output.frame_files import image_facts, preview_of
from ...output.frames import Frames
from ...output.readout_files import readout_facts, write_readouts
from ...render.light.illuminant import illuminant_of
from ...render.light.irradiance import Irradiance
from ...render.light.light_source import CollectedLight
from ...render.light.photons import collected
from ...render.motion.aovs import Aovs
from ...render.options import RenderOptions
from ...render.passes.prepared import METERING_SPP, PreparedRender, prepare
from ...render.scene.scene_settings import ParsedScene, SceneSettings, parse
from ...render.variants import fastest_variant, use
from ...sensor.expose import exposure_of_photons
from ...sensor.kept_maps import RECENT_BYTES, KeptMaps
from ...sensor.metering import Metering, electrons_of
from ...sensor.options import ExposeOptions
from ..plan.configured import PlannedSample
from ..plan.planned import PlannedView
from ..read.previews import PICTURE, stops_taken
from ..store.keys import Config, Facts, key_of, made_by, seed_of
from ..store.store import Store
from .places import Files, place_of

QUANTILES = (0.0, 0.01, 0.5, 0.99, 1.0)
_KEPT: dict[str, Rendered] = {}
"""Key → the last light of which other samples may follow."""


def load_renderer() -> None:
    """Load Mitsuba and the variant that renders: seconds, or a minute on a machine with much else to do."""
    use(fastest_variant("llvm"))


def make_view(
    store: Store, view: PlannedView, told: Callable[[str], object] = lambda key: None
) -> Iterator[PlannedSample]:
    """Render the view and commit what is missing of it. Yields each sample when it is there. Raises InputError.

    told : called with what is done now.
    """
    with place_of(store, view) as place:
        missing = place.missing()
        if not missing and not place.lacks_view():
            return
        told("rendering")
        rendered = rendered_light(view)
        if view.outputs:
            place.add_view(rendered.files_of_view)
        for sample in missing:
            told("exposing")
            place.add(sample, partial(rendered.files_of, sample))
            yield sample


def rendered_light(view: PlannedView) -> Rendered:
    """The light of a view. Where several tasks have its samples, it is kept for the next one. Raises InputError."""
    if view.whole:
        return Rendered.of(view)
    if view.key not in _KEPT:
        _KEPT.clear()
        _KEPT[view.key] = Rendered.of(view)
    return _KEPT[view.key]


@dataclass(frozen=True, eq=False)
class Rendered:
    """The light of a view, ready to be exposed.

    settings : what the scene file says of camera and exposure.  seconds_per_sample : of the render, in every pixel.
    """

    view: PlannedView
    prepared: PreparedRender
    light: Irradiance
    settings: SceneSettings
    seconds_per_sample: float
    _maps: KeptMaps = field(default_factory=partial(KeptMaps, RECENT_BYTES))
    _cameras: dict[tuple[int, str | None], Camera] = field(default_factory=dict)

    @classmethod
    def of(cls, view: PlannedView) -> Rendered:
        """Render it, for the camera of its first sample. Raises InputError."""
        config, options, lead = view.config, scene_options(view), view.lead
        parsed = parse(view.scene_file, options)
        camera = camera_of(lead)
        if config["render"]["spectral"] == "cube":
            camera = flat_camera(camera)
        asked, stops = exposure_of(parsed.settings, lead), lead["exposure"]["ev"]
        if is_timed(view):
            asked = _timed(parsed, camera, asked, stops, options)
        seed = seed_of(key_of(config))
        prepared = prepare(parsed, camera, asked, **options)
        if any("dng" in sample.config["outputs"] for sample in view.samples):
            columns, rows = prepared.scene.view.crop_size
            check_dng(camera_of(lead), (rows, columns))
        light = prepared.render(seed, prepared.stop_criterion(complete(RenderOptions, options)))
        if (
            config["render"]["spectral"] == "cube" and light.rendered_for is not None
        ):  # for cameras with filters too
            known = replace(
                light.rendered_for,
                illuminant=illuminant_of(prepared.at_rest, camera.band_nm[1]),
            )
            light = replace(light, rendered_for=known)
        still = replace(
            light.statistics, seconds=0.0, seconds_per_sample=0.0
        )  # a file has no times: it is repeatable
        rate = light.statistics.seconds_per_sample
        return cls(view, prepared, replace(light, statistics=still), parsed.settings, rate)

    @cached_property
    def aovs(self) -> Aovs:
        """Depth, position, normals, … of the same pixels."""
        return self.prepared.aovs()

    def files_of_view(self, folder: Path) -> Files:
        """The files that all samples of the view share; those that are written to a path are in the folder."""
        if "aovs" in self.view.outputs:
            exr.write_aovs_exr(folder / "aovs.exr", self.aovs)
        if "irradiance" in self.view.outputs:
            exr.write_irradiance_exr(folder / "irradiance.exr", self.light)
        facts = {
            "key": self.view.key,
            "scene": self.view.scene,
            "config": self.view.config,
            "light": self.light_facts,
        }
        return {"view.json": {**facts, "versions": {**versions(), **made_by()}}}

    @cached_property
    def light_facts(self) -> Facts:
        """Of the render: samples, noise, projection, notes."""
        statistics = self.light.statistics.to_dict()
        del statistics["seconds"], statistics["seconds_per_sample"]
        error = self.light.relative_error[np.isfinite(self.light.relative_error)]
        if error.size:
            median = float(np.median(error))
        else:
            median = None
        return {**statistics, "relative_error_median": median}

    @cached_property
    def start_s(self) -> float:
        """When the frames begin [s], for what moves and lamps that flicker."""
        return scene_options(self.view).get("start_s", 0.0)

    def expose(self, sample: PlannedSample) -> tuple[Frames, np.ndarray]:
        """The frames of one sample, and its mean photoelectrons [e-]."""
        config, timed = sample.config, is_timed(self.view)
        camera = self._camera_of(config)
        asked = self.prepared.exposure if timed else exposure_of(self.settings, config)
        light = self.light
        if "lights" in config:
            light = light.with_lights(config["lights"])
        expose = partial(collected, serial=config["serial"], start_s=self.start_s)
        photons, camera, exposure, _ = expose(light, camera, asked)
        if config["exposure"]["ev"] and not timed:
            longer = Exposure(
                exposure.time_s * 2.0 ** config["exposure"]["ev"], exposure.temperature_k
            )
            photons, camera, exposure, _ = expose(light, camera, longer)
        seed, serial = seed_of(sample.pixels), config["serial"]
        options: ExposeOptions = {"serial": serial, "seed": seed, "frames": config["frames"]}
        chip = id(config["camera"]), config["gain"], serial
        prepared = exposure_of_photons(photons, camera, exposure, options)
        frames = Frames.exposed(self._maps.lend(prepared, chip))
        self._maps.drop()
        return frames, electrons_of(photons, camera, exposure).astype(np.float32)

    def files_of(self, sample: PlannedSample, folder: Path) -> Files:
        """The files of one sample; those that are written to a path are in the folder."""
        config, outputs = sample.config, sample.config["outputs"]
        frames, electrons = self.expose(sample)
        files: Files = {}
        for name in outputs:
            files |= _files_of_output(folder, name, frames, electrons)
        if "preview" in outputs:  # as bright as without the stops that were taken away
            picture = preview_of(frames, gain=stops_taken(config["exposure"]["ev"]))
            files[PICTURE] = png.png(picture)
        files["sample.json"] = {
            "key": sample.key,
            "values": sample.values,
            "camera": frames.camera.name,
            "seeds": {"seed": seed_of(sample.pixels), "serial": config["serial"]},
            "image": image_facts(frames),
            "readouts": readout_facts(frames),
            "system_gain_dn_per_e": frames.camera.system_gain_dn_per_e,
            "digital_quantiles_dn": _quantiles(frames.digital),
            "electrons_quantiles_e": _quantiles(electrons),
            "electrons_error_of": self._error_of(frames.camera),
            "config": config,
            "view": {
                "key": self.view.key,
                "scene": self.view.scene,
                "config": self.view.config,
            },
            "light": self.light_facts,
            "versions": {**versions(), **made_by()},
        }
        return files

    def _camera_of(self, config: Config) -> Camera:
        """The camera of a sample; samples of the view that have the same share its table."""
        key = id(config["camera"]), config["gain"]
        if key not in self._cameras:
            self._cameras[key] = camera_of(config)
        return self._cameras[key]

    def _error_of(self, camera: Camera) -> str:
        """The camera whose photoelectrons the standard error of the render is of."""
        known = self.light.rendered_for
        same = (
            known is None
            or known.camera is None
            or known.camera.quantum_efficiency == camera.quantum_efficiency
        )
        if same:
            return "this camera"
        return "a detector that is flat over the band"


def _files_of_output(folder: Path, output: str, frames: Frames, electrons: np.ndarray) -> Files:
    """The files of one output of a sample, by name; DNGs and read-outs are written into the folder."""
    if output == "raw":
        return {"frame.tiff": tiff.tiff_bytes(frames.digital, image_facts(frames))}
    if output == "readouts" and has_several_readouts(frames.camera):
        write_readouts(folder / READOUTS, frames, image_facts(frames)["cfa_pattern"])
    elif output == "companded" and frames.companded is not None:
        return {"companded.tiff": tiff.tiff_bytes(frames.companded)}
    elif output == "dng":
        for number, name in enumerate(dng_names(frames)):
            write_dng(folder / name, frames, number)
    elif output == "clean":
        return {"clean.tiff": tiff.tiff_bytes(frames.clean)}
    elif output == "variance":
        return {"temporal_variance.tiff": tiff.tiff_bytes(frames.temporal_variance)}
    elif output == "electrons":
        source = frames.light.source
        assert isinstance(source, CollectedLight)
        relative = source.light.relative_error
        error = np.where(electrons > 0, relative * electrons, 0).astype(np.float32)
        mean, deviation = tiff.tiff_bytes(electrons), tiff.tiff_bytes(error)
        return {"electrons.tiff": mean, "electrons_error.tiff": deviation}
    elif output == "noise_budget":
        return {"noise_budget.json": budget(frames)}
    return {}


def budget(frames: Frames) -> Facts:
    """The noise budget, source by source [DN]; of several read-outs that of each by its name."""
    if frames.camera.readouts:
        return {"readouts": {name: budget(one) for name, one in frames.readouts.items()}}
    names = "source", "mean_dn", "rms_dn", "temporal_dn2", "spatial_dn2"
    return {
        "sources": [
            {name: getattr(one, name) for name in names}
            for one in frames.noise_budget().entries
        ]
    }


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


def scene_options(view: PlannedView) -> RenderOptions:
    """The options of the render."""
    config = view.config
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
    variant = fastest_variant("llvm").name  # whatever is set: CUDA adds in any order
    return {**config["render"], **of_scene, "repeatable": True, "variant": variant}  # type: ignore[typeddict-item]


def is_timed(view: PlannedView) -> bool:
    """Whether the exposure time decides the light: where something moves, or a noise ratio is asked for."""
    return "motion" in view.config or bool(view.config["render"]["noise_ratio"])


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


def _quantiles(values: np.ndarray) -> list[float]:
    return [float(x) for x in np.quantile(values, QUANTILES)]
