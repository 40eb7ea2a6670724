"""Makes a task: one render, its exposure by every camera, and the files of each sample."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..camera.camera import Camera
from ..camera.camera_file import camera_from
from ..camera.dual_pixels import has_several_readouts
from ..core import Exposure
from ..core.options import complete
from ..core.versions import versions
from ..files import durable, png, texts, tiff
from ..files.tiff import READOUTS
from ..output import exr
from ..output.dng import check_dng, dng_names, write_dng
from ..output.frame_files import image_facts, preview_of, readout_facts, write_readouts
from ..output.frames import Frames
from ..render.light.illuminant import illuminant_of
from ..render.light.irradiance import Irradiance
from ..render.light.light_source import CollectedLight
from ..render.light.photons import collected
from ..render.motion.aovs import Aovs
from ..render.options import RenderOptions
from ..render.passes.prepared import METERING_SPP, PreparedRender, prepare
from ..render.scene.parse_scene import parse
from ..render.scene.parsed_scene import ParsedScene
from ..render.variants import fastest_variant, use
from ..sensor.expose import exposure_of_photons
from ..sensor.kept_maps import RECENT_BYTES, KeptMaps
from ..sensor.metering import Metering, electrons_of
from ..sensor.options import ExposeOptions
from .cameras import CAMERAS_KEPT
from .keys import Config, Facts, canonical, key_of, made_by, seed_of
from .plan import PlannedSample, Task
from .store import Record, Shard, Store
from .values import OF_SCENE, PICTURE, preview_gain

QUANTILES = (0.0, 0.01, 0.5, 0.99, 1.0)
Files: TypeAlias = dict[str, bytes | Facts]
"""Contents by name; facts become JSON."""
_KEPT: dict[str, Rendered] = {}
"""The latest light, by its key and lead: further tasks may need it."""


def load_renderer() -> None:
    """Load Mitsuba and the variant that renders: this takes seconds, or a minute on a busy machine."""
    use(fastest_variant("llvm"))


def make_task(store: Store, record: Record, task: Task) -> Shard:
    """Render the light of a task, expose its samples, and commit its shard. Raises InputError and DiskFull."""
    rendered = _rendered(task)
    with durable.scratch_folder(store.shards) as folder:
        light = contents_of(folder, rendered.files_of_light(folder)) if task.outputs else {}
        samples = (_row_and_files(rendered, sample, folder) for sample in task.samples)
        return store.commit(task.key, record, light, samples)


def _rendered(task: Task) -> Rendered:
    key = key_of({"light": task.light_key, "lead": task.lead})
    if key not in _KEPT:
        _KEPT.clear()
        _KEPT[key] = Rendered(task)
    return _KEPT[key]


def _row_and_files(
    rendered: Rendered, sample: PlannedSample, folder: Path
) -> tuple[Facts, dict[str, bytes]]:
    """Return the fields of the row of a sample in its shard, and its files."""
    files = rendered.files_of(sample, folder)
    facts: Any = files["sample.json"]
    exposed = {
        "exposed_s": facts["image"]["exposure_s"],
        "system_gain_dn_per_e": facts["system_gain_dn_per_e"],
        "black_level_dn": facts["image"]["black_level_dn"],
    }
    row = {"number": sample.number, "key": sample.key, "split": sample.split}
    row |= {"values": sample.values, "exposed": {x: float(y) for x, y in exposed.items()}}
    return row, contents_of(folder, files)


def contents_of(folder: Path, files: Files) -> dict[str, bytes]:
    """Return the bytes of files, and of the files in the folder, which are removed."""
    contents = {
        name: x if isinstance(x, bytes) else texts.short_json(x).encode()
        for name, x in files.items()
    }
    return contents | durable.taken_out(folder)


class Rendered:
    """The light of a task, rendered for the camera of its lead, ready to be exposed. Raises InputError.

    light : as all machines render it, without its render time.  seconds_per_sample : of the light in every pixel.
    """

    def __init__(self, task: Task) -> None:
        self.task, self.options = task, scene_options(task)
        self._parsed = parsed_scene(task, self.options)
        self._is_cube = task.config["render"]["spectral"] == "cube"
        self._camera = camera_of(task.lead)
        if self._is_cube:
            self._camera = _flat_camera(self._camera)
        self._prepared = self._prepare()
        light = self._light()
        self.seconds_per_sample = light.statistics.seconds_per_sample
        timeless = replace(light.statistics, seconds=0.0, seconds_per_sample=0.0)
        self.light = replace(light, statistics=timeless)
        self._maps = KeptMaps(RECENT_BYTES)
        self._cameras: dict[tuple[str, str | None], Camera] = {}

    def _prepare(self) -> PreparedRender:
        """Return the loaded scene; a short render at rest meters the exposure of what is timed, if needed."""
        use(self._parsed.variant)
        lead, exposure = self.task.lead, self._exposure_of(self.task.lead)
        if is_timed(self.task):
            if isinstance(exposure, Metering):
                at_rest: Any = {"motion": None, "subframes": None, "noise_ratio": None}
                still = {**self.options, **at_rest, "max_spp": None, "spp": METERING_SPP}
                metered = prepare(self._parsed, self._camera, exposure, **still)
                exposure = metered.metered_first().exposure
            assert isinstance(exposure, Exposure)
            exposure = _longer(exposure, lead["exposure"]["ev"])
        return prepare(self._parsed, self._camera, exposure, **self.options)

    def _light(self) -> Irradiance:
        prepared = self._prepared
        if "dng" in self.task.lead["outputs"]:
            columns, rows = prepared.scene.view.crop_size
            check_dng(camera_of(self.task.lead), (rows, columns))
        stop = prepared.stop_criterion(complete(RenderOptions, self.options))
        light = prepared.render(seed_of(key_of(self.task.config)), stop)
        if not self._is_cube or light.rendered_for is None:
            return light
        illuminant = illuminant_of(prepared.at_rest, self._camera.band_nm[1])
        for_filters = replace(light.rendered_for, illuminant=illuminant)
        return replace(light, rendered_for=for_filters)

    @cached_property
    def aovs(self) -> Aovs:
        """Depth, position, normals, … of the same pixels."""
        use(self._parsed.variant)  # a task of another camera may have been rendered meanwhile
        return self._prepared.aovs()

    def files_of_light(self, folder: Path) -> Files:
        """Return the files that all samples of the task share, except the files written into the folder."""
        if "aovs" in self.task.outputs:
            exr.write_aovs_exr(folder / "aovs.exr", self.aovs)
        if "irradiance" in self.task.outputs:
            exr.write_irradiance_exr(folder / "irradiance.exr", self.light)
        made_with = {**versions(), **made_by()}
        return {"view.json": {**self._view, "light": self.light_facts, "versions": made_with}}

    @cached_property
    def _view(self) -> Facts:
        task = self.task
        return {"key": task.light_key, "scene": task.scene, "config": task.config}

    @cached_property
    def light_facts(self) -> Facts:
        """Facts on the render: samples, noise, projection, notes."""
        statistics = self.light.statistics.to_dict()
        del statistics["seconds"], statistics["seconds_per_sample"]
        error = self.light.relative_error[np.isfinite(self.light.relative_error)]
        median = float(np.median(error)) if error.size else None
        return {**statistics, "relative_error_median": median}

    def expose(self, sample: PlannedSample) -> tuple[Frames, np.ndarray]:
        """Return the frames of one sample, and its mean photoelectrons [e-]."""
        config, light = sample.config, self.light
        asked, stops = self._exposure_of(config), config["exposure"]["ev"]
        if is_timed(self.task):  # the exposure of the light includes its stops
            rendered_for = light.rendered_for
            asked = rendered_for.exposure if rendered_for else self._prepared.exposure
            stops = 0
        if "lights" in config:
            light = light.with_lights(config["lights"])
        start_s, serial = self.options.get("start_s", 0.0), config["serial"]
        expose = partial(collected, serial=serial, start_s=start_s)
        photons, camera, exposure, _ = expose(light, self._camera_of(config), asked)
        if stops:
            photons, camera, exposure, _ = expose(light, camera, _longer(exposure, stops))
        seed = seed_of(sample.pixels)
        options: ExposeOptions = {"serial": serial, "seed": seed, "frames": config["frames"]}
        prepared = exposure_of_photons(photons, camera, exposure, options)
        frames = Frames.exposed(self._maps.lend(prepared))
        self._maps.drop()
        return frames, electrons_of(photons, camera, exposure).astype(np.float32)

    def files_of(self, sample: PlannedSample, folder: Path) -> Files:
        """Return the files of one sample, except the files written into the folder."""
        config, outputs = sample.config, sample.config["outputs"]
        frames, electrons = self.expose(sample)
        files: Files = {}
        for name in outputs:
            files |= _files_of_output(folder, name, frames, electrons)
        if "preview" in outputs:
            image = preview_of(frames, gain=preview_gain(config["exposure"]["ev"]))
            files[PICTURE] = png.png(image)
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
            "view": self._view,
            "light": self.light_facts,
            "versions": {**versions(), **made_by()},
        }
        return files

    def _exposure_of(self, config: Config) -> Exposure | Metering:
        """Return the exposure of a sample without its stops: as given, else the scene file's, else metered."""
        time_s, kelvin = config["exposure"]["time_s"], config["exposure"]["temperature_k"]
        settings = self._parsed.settings
        if time_s is None:
            own = settings.exposure
            return own if kelvin is None else replace(own, temperature_k=kelvin)
        metering = settings.metering(kelvin)
        return metering if time_s == "auto" else Exposure(time_s, metering.temperature_k)

    def _camera_of(self, config: Config) -> Camera:
        """Return the camera of a sample; samples with the same camera share its table."""
        key = canonical(config["camera"]), config["gain"]
        if key not in self._cameras:
            if len(self._cameras) >= CAMERAS_KEPT:
                self._cameras.clear()
            self._cameras[key] = camera_of(config)
        return self._cameras[key]

    def _error_of(self, camera: Camera) -> str:
        """Return which camera's photoelectrons the standard error of the render is for."""
        rendered_for = self.light.rendered_for and self.light.rendered_for.camera
        efficiency = camera.quantum_efficiency
        if rendered_for and rendered_for.quantum_efficiency != efficiency:
            return "a detector that is flat over the band"
        return "this camera"


