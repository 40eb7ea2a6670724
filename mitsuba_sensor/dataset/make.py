"""Makes a task: one render, exposed to every camera, and the files of each sample."""

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
from .values import OF_SCENE, PICTURE, stops_taken

QUANTILES = (0.0, 0.01, 0.5, 0.99, 1.0)
Files: TypeAlias = dict[str, bytes | Facts]
"""Contents by name; facts become JSON."""
_KEPT: dict[str, Rendered] = {}
"""The light that was rendered last, by its key and lead: further tasks may need it."""


def load_renderer() -> None:
    """Load Mitsuba and the variant that renders: seconds, or a minute on a machine with much else to do."""
    use(fastest_variant("llvm"))


def make_task(store: Store, record: Record, task: Task) -> Shard:
    """Render the light of a task, expose its samples, and commit its shard. Raises InputError and DiskFull."""
    rendered = _rendered(task)
    with durable.scratch_folder(store.shards) as folder:
        light = {}
        if task.outputs:
            light = contents_of(folder, rendered.files_of_light(folder))
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
    """Fields of the row of a sample in its shard, and its files."""
    files = rendered.files_of(sample, folder)
    facts = files["sample.json"]
    assert not isinstance(facts, bytes)
    exposed = {
        "exposed_s": facts["image"]["exposure_s"],
        "system_gain_dn_per_e": facts["system_gain_dn_per_e"],
        "black_level_dn": facts["image"]["black_level_dn"],
    }
    row = {"number": sample.number, "key": sample.key, "split": sample.split}
    row |= {"values": sample.values, "exposed": {k: float(x) for k, x in exposed.items()}}
    return row, contents_of(folder, files)


def contents_of(folder: Path, files: Files) -> dict[str, bytes]:
    """The bytes of files, and of those that were written into the folder, from which they are taken."""
    found = {
        name: x if isinstance(x, bytes) else texts.short_json(x).encode()
        for name, x in files.items()
    }
    return found | durable.taken_out(folder)


class Rendered:
    """The light of a task, rendered for the camera of its lead, ready to be exposed. Raises InputError.

    light : as all machines render it, without the seconds that it took.  seconds_per_sample : of it in every pixel.
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
        """The scene, loaded; the exposure of what is timed is metered by a short render at rest if need be."""
        use(self._parsed.variant)
        lead, asked = self.task.lead, self._exposure_of(self.task.lead)
        if is_timed(self.task):
            known = asked
            if isinstance(asked, Metering):
                at_rest: Any = {"motion": None, "subframes": None, "noise_ratio": None}
                still = {**self.options, **at_rest, "max_spp": None, "spp": METERING_SPP}
                metered = prepare(self._parsed, self._camera, asked, **still)
                known = metered.metered_first().exposure
            assert isinstance(known, Exposure)
            asked = _longer(known, lead["exposure"]["ev"])
        return prepare(self._parsed, self._camera, asked, **self.options)

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
        use(self._parsed.variant)  # a task of another camera may have been rendered between
        return self._prepared.aovs()

    def files_of_light(self, folder: Path) -> Files:
        """The files that all samples of the task share; those that are written to a path are in the folder."""
        if "aovs" in self.task.outputs:
            exr.write_aovs_exr(folder / "aovs.exr", self.aovs)
        if "irradiance" in self.task.outputs:
            exr.write_irradiance_exr(folder / "irradiance.exr", self.light)
        facts = {
            "key": self.task.light_key,
            "scene": self.task.scene,
            "config": self.task.config,
            "light": self.light_facts,
        }
        return {"view.json": {**facts, "versions": {**versions(), **made_by()}}}

    @cached_property
    def light_facts(self) -> Facts:
        """Of the render: samples, noise, projection, notes."""
        statistics = self.light.statistics.to_dict()
        del statistics["seconds"], statistics["seconds_per_sample"]
        error = self.light.relative_error[np.isfinite(self.light.relative_error)]
        median = float(np.median(error)) if error.size else None
        return {**statistics, "relative_error_median": median}

    def expose(self, sample: PlannedSample) -> tuple[Frames, np.ndarray]:
        """The frames of one sample, and its mean photoelectrons [e-]."""
        config, light = sample.config, self.light
        asked, stops = self._exposure_of(config), config["exposure"]["ev"]
        if is_timed(self.task):  # of the light, its stops included
            known = light.rendered_for
            asked, stops = known.exposure if known else self._prepared.exposure, 0
        if "lights" in config:
            light = light.with_lights(config["lights"])
        start_s = self.options.get("start_s", 0.0)
        expose = partial(collected, serial=config["serial"], start_s=start_s)
        photons, camera, exposure, _ = expose(light, self._camera_of(config), asked)
        if stops:
            photons, camera, exposure, _ = expose(light, camera, _longer(exposure, stops))
        seed, serial = seed_of(sample.pixels), config["serial"]
        options: ExposeOptions = {"serial": serial, "seed": seed, "frames": config["frames"]}
        prepared = exposure_of_photons(photons, camera, exposure, options)
        frames = Frames.exposed(self._maps.lend(prepared))
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
                "key": self.task.light_key,
                "scene": self.task.scene,
                "config": self.task.config,
            },
            "light": self.light_facts,
            "versions": {**versions(), **made_by()},
        }
        return files

    def _exposure_of(self, config: Config) -> Exposure | Metering:
        """The exposure that a sample asks for, without its stops: else the scene file's, else metered."""
        time_s, kelvin = config["exposure"]["time_s"], config["exposure"]["temperature_k"]
        settings = self._parsed.settings
        if time_s is None:
            asked = settings.exposure
            return asked if kelvin is None else replace(asked, temperature_k=kelvin)
        metering = settings.metering(kelvin)
        return metering if time_s == "auto" else Exposure(time_s, metering.temperature_k)

    def _camera_of(self, config: Config) -> Camera:
        """The camera of a sample; samples that have the same share its table."""
        key = canonical(config["camera"]), config["gain"]
        if key not in self._cameras:
            if len(self._cameras) >= CAMERAS_KEPT:
                self._cameras.clear()
            self._cameras[key] = camera_of(config)
        return self._cameras[key]

    def _error_of(self, camera: Camera) -> str:
        """The camera whose photoelectrons the standard error of the render is of."""
        known = self.light.rendered_for
        rendered_for = known.camera if known else None
        efficiency = camera.quantum_efficiency
        is_other = rendered_for is not None and rendered_for.quantum_efficiency != efficiency
        return "a detector that is flat over the band" if is_other else "this camera"


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


def _quantiles(values: np.ndarray) -> list[float]:
    return [float(x) for x in np.quantile(values, QUANTILES)]


def camera_of(config: Config) -> Camera:
    """The camera of a sample at its gain: as a dataset names it, whatever fields the scene sets."""
    return camera_from(config["camera"], "of the sample").at_gain(config["gain"])


def scene_options(task: Task) -> RenderOptions:
    """The options of the render."""
    config = task.config
    of_scene = {name: config.get(name) for name in OF_SCENE}
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


def _flat_camera(camera: Camera) -> Camera:
    """One that detects every photon of the band: light rendered for it is for all cameras of the band."""
    low, high = camera.band_nm
    flat = {"curves": {"mono": [1.0, 1.0]}, "wavelengths_nm": [low, high], "tile": None}
    return camera.replace(
        **{f"quantum_efficiency.{name}": value for name, value in flat.items()}
    )


def _longer(exposure: Exposure, stops: float) -> Exposure:
    return Exposure(exposure.time_s * 2.0**stops, exposure.temperature_k)
