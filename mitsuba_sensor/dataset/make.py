"""Makes a task: one render, exposed to every camera, and the files of each sample."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ..camera.camera import Camera
from ..camera.dual_pixels import has_several_readouts
from ..core import Exposure
from ..core.versions import versions
from ..files import durable, png, texts, tiff
from ..files.tiff import READOUTS
from ..output import exr
from ..output.dng import dng_names, write_dng
from ..output.frame_files import image_facts, preview_of
from ..output.frames import Frames
from ..output.readout_files import readout_facts, write_readouts
from ..render.light.irradiance import Irradiance
from ..render.light.light_source import CollectedLight
from ..render.light.photons import collected
from ..render.motion.aovs import Aovs
from ..render.variants import fastest_variant, use
from ..sensor.expose import exposure_of_photons
from ..sensor.kept_maps import RECENT_BYTES, KeptMaps
from ..sensor.metering import electrons_of
from ..sensor.options import ExposeOptions
from .keys import Config, Facts, key_of, made_by, seed_of
from .plan import PlannedSample, Task
from .store import Record, Shard, Store
from .task_render import TaskRender, camera_of, exposure_of, is_timed, without_times
from .values import PICTURE, stops_taken

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
        _KEPT[key] = Rendered.of(task)
    return _KEPT[key]


def _row_and_files(
    rendered: Rendered, sample: PlannedSample, folder: Path
) -> tuple[Facts, dict[str, bytes]]:
    """Fields of the row of a sample in its shard, and its files."""
    files = rendered.files_of(sample, folder)
    facts = files["sample.json"]
    assert not isinstance(facts, bytes)
    exposed = {
        "exposure_s": facts["image"]["exposure_s"],
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


@dataclass(frozen=True, eq=False)
class Rendered:
    """The light of a task, ready to be exposed.

    render : by which it came about.  seconds_per_sample : of it in every pixel.
    """

    task: Task
    light: Irradiance
    render: TaskRender
    seconds_per_sample: float = 0.0
    _maps: KeptMaps = field(default_factory=partial(KeptMaps, RECENT_BYTES))
    _cameras: dict[tuple[int, str | None], Camera] = field(default_factory=dict)

    @classmethod
    def of(cls, task: Task) -> Rendered:
        """Render it, for the camera of its first sample. Raises InputError."""
        render = TaskRender(task)
        light = render.light()
        rate = light.statistics.seconds_per_sample
        return cls(task, without_times(light), render, rate)

    @cached_property
    def aovs(self) -> Aovs:
        """Depth, position, normals, … of the same pixels."""
        return self.render.aovs()

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
        if error.size:
            median = float(np.median(error))
        else:
            median = None
        return {**statistics, "relative_error_median": median}

    @cached_property
    def start_s(self) -> float:
        """When the frames begin [s], for what moves and lamps that flicker."""
        return self.render.options.get("start_s", 0.0)

    @property
    def exposure(self) -> Exposure:
        """That the light was rendered for."""
        if self.light.rendered_for is None:
            return self.render.prepared.exposure
        return self.light.rendered_for.exposure

    def expose(self, sample: PlannedSample) -> tuple[Frames, np.ndarray]:
        """The frames of one sample, and its mean photoelectrons [e-]."""
        config, timed = sample.config, is_timed(self.task)
        camera = self._camera_of(config)
        asked = exposure_of(self.render.settings, config)
        if timed:
            asked = self.exposure
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

    def _camera_of(self, config: Config) -> Camera:
        """The camera of a sample; samples that have the same share its table."""
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


def _quantiles(values: np.ndarray) -> list[float]:
    return [float(x) for x in np.quantile(values, QUANTILES)]