def _files_of_output(folder: Path, output: str, frames: Frames, electrons: np.ndarray) -> Files:
    """Return the files of one output of a sample, by name; DNGs and readouts are written into the folder."""
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
    """Return the noise budget, source by source [DN]; with several readouts, the budget of each by its name."""
    if frames.camera.readouts:
        return {"readouts": {name: budget(x) for name, x in frames.readouts.items()}}
    names = "source", "mean_dn", "rms_dn", "temporal_dn2", "spatial_dn2"
    entries = frames.noise_budget().entries
    return {"sources": [{name: getattr(x, name) for name in names} for x in entries]}


def _quantiles(values: np.ndarray) -> list[float]:
    return [float(x) for x in np.quantile(values, QUANTILES)]


def camera_of(config: Config) -> Camera:
    """Return the camera of a sample at its gain: as the dataset names it, whatever fields the scene sets."""
    return camera_from(config["camera"], "of the sample").at_gain(config["gain"])


def scene_options(task: Task) -> RenderOptions:
    """Return the options of the render."""
    config = task.config
    of_scene = {name: config.get(name) for name in OF_SCENE}
    if "start_s" in config:
        of_scene["start_s"] = config["start_s"]
    of_scene["traverse"] = of_scene["traverse"] or None
    decided = {"denoise": bool(config["render"].get("denoise")), "repeatable": True}
    return {**config["render"], **of_scene, **decided}  # type: ignore[typeddict-item]


def parsed_scene(task: Task, options: RenderOptions) -> ParsedScene:
    """Parse the scene of a task, and set the variant for its camera. Raises InputError."""
    use(fastest_variant("llvm"))  # whatever is set: CUDA adds in any order
    return parse(task.scene_file, options).in_variant_for(camera_of(task.lead))


def is_timed(task: Task) -> bool:
    """Return True if the exposure time decides the light: something moves, or a noise ratio is requested."""
    return "motion" in task.config or bool(task.config["render"]["noise_ratio"])


def _flat_camera(camera: Camera) -> Camera:
    """Return a camera that detects every photon of the band: its light is for all cameras of the band."""
    low, high = camera.band_nm
    flat = {"curves": {"mono": [1.0, 1.0]}, "wavelengths_nm": [low, high], "tile": None}
    return camera.replace(**{f"quantum_efficiency.{x}": value for x, value in flat.items()})


def _longer(exposure: Exposure, stops: float) -> Exposure:
    return Exposure(exposure.time_s * 2.0**stops, exposure.temperature_k)
