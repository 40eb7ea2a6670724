"""Makes a view and its samples: one render, exposed to every camera, and the files of each sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from ...camera.camera import Camera
from ...camera.dual_pixels import has_several_readouts
from ...core import Exposure
from ...core.versions import versions
from ...files import png, tiff
from ...files.readout_pages import READOUTS
from ...output import exr
from ...output.dng import dng_names, write_dng
from ...output.frame_files import image_facts, preview_of
from ...output.frames import Frames
from ...output.readout_files import readout_facts, write_readouts
from ...render.light.irradiance import Irradiance
from ...render.light.light_source import CollectedLight
from ...render.light.photons import collected
from ...render.motion.aovs import Aovs
from ...render.variants import fastest_variant, use
from ...sensor.expose import exposure_of_photons
from ...sensor.kept_maps import RECENT_BYTES, KeptMaps
from ...sensor.metering import electrons_of
from ...sensor.options import ExposeOptions
from ..plan.configured import PlannedSample
from ..plan.planned import PlannedView
from ..read.previews import PICTURE, stops_taken
from ..store.keys import Config, Facts, made_by, seed_of
from ..store.store import Store
from .lights import shared_light, stored_light
from .places import Files, place_of
from .view_render import ViewRender, camera_of, exposure_of, is_timed, without_times

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
        rendered = rendered_light(store, view, told)
        if view.outputs:
            place.add_view(rendered.files_of_view)
        for sample in missing:
            told("exposing")
            place.add(sample, partial(rendered.files_of, sample))
            yield sample


def rendered_light(
    store: Store, view: PlannedView, told: Callable[[str], object] = lambda key: None
) -> Rendered:
    """The light of a view. Where several tasks have its samples, one renders it for all. Raises InputError.

    told : called with what is done now.
    """
    entry = view.light_entry
    if entry.key in _KEPT:
        return _KEPT[entry.key]
    render = ViewRender(view)
    if view.is_whole:
        told("rendering")
        light = stored_light(store, entry) or without_times(render.light())
        return Rendered(view, light, render)
    _KEPT.clear()
    light = shared_light(store, entry, told, lambda: without_times(render.light()))
    _KEPT[entry.key] = Rendered(view, light, render)
    return _KEPT[entry.key]


@dataclass(frozen=True, eq=False)
class Rendered:
    """The light of a view, ready to be exposed.

    render : by which it came about, here or in another process.  seconds_per_sample : of it in every pixel; 0 where it
    was another process.
    """

    view: PlannedView
    light: Irradiance
    render: ViewRender
    seconds_per_sample: float = 0.0
    _maps: KeptMaps = field(default_factory=partial(KeptMaps, RECENT_BYTES))
    _cameras: dict[tuple[int, str | None], Camera] = field(default_factory=dict)

    @classmethod
    def of(cls, view: PlannedView) -> Rendered:
        """Render it, for the camera of its first sample. Raises InputError."""
        render = ViewRender(view)
        light = render.light()
        rate = light.statistics.seconds_per_sample
        return cls(view, without_times(light), render, rate)

    @cached_property
    def aovs(self) -> Aovs:
        """Depth, position, normals, … of the same pixels."""
        return self.render.aovs()

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
        return self.render.options.get("start_s", 0.0)

    @property
    def exposure(self) -> Exposure:
        """That the light was rendered for."""
        if self.light.rendered_for is None:
            return self.render.prepared.exposure
        return self.light.rendered_for.exposure

    def expose(self, sample: PlannedSample) -> tuple[Frames, np.ndarray]:
        """The frames of one sample, and its mean photoelectrons [e-]."""
        config, timed = sample.config, is_timed(self.view)
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


def _quantiles(values: np.ndarray) -> list[float]:
    return [float(x) for x in np.quantile(values, QUANTILES)]
