"""The samples of a dataset, grouped by the light that they share, with their keys."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from ..camera.exposure_times import later_exposures
from ..core import Exposure, InputError
from ..core.options import used
from ..files.appearing import refuse_empty
from ..files.scene_references import scene_digest
from ..files.shipped_scenes import (
    MOTION,
    NAME,
    SCENE,
    names_of_scenes,
    scenes_folder,
    shipped_file,
)
from ..files.texts import text_of_file
from ..render.motion.motion import Motion, read_motion
from ..render.options import RenderOptions
from .cameras import Cameras, VariedCamera, check_outputs, of_light
from .file import MOST_SAMPLES, OF_SCENE, DatasetFile, SceneEntry
from .keys import Config, Facts, identity, key_of, made_by
from .roots import find_below
from .splits import SplitOf
from .sweep import Combination, changes_light, combinations, count, of_kind
from .values import text_of

FORMAT = 2  # of a configuration; another one is another key
OF_VIEW = ("aovs", "irradiance")  # outputs that samples of one view share
MOST_LIGHTS = 10_000  # whose descriptions are kept
SAMPLES = ("spp", "noise_ratio", "max_spp")  # options that say how many samples a render takes
SPP = 128  # of a render that is told nothing of them
PASSED_BY = ("gain",)  # options of a render that are none of its light


@dataclass(frozen=True)
class PlannedSample:
    """One sample.  key : its name on disk.  config : what decides its pixels.  values : what varies, for people."""

    key: str
    config: Config
    values: Config
    split: str


@dataclass(frozen=True)
class PlannedView:
    """One render and all samples that are exposed to it.

    key : its name on disk.  config : what decides its light.  samples : in the order of the dataset.
    scene_file : where the scene is on this machine.
    """

    key: str
    config: Config
    outputs: tuple[str, ...]
    scene: str
    scene_file: str
    samples: tuple[PlannedSample, ...]


@dataclass(frozen=True, eq=False)
class DatasetPlan:
    """All views of a dataset file, checked.  Raises InputError.

    roots : folders below which its files may be read.  text : of the file, as it was written.
    made_by : versions of what its pixels depend on.
    """

    file: DatasetFile
    roots: Sequence[Path]
    text: str = ""
    made_by: Config = field(default_factory=made_by)
    _lights: dict[object, tuple[Facts, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (
            asked := count(self.file) * (self.file.splits.chips or 1 if self.file.splits else 1)
        ) > MOST_SAMPLES:
            raise InputError(
                f"the dataset has {asked} samples; one has at most {MOST_SAMPLES}: make several, or draw values at "
                f"random in place of every combination."
            )
        for scene in self.file.scenes:
            self._place(scene)
            self._motion(scene)
        self.splits  # noqa: B018, raises what is wrong with them

    @cached_property
    def cameras(self) -> Cameras:
        """The cameras of the file."""
        cameras = Cameras(self.file.cameras, self.roots)
        check_outputs(self.file.outputs, cameras.as_given)
        return cameras

    @cached_property
    def splits(self) -> SplitOf:
        """Which split a scene belongs to."""
        return SplitOf(self.file, self.cameras.models)

    @cached_property
    def samples(self) -> int:
        """How many samples there are."""
        combined, splits = count(self.file), self.file.splits
        if splits is None or "serial" not in self.file.varied:
            return combined * (1 if splits is None else splits.chips or 1)
        return sum(
            len(self.splits.serials(one)) for group in combinations(self.file) for one in group
        )

    def views(self) -> Iterator[PlannedView]:
        """One after the other; samples of the same light are together. Raises InputError where two are the same."""
        lights = set[bytes]()
        for group in combinations(self.file):
            found: dict[str, tuple[Config, list[PlannedSample], SceneEntry]] = {}
            for one in group:
                for serial in self.splits.serials(one):
                    (light, key), sample = self._configured(one, serial)
                    found.setdefault(key, (light, [], self.file.scenes[one.scene]))[1].append(
                        sample
                    )
            for key, (config, samples, entry) in found.items():
                self._check_new(lights, key, samples)
                outputs = tuple(name for name in OF_VIEW if name in self.file.outputs)
                own = key_of({"view": key, "outputs": outputs, "made_by": self.made_by})
                path = str(self._place(entry))
                yield PlannedView(own, config, outputs, entry.name, path, tuple(samples))

    @staticmethod
    def _check_new(lights: set[bytes], key: str, samples: Sequence[PlannedSample]) -> None:
        """Add a light to those of the dataset. Raises InputError where it was there, and for two equal samples."""
        known, times = bytes.fromhex(key), Counter(one.key for one in samples)
        twice = next((one for one in samples if times[one.key] > 1 or known in lights), None)
        if twice is not None:
            said = ", ".join(
                f"{name} {value}" for name, value in twice.values.items() if name != "pose"
            )
            raise InputError(
                f"two scenes, poses, cameras, rows or values are the same ({said}); leave one of them out, or vary "
                f"repetition for another sample of the same settings."
            )
        lights.add(known)

    def _configured(
        self, one: Combination, serial: int
    ) -> tuple[tuple[Facts, str], PlannedSample]:
        """Configuration and key of the light, and the sample."""
        values, camera = {**one.values, "serial": serial}, self.cameras.of(one)
        exposure = _exposure(values)
        light, key = self._light(one, camera, exposure)
        config = {
            "format": FORMAT,
            "view": key,
            "camera": camera.datasheet,
            "gain": camera.gain,
            "exposure": exposure,
            "serial": serial,
            "frames": values.get("frames", 1),
            "repetition": values.get("repetition", 0),
            "draw": one.draw,
            "dataset_seed": self.file.seed,
        }
        if lights := of_kind("lights", one.values):
            config["lights"] = lights
        outputs = [name for name in self.file.outputs if name not in OF_VIEW]
        pixels = identity(config, camera.key)
        own = key_of({"sample": pixels, "outputs": outputs, "made_by": self.made_by})
        said = {
            "scene": self.file.scenes[one.scene].name,
            "camera": self.cameras.name(one.camera),
            **values,
        }
        if one.pose is not None:
            said |= {"view": one.view, "pose": one.pose.model_dump()}
        return (light, key), PlannedSample(
            own, {**config, "outputs": outputs}, said, self.splits.of(one)
        )

    def _light(
        self, one: Combination, camera: VariedCamera, exposure: Config
    ) -> tuple[Facts, str]:
        """What decides the light, and its key; made once for all samples of it."""
        entry = self.file.scenes[one.scene]
        if self._is_timed(entry):
            timed = (*exposure.values(), camera.key, camera.gain)
        else:
            timed = ()
        varied = tuple((name, x) for name, x in one.values.items() if changes_light(name))
        known = one.scene, one.pose, one.camera, varied, timed
        if known not in self._lights:
            light = self._described(one, camera, exposure)
            if len(self._lights) > MOST_LIGHTS:
                self._lights.clear()
            self._lights[known] = light, key_of(light)
        return self._lights[known]

    def _described(self, one: Combination, camera: VariedCamera, exposure: Config) -> Facts:
        """Scene, pose, options of the render, and what the camera has to do with the light."""
        entry = self.file.scenes[one.scene]
        render = dict(self.file.render)
        if render.keys().isdisjoint(SAMPLES):
            render["spp"] = SPP
        options = {
            k: v
            for k, v in used(RenderOptions, render).items()
            if k not in (*OF_SCENE, *PASSED_BY) and (k, v) != ("start_s", 0.0)
        }
        parameters = {**entry.parameters, **of_kind("parameters", one.values)}
        parameters = {name: text_of(value) for name, value in parameters.items()}
        noisy: Facts = {
            "camera": camera.datasheet,
            "gain": camera.gain,
            "exposure": dict(exposure),
        }
        cube = options["spectral"] == "cube"
        motion = self._motion(entry)
        moving: Facts = {"motion": motion.model_dump(mode="json"), "exposure": dict(exposure)}
        is_metered = exposure["time_s"] in ("auto", None)
        if is_metered or later_exposures(camera.camera, Exposure(1.0)):
            moving |= noisy
        return {
            "format": FORMAT,
            "scene": scene_digest(self._place(entry), parameters, self._roots_of(entry)),
            "parameters": parameters,
            "traverse": {**entry.traverse, **of_kind("traverse", one.values)},
            "look_at": None if one.pose is None else one.pose.model_dump(),
            **{
                name: getattr(entry, name)
                for name in ("scene_unit", "integrator", "ignore_polarization")
            },
            "render": options,
            "lens": of_light(camera.camera, cube),
            "dataset_seed": self.file.seed,
            **({} if motion == Motion() else moving),
            **(noisy if options["noise_ratio"] else {}),
        }

    def _is_timed(self, entry: SceneEntry) -> bool:
        """Whether the exposure decides the light."""
        return entry.motion is not None or "noise_ratio" in self.file.render

    def _place(self, entry: SceneEntry) -> Path:
        try:
            return self._find(entry.file, SCENE, f"the file of scene {entry.name}")
        except InputError as error:
            if not NAME.fullmatch(entry.file):
                raise
            also = f"or give {names_of_scenes(entry.file)}"
            raise InputError(f"{str(error).removesuffix('.')}; {also}") from None

    def _motion(self, entry: SceneEntry) -> Motion:
        if isinstance(entry.motion, str):
            return read_motion(
                self._find(entry.motion, MOTION, f"the motion of scene {entry.name}")
            )
        return read_motion(entry.motion)

    def _roots_of(self, entry: SceneEntry) -> Sequence[Path]:
        """The folders below which a scene may read files."""
        if shipped_file(entry.file, SCENE, self.roots):
            return [scenes_folder(), *self.roots]
        return self.roots

    def _find(self, name: str, end: str, what: str) -> Path:
        """A file below the roots, else one that ships with the package."""
        return shipped_file(name, end, self.roots) or find_below(name, self.roots, what)


def _exposure(values: Config) -> Facts:
    """Time [s], "auto" or None for the scene's own; stops on top; temperature [K] or None."""
    time_s, stops, kelvin = (
        values.get(name) for name in ("exposure_s", "exposure_ev", "temperature_k")
    )
    return {"time_s": time_s, "ev": stops or 0, "temperature_k": kelvin}


def load_plan(path: str | Path, roots: Sequence[str | Path] = ()) -> DatasetPlan:
    """The plan of a dataset file; its files may be read below its own folder and the roots. Raises InputError."""
    from .file import read_dataset

    file, folders = read_dataset(path), [Path(path).parent, *roots]
    for root in folders:
        refuse_empty(root, "--root", "give the name of a folder")
        if not Path(root).is_dir():
            raise InputError(
                f"--root {root} is no folder; give one that holds scenes or cameras."
            )
    return DatasetPlan(
        file, [*map(Path, folders)], text_of_file(Path(path), "give a dataset file")
    )
