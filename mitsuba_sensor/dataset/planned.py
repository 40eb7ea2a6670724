"""The samples of a dataset, grouped by the light that they share, with their keys."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from ..core import Exposure, InputError
from ..core.options import used
from ..io import files
from ..io.durable import sha256_of
from ..io.texts import text_of_file
from ..render.motion import Motion, read_motion
from ..render.options import RenderOptions
from ..sensor.camera import Camera
from ..sensor.camera_file import list_cameras, load_camera
from .file import OF_SCENE, DatasetFile, SceneEntry
from .keys import Config, Facts, canonical, key_of
from .roots import find_below
from .splits import SplitOf
from .sweep import Combination, combinations, count

FORMAT = 1  # of a configuration; another one is another key
OF_VIEW = ("aovs", "irradiance")  # outputs that samples of one view share
MAY_BE_FILES = ("lens.prescription", "quantum_efficiency.file")
CAMERA_FIELDS = {"f_number": "lens.f_number", "focus_m": "lens.focus_m"}
SPP = 128  # of a render that is told nothing: passes of 16 samples, and denoised
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
    """

    file: DatasetFile
    roots: Sequence[Path]
    text: str = ""
    _cameras: dict[str, Camera] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for scene in self.file.scenes:
            find_below(scene.file, self.roots, f"the file of scene {scene.name}")
            self._motion(scene)
        for number in range(len(self.file.cameras)):
            self._entry_camera(number)
        self.splits  # noqa: B018, raises what is wrong with them

    @cached_property
    def splits(self) -> SplitOf:
        """Which split a scene belongs to."""
        return SplitOf(self.file, [self._entry_camera(number).name for number in range(len(self.file.cameras))])

    @cached_property
    def samples(self) -> int:
        """How many samples there are."""
        combined, splits = count(self.file), self.file.splits
        if splits is None or "serial" not in self.file.varied:
            return combined * (1 if splits is None else splits.chips or 1)
        return sum(len(self.splits.serials(one)) for group in combinations(self.file) for one in group)

    def views(self) -> Iterator[PlannedView]:
        """One after the other; samples of the same light are together."""
        for group in combinations(self.file):
            found: dict[str, tuple[Config, list[PlannedSample], Combination]] = {}
            for one in group:
                for serial in self.splits.serials(one):
                    light, sample = self._configured(one, serial)
                    found.setdefault(canonical(light), (light, [], one))[1].append(sample)
            for config, samples, one in found.values():
                yield self._view(config, samples, one)

    def _view(self, light: Config, samples: list[PlannedSample], one: Combination) -> PlannedView:
        entry = self.file.scenes[one.scene]
        outputs = tuple(name for name in OF_VIEW if name in self.file.outputs)
        path = find_below(entry.file, self.roots, f"the file of scene {entry.name}")
        return PlannedView(
            key_of({"view": key_of(light), "outputs": outputs}), light, outputs, entry.name, str(path), tuple(samples)
        )

    def _configured(self, one: Combination, serial: int) -> tuple[Facts, PlannedSample]:
        """Configurations of the light and of the sample."""
        values = {**one.values, "serial": serial}
        camera, set_fields = self._camera(one)
        exposure = self._exposure(values)
        light = self._light(one, camera, exposure)
        config = {
            "format": FORMAT,
            "view": key_of(light),
            "camera": _datasheet(camera),
            "set": set_fields,
            "gain": values.get("gain"),
            "exposure": exposure,
            "serial": serial,
            "frames": self._frames(values),
            "repetition": values.get("repetition", 0),
            "draw": one.draw,
            "dataset_seed": self.file.seed,
        }
        outputs = [name for name in self.file.outputs if name not in OF_VIEW]
        key = key_of({"sample": key_of(config), "outputs": outputs})
        said = {"scene": self.file.scenes[one.scene].name, "camera": self._name(one.camera), **values}
        said |= {} if one.view is None else {"view": one.view.model_dump()}
        return light, PlannedSample(key, {**config, "outputs": outputs}, said, self.splits.of(one))

    def _light(self, one: Combination, camera: Camera, exposure: Config) -> Facts:
        """What decides the light: scene, pose, options of the render, and what the camera has to do with it."""
        entry = self.file.scenes[one.scene]
        render: Facts = {"spp": SPP} if not {"spp", "noise_ratio"} & set(self.file.render) else {}
        render = {**render, **self.file.render}
        options = {k: v for k, v in used(RenderOptions, render).items() if k not in (*OF_SCENE, *PASSED_BY)}
        parameters = {**entry.parameters, **_of("parameters", one.values)}
        motion = self._motion(entry)
        moving = {} if motion == Motion() else {"motion": motion.model_dump(mode="json"), "exposure": dict(exposure)}
        noisy = {"camera": _datasheet(camera), "gain": one.values.get("gain"), "exposure": dict(exposure)}
        noisy = noisy if options["noise_ratio"] else {}
        return {
            "format": FORMAT,
            "scene": self._digest(entry),
            "parameters": {name: str(value) for name, value in parameters.items()},
            "traverse": {**entry.traverse, **_of("traverse", one.values)},
            "look_at": None if one.view is None else one.view.model_dump(),
            **{name: getattr(entry, name) for name in ("scene_unit", "integrator", "ignore_polarization")},
            "render": options,
            "lens": _of_light(camera, options["spectral"] == "cube"),
            "dataset_seed": self.file.seed,
            **moving,
            **noisy,
        }

    def _digest(self, entry: SceneEntry) -> str:
        return sha256_of(find_below(entry.file, self.roots, f"the file of scene {entry.name}"))

    def _motion(self, entry: SceneEntry) -> Motion:
        if isinstance(entry.motion, str):
            return read_motion(find_below(entry.motion, self.roots, f"the motion of scene {entry.name}"))
        return read_motion(entry.motion)

    def _exposure(self, values: Config) -> Facts:
        """Time [s], "auto" or None for the scene's own; stops on top; temperature [K] or None. Raises InputError."""
        time_s, stops, kelvin = (values.get(name) for name in ("exposure_s", "exposure_ev", "temperature_k"))
        _number("exposure_ev", stops)
        if time_s != "auto":
            _number("exposure_s", time_s)
        Exposure(0.0 if time_s in (None, "auto") else time_s, 298.15 if kelvin is None else kelvin)
        return {"time_s": time_s, "ev": stops or 0, "temperature_k": kelvin}

    def _frames(self, values: Config) -> int:
        frames = values.get("frames", 1)
        if not isinstance(frames, int) or isinstance(frames, bool) or not 1 <= frames <= 65535:
            raise InputError(f"frames is {frames!r}; it must be a whole number from 1 to 65535, e.g. 8.")
        return frames

    def _name(self, number: int) -> str:
        return self.file.cameras[number].name or self._entry_camera(number).name

    def _entry_camera(self, number: int) -> Camera:
        """The camera of an entry, before anything varies."""
        entry = self.file.cameras[number]
        if f"{number}" not in self._cameras:
            where = f"camera {entry.camera}"
            shipped = entry.camera in list_cameras()
            camera = load_camera(entry.camera if shipped else find_below(entry.camera, self.roots, where))
            changes = self._checked_files(entry.set, where)
            camera = camera.replace(**changes) if changes else camera
            self._cameras[f"{number}"] = camera.without(*entry.without)
        return self._cameras[f"{number}"]

    def _camera(self, one: Combination) -> tuple[Camera, list[str]]:
        """The camera with all that varies in it, before its gain, which is checked; and the fields that were set."""
        varied = {field: one.values[name] for name, field in CAMERA_FIELDS.items() if name in one.values}
        varied |= self._checked_files(_of("camera", one.values), "the camera")
        gain, entry = one.values.get("gain"), self.file.cameras[one.camera]
        name = canonical({"entry": one.camera, "varied": varied, "gain": gain})
        if name not in self._cameras:
            camera = self._entry_camera(one.camera)
            self._cameras[name] = camera.replace(**varied) if varied else camera
            self._cameras[name].at_gain(gain)
        return self._cameras[name], sorted({*entry.set, *varied})

    def _checked_files(self, changes: Config, where: str) -> Facts:
        """The same; fields that name files, with their place below a root."""
        found = dict(changes)
        for name in MAY_BE_FILES:
            value = found.get(name)
            if isinstance(value, str) and ("/" in value or "." in value):
                found[name] = str(find_below(value, self.roots, f"{name} of {where}"))
        return found


