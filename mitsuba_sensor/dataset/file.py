"""The dataset file: scenes, cameras, what varies and how, the files of each sample, and splits; read from TOML."""

from __future__ import annotations

import os
import re
import tomllib
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

import pydantic
from pydantic import Field, PlainValidator, model_validator

from ..camera.datasheet_errors import sentence
from ..core import InputError
from ..core.small_files import toml_tables
from ..files import texts
from ..files.appearing import refuse_empty
from ..render.scene.motion import KeyPose, Number, Vector, read_motion
from ..stages.datasheet import FileTable, optional
from .keys import Config, Facts
from .values import SAME, check_field, check_render, check_value, plain_value, value_or_list

FILE_BYTES_MAX = 2**22
SAMPLES_MAX = 10**9
SUM_TOLERANCE = 1e-9
Output = Literal[
    "raw",
    "readouts",
    "companded",
    "dng",
    "clean",
    "electrons",
    "variance",
    "noise_budget",
    "preview",
    "aovs",
    "irradiance",
]
OUTPUTS: tuple[str, ...] = get_args(Output)
Seed = Annotated[int, Field(ge=0, lt=2**63, strict=True)]
Share = Annotated[float, Field(gt=0, le=1, strict=True)]
Count = Annotated[int, Field(ge=1, le=SAMPLES_MAX, strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Pair = Annotated[tuple[Number, ...], Field(min_length=2, max_length=2)]
Plain = Annotated[bool | float | int | str, PlainValidator(plain_value)]
Value = Annotated[bool | float | int | str | tuple[float, ...], PlainValidator(value_or_list)]
Values = Annotated[tuple[Value, ...], Field(min_length=1)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


class CameraPath(FileTable):
    """Evenly spaced poses and times on a path through keys.

    Positions and targets are interpolated linearly. If the last key repeats the first pose, the path is a loop and that
    pose is made once. Keys with times only are times of the scene's own pose, which a motion may move.
    """

    views: Annotated[int, Field(ge=1, le=10**6, strict=True)] = Field(
        description="number of poses", examples=[12]
    )
    keys: Annotated[tuple[KeyPose, ...], Field(min_length=2)] = Field(
        description="tables with time_s, origin_m and target_m",
        examples=[[{"time_s": 0, "origin_m": [0, 1, 4], "target_m": [0, 1, 0]}]],
    )

    @property
    def has_poses(self) -> bool:
        """Return True if the keys have poses, not only times."""
        return self.keys[0].origin_m is not None

    @model_validator(mode="after")
    def _look_at(self) -> Self:
        only_times = all(key.model_fields_set == {"time_s"} for key in self.keys)
        if not only_times and any(None in (key.origin_m, key.target_m) for key in self.keys):
            raise ValueError(
                "keys of a path need origin_m and target_m, e.g. origin_m = [0, 1, 4], or all of them only time_s"
            )
        times = [key.time_s for key in self.keys]
        if sorted(set(times)) != times:
            raise ValueError("keys must have increasing time_s")
        return self


class View(FileTable):
    """A pose of the camera, a time, or both. Without a pose it has the pose of the scene file."""

    origin_m: Vector | None = optional("position of the camera [m]", [0, 1, 4])
    target_m: Vector | None = optional("a point that the camera looks at [m]", [0, 1, 0])
    up: Vector = optional("direction that is up in the image", [0, 1, 0], (0.0, 1.0, 0.0))
    time_s: Annotated[Number, Field(ge=-1e9, le=1e9)] | None = optional(
        "start of the frame, in seconds of the motion and of the waveforms of lamps", 0.5
    )

    @property
    def pose(self) -> Facts | None:
        """Return the fields of the pose, without the time; None for the pose of the scene file."""
        return self.model_dump(exclude={"time_s"}) if self.origin_m else None

    @model_validator(mode="after")
    def _is_a_pose_or_a_time(self) -> Self:
        if self.model_fields_set & {"origin_m", "target_m", "up"}:
            if self.origin_m is None or self.target_m is None:
                raise ValueError(
                    "a pose needs origin_m and target_m, e.g. origin_m = [0, 1, 4]"
                )
            KeyPose(time_s=0, **self.model_dump(exclude={"time_s"}))
        elif self.time_s is None:
            raise ValueError("must have origin_m and target_m, or time_s, or both")
        return self


class SceneEntry(FileTable):
    """A scene, with values that all its samples share."""

    name: Name = Field(description="name of the scene", examples=["cornell"])
    file: str = Field(
        description="a Mitsuba 3 scene file, or a name from `scenes list`",
        examples=["cornell_box"],
        min_length=1,
    )
    parameters: dict[str, Plain] = optional("values of its <default> names", {"width": 128}, {})
    traverse: dict[str, Value] = optional(
        "values by mi.traverse names", {"lamp.emitter.radiance.value": 2.0}, {}
    )
    scene_unit: str | Number | None = optional(
        "the length of 1 in the scene: m, mm, … or metres", "mm"
    )
    integrator: str | None = optional("integrator instead of its own", "path")
    ignore_polarization: Flag = optional("render polarisers unpolarised", True, False)
    motion: str | dict[str, Any] | None = optional(
        "what moves: a motion file or its tables", "motion.toml"
    )
    sensors: str | tuple[str, ...] | None = optional(
        "sensors of the scene file that take the images, by id or number, or all; by default the first one",
        ["left", "right"],
    )
    views: tuple[View, ...] = optional(
        "poses of the camera and their times",
        [{"origin_m": [0, 1, 4], "target_m": [0, 1, 0], "time_s": 0.1}],
        (),
    )
    path: CameraPath | None = optional("poses and times on a path", {"views": 12, "keys": []})

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.views and self.path:
            raise ValueError("has views and a path; give one of them")
        if self.sensors is not None and not self.sensors:
            raise ValueError("sensors is empty; give names or all, or omit it")
        if isinstance(self.motion, dict):
            try:
                read_motion(self.motion)
            except InputError as error:
                raise ValueError(str(error).removesuffix(".")) from None
        return self

    @property
    def has_times(self) -> bool:
        """Return True if frames start at their own times."""
        return self.path is not None or any(view.time_s is not None for view in self.views)


class CameraEntry(FileTable):
    """A camera, with changed fields."""

    camera: str = Field(
        description="a name from `cameras list`, or the path of a .toml",
        examples=["bayer_2mp"],
        min_length=1,
    )
    name: Name | None = optional("name in the dataset; by default its own name", "low_gain")
    set: dict[str, Any] = optional("fields of its datasheet", {"adc.bits": 12}, {})
    without: tuple[str, ...] = optional("noise sources that are off", ["prnu"], ())


class Distribution(FileTable):
    """One random number of a sample: exactly one of the distributions."""

    uniform: Pair | None = optional("lowest and highest value", [1.0, 5.0])
    log_uniform: Pair | None = optional(
        "lowest and highest value, uniform over their logarithm", [0.001, 0.1]
    )
    normal: Pair | None = optional("mean and standard deviation", [298.0, 3.0])
    integer: Annotated[tuple[int, ...], Field(min_length=2, max_length=2)] | None = optional(
        "lowest and highest whole number", [1, 100]
    )
    choice: Values | None = optional("the values", [100, 200, 400])

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        kinds = [*type(self).model_fields]
        given = [name for name in kinds if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"must have exactly one of {', '.join(kinds)}, e.g. {{ uniform = [1, 5] }}"
            )
        (kind,) = given
        if kind == "normal" and self.normal[1] < 0:  # type: ignore[index]
            raise ValueError(f"normal is {[*self.normal]}; the standard deviation must be ≥ 0")  # type: ignore[misc]
        if kind in ("uniform", "log_uniform", "integer"):
            low, high = getattr(self, kind)
            if high < low or (kind == "log_uniform" and low <= 0):
                positive = ", both above 0" * (kind == "log_uniform")
                raise ValueError(
                    f"{kind} is [{low}, {high}]; give the lowest and the highest value{positive}"
                )
        return self


class RandomSweep(FileTable):
    """Random values, the same for every camera and row, so cameras and rows can be compared."""

    draws: Count = Field(description="number of draws", examples=[100])
    values: dict[str, Distribution] = Field(
        description="the distribution of each value",
        examples=[{"exposure_s": {"log_uniform": [1e-3, 0.1]}}],
        min_length=1,
    )


class Splits(FileTable):
    """The fraction of scenes and sensor units in each split. No two splits share a scene or a sensor unit."""

    shares: Annotated[dict[Name, Share], Field(min_length=1)] = Field(
        description="split → fraction", examples=[{"train": 0.8, "test": 0.2}]
    )
    by: tuple[str, ...] = Field(
        ("scene",),
        description="what makes a separate scene; view is a pose",
        examples=[["scene", "view"]],
        min_length=1,
    )
    block: Count | None = optional(
        "neighbouring poses that stay in one split, if by has view; by default 1", 20
    )
    chips: Count | None = optional(
        "number of sensor units of each split, instead of a varied serial", 2
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        total = sum(self.shares.values())
        if abs(total - 1) > SUM_TOLERANCE:
            raise ValueError(f"shares sum to {total:g}; let them sum to 1")
        for name in self.by:
            if name not in ("scene", "view") and name.partition(".")[0] not in (
                "parameters",
                "traverse",
            ):
                raise ValueError(
                    f"by has {name!r}; give scene, view, parameters.NAME or traverse.NAME"
                )
        if self.block and "view" not in self.by:
            raise ValueError(
                f'block is {self.block} poses, but by does not name poses; give by = ["scene", "view"]'
            )
        return self


class DatasetFile(FileTable):
    """A dataset: what is rendered and exposed, and the files of each sample."""

    name: Name = Field(description="name of the dataset", examples=["low_light_pairs"])
    description: str = optional("one line for people", "noisy and clean frames", "")
    licence: str = optional("terms on which other people may use it", "CC-BY-4.0", "")
    seed: Seed = optional("of all random values, renders and temporal noise", 1, 1)
    outputs: tuple[Output, ...] = optional(
        "files of each sample", ["raw", "clean"], ("raw", "clean", "variance", "preview")
    )
    render: dict[str, Any] = optional("options of every render", {"spp": 128, "width": 96}, {})
    scenes: Annotated[tuple[SceneEntry, ...], Field(min_length=1)] = Field(
        description="tables with name and file",
        examples=[[{"name": "cornell", "file": "cornell_box"}]],
    )
    cameras: Annotated[tuple[CameraEntry, ...], Field(min_length=1)] = Field(
        description="tables with camera", examples=[[{"camera": "bayer_2mp"}]]
    )
    grid: dict[str, Values] = optional(
        "values whose combinations are all made", {"exposure_s": [0.001, 0.01]}, {}
    )
    list: tuple[dict[str, Value], ...] = optional(
        "values that belong together", [{"exposure_s": 0.01, "gain": 400}], ()
    )
    random: RandomSweep | None = optional("random values", {"draws": 100, "values": {}})
    splits: Splits | None = optional("train, test, …", {"shares": {"train": 0.8, "test": 0.2}})

    @model_validator(mode="after")
    def _fits(self) -> Self:
        _refuse_repeated("scenes", [scene.name for scene in self.scenes])
        _refuse_repeated("cameras", [camera.name or camera.camera for camera in self.cameras])
        _refuse_repeated("outputs", [*self.outputs])
        if not self.outputs:
            raise ValueError(f"outputs is empty; give at least one of {', '.join(OUTPUTS)}")
        tables = (self.grid, self._rows_in_one, self.random.values if self.random else {})
        names = [check_field(SAME.get(name, name)) for table in tables for name in table]
        _refuse_repeated("grid, list and random", names)
        for name, values in self.grid.items():
            for value in values:
                check_value(name, value)
        for row in self.list:
            for name, value in row.items():
                check_value(name, value)
        if self.splits and self.splits.chips and "serial" in names:
            raise ValueError("splits.chips is given and serial varies; remove one of them")
        check_render(self.render, [scene.name for scene in self.scenes if scene.has_times])
        return self

    @property
    def _rows_in_one(self) -> Facts:
        return {name: value for row in self.list for name, value in row.items()}

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of all values that vary, in the order of the file."""
        return (*self.grid, *self._rows_in_one, *(self.random.values if self.random else ()))


def _refuse_repeated(where: str, names: list[str]) -> None:
    """Raise ValueError for a repeated name."""
    for name, count in Counter(names).items():
        if count > 1:
            raise ValueError(f"{where} has {name!r} twice; give each once")


def read_dataset(path: str | os.PathLike[str]) -> DatasetFile:
    """Return the dataset of a file. Raises InputError."""
    return read_dataset_text(text_of_dataset(path), f"dataset file {os.fspath(path)!r}")


def text_of_dataset(path: str | os.PathLike[str]) -> str:
    """Return the text of a dataset file. Raises InputError."""
    remedy = "give the path of a dataset file"
    refuse_empty(os.fspath(path), "the dataset", f"{remedy}, e.g. dataset.toml")
    return texts.text_of_file(Path(path), remedy, FILE_BYTES_MAX)


def read_dataset_text(
    text: str, where: str = "the dataset file in dataset.json"
) -> DatasetFile:
    """Return the dataset of a TOML text. Raises InputError.  where : the text is, for messages."""
    try:
        return dataset_of(toml_tables(text), where)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where} is not valid TOML: {error}.") from None


def dataset_of(tables: Config, where: str) -> DatasetFile:
    """Return the dataset of tables. Raises InputError.  where : the tables are, for messages."""
    try:
        return DatasetFile.model_validate(tables)
    except pydantic.ValidationError as error:
        message = re.sub(r"\s+", " ", sentence(error, DatasetFile, where, "dataset"))
        raise InputError(message.replace(": the dataset: ", ": ", 1)) from None