def _of(kind: str, values: Config) -> Facts:
    """Values of ``kind.NAME`` by NAME."""
    return {name.partition(".")[2]: x for name, x in values.items() if name.startswith(f"{kind}.")}


def _datasheet(camera: Camera) -> Facts:
    """The numbers of a camera, without what is written for people."""
    return camera.model_dump(mode="json", exclude={"description", "sources"})


def _of_light(camera: Camera, cube: bool) -> Facts:
    """What of the camera decides the light in front of its pixels. With a cube all that it detects is its band."""
    whole = camera.model_dump(mode="json", include={"lens", "sensor", "quantum_efficiency"})
    sensor = {name: whole["sensor"][name] for name in ("columns", "rows", "shutter", "row_time_us")}
    pitch = [camera.pixel.pitch_x_um, camera.pixel.pitch_y_um]
    detected = {"band_nm": camera.band_nm} if cube else {"quantum_efficiency": whole["quantum_efficiency"]}
    return {"lens": whole["lens"], "sensor": sensor, "pitch_um": pitch, **detected}


def _number(name: str, value: Any) -> None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
        raise InputError(f"{name} is {value!r}; it must be a number.")


def load_plan(path: str | Path, roots: Sequence[str | Path] = ()) -> DatasetPlan:
    """The plan of a dataset file; its files may be read below its own folder and the roots. Raises InputError."""
    from .file import read_dataset

    file = read_dataset(path)
    for root in roots:
        files.refuse_empty(root, "--root", "give the name of a folder")
        if not Path(root).is_dir():
            raise InputError(f"--root {root} is no folder; give one that holds scenes or cameras.")
    return DatasetPlan(file, [Path(path).parent, *map(Path, roots)], text_of_file(Path(path), "give a dataset file"))
