"""Dataset file: scenes, cameras, what is varied and how, the files of each sample, and splits; read from TOML."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
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

LARGEST_BYTES = 2**22  # of a dataset file
MOST_SAMPLES = 10**9
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


Plain = Annotated[bool | float | int | str, PlainValidator(plain_value)]
Value = Annotated[bool | float | int | str | tuple[float, ...], PlainValidator(value_or_list)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


class CameraPath(FileTable):
    """Poses and times on a path through keys, evenly spaced from the first to the last one; positions and targets are
    interpolated linearly. Where the last key is the first pose again, the path is a loop: that pose is made once. Keys
    that have times alone are times of the scene's own pose, which a motion may move."""

    views: Annotated[int, Field(ge=1, le=10**6, strict=True)] = Field(
        description="how many poses", examples=[12]
    )
    keys: Annotated[tuple[KeyPose, ...], Field(min_length=2)] = Field(
        description="tables with time_s, origin_m and target_m",
        examples=[[{"time_s": 0, "origin_m": [0, 1, 4], "target_m": [0, 1, 0]}]],
    )

    @property
    def has_poses(self) -> bool:
        """Whether its keys have poses, not times alone."""
        return self.keys[0].origin_m is not None

    @model_validator(mode="after")
    def _look_at(self) -> Self:
        only_times = all(key.model_fields_set == {"time_s"} for key in self.keys)
        for key in self.keys:
            if not only_times and (key.origin_m is None or key.target_m is None):
                raise ValueError(
                    "keys of a path need origin_m and target_m, e.g. origin_m = [0, 1, 4], or all of them time_s alone"
                )
        times = [key.time_s for key in self.keys]
        if sorted(set(times)) != times:
            raise ValueError("keys must have increasing time_s")
        return self


class View(FileTable):
    """A pose of the camera, a time, or both. Without a pose it is that of the scene file."""

    origin_m: Vector | None = optional("position of the camera [m]", [0, 1, 4])
    target_m: Vector | None = optional("a point that it looks at [m]", [0, 1, 0])
    up: Vector = Field(
        (0.0, 1.0, 0.0), description="direction that is up in the image", examples=[[0, 1, 0]]
    )
    time_s: Annotated[Number, Field(ge=-1e9, le=1e9)] | None = optional(
        "when the frame begins, in seconds of the motion and of the waveforms of lamps", 0.5
    )

    @property
    def pose(self) -> Facts | None:
        """Its fields without the time; None where it is the pose of the scene file."""
        if self.origin_m is None:
            return None
        return self.model_dump(exclude={"time_s"})

    @model_validator(mode="after")
    def _is_a_pose_or_a_time(self) -> Self:
        given = self.model_fields_set
        if given & {"origin_m", "target_m", "up"}:
            if self.origin_m is None or self.target_m is None:
                raise ValueError(
                    "a pose needs origin_m and target_m, e.g. origin_m = [0, 1, 4]"
                )
            KeyPose(time_s=0, **self.model_dump(exclude={"time_s"}))
        elif self.time_s is None:
            raise ValueError("must have origin_m and target_m, or time_s, or both")
        return self


class SceneEntry(FileTable):
    """A scene, with values that are the same in all its samples."""

    name: Name = Field(description="how the scene is called", examples=["cornell"])
    file: str = Field(
        description="a Mitsuba 3 scene file, or a name from `scenes list`",
        examples=["cornell_box"],
        min_length=1,
    )
    parameters: dict[str, Plain] = Field(
        {}, description="values of its <default> names", examples=[{"width": 128}]
    )
    traverse: dict[str, Value] = Field(
        {},
        description="values by mi.traverse names",
        examples=[{"lamp.emitter.radiance.value": 2.0}],
    )
    scene_unit: str | Number | None = optional(
        "what a length of 1 in it is: m, mm, … or metres", "mm"
    )
    integrator: str | None = optional("integrator in place of its own", "path")
    ignore_polarization: Annotated[bool, Field(strict=True)] = optional(
        "render polarisers unpolarised", True, False
    )
    motion: str | dict[str, Any] | None = optional(
        "what moves: a motion file or its tables", "motion.toml"
    )
    sensors: str | tuple[str, ...] | None = optional(
        "sensors of the scene file that take the pictures, by id or number, or all; by default the first one",
        ["left", "right"],
    )
    views: tuple[View, ...] = Field(
        (),
        description="poses of the camera, and when it has them",
        examples=[[{"origin_m": [0, 1, 4], "target_m": [0, 1, 0], "time_s": 0.1}]],
    )
    path: CameraPath | None = optional("poses and times on a path", {"views": 12, "keys": []})

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.views and self.path:
            raise ValueError("has views and a path; give one of them")
        if self.sensors is not None and not self.sensors:
            raise ValueError("sensors is empty; give names, all, or leave it out")
        if isinstance(self.motion, dict):
            try:
                read_motion(self.motion)
            except InputError as error:
                raise ValueError(str(error).removesuffix(".")) from None
        return self

    @property
    def has_times(self) -> bool:
        """Whether its frames begin at times of their own."""
        return self.path is not None or any(view.time_s is not None for view in self.views)


class CameraEntry(FileTable):
    """A camera, with fields that are set in it."""

    camera: str = Field(
        description="a name from `cameras list`, or the path of a .toml",
        examples=["bayer_2mp"],
        min_length=1,
    )
    name: Name | None = optional(
        "how the dataset calls it; by default its own name", "low_gain"
    )
    set: dict[str, Any] = Field(
        {}, description="fields of its datasheet", examples=[{"adc.bits": 12}]
    )
    without: tuple[str, ...] = Field(
        (), description="noise sources that are switched off", examples=[["prnu"]]
    )


class Distribution(FileTable):
    """One random number of a sample: exactly one of the distributions."""

    uniform: Annotated[tuple[Number, ...], Field(min_length=2, max_length=2)] | None = optional(
        "lowest and highest value", [1.0, 5.0]
    )
    log_uniform: Annotated[tuple[Number, ...], Field(min_length=2, max_length=2)] | None = (
        optional("lowest and highest value, evenly over their logarithm", [0.001, 0.1])
    )
    normal: Annotated[tuple[Number, ...], Field(min_length=2, max_length=2)] | None = optional(
        "mean and standard deviation", [298.0, 3.0]
    )
    integer: Annotated[tuple[int, ...], Field(min_length=2, max_length=2)] | None = optional(
        "lowest and highest whole number", [1, 100]
    )
    choice: Annotated[tuple[Value, ...], Field(min_length=1)] | None = optional(
        "the values", [100, 200, 400]
    )

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            kinds = ", ".join(type(self).model_fields)
            raise ValueError(f"must have exactly one of {kinds}, e.g. {{ uniform = [1, 5] }}")
        low, high = (
            getattr(self, given[0])
            if given[0] in ("uniform", "log_uniform", "integer")
            else (0, 1)
        )
        if high < low or (given[0] == "log_uniform" and low <= 0):
            positive = ""
            if given[0] == "log_uniform":
                positive = ", both above 0"
            raise ValueError(
                f"{given[0]} is [{low}, {high}]; give the lowest and the highest value{positive}"
            )
        if self.normal is not None and self.normal[1] < 0:
            raise ValueError(
                f"normal has a standard deviation of {self.normal[1]}; it must not be negative"
            )
        return self


class RandomSweep(FileTable):
    """Values drawn at random: the same for every camera and row, so that those can be compared."""

    draws: Annotated[int, Field(ge=1, le=MOST_SAMPLES, strict=True)] = Field(
        description="how often", examples=[100]
    )
    values: dict[str, Distribution] = Field(
        description="what is drawn and how",
        examples=[{"exposure_s": {"log_uniform": [1e-3, 0.1]}}],
        min_length=1,
    )


class Splits(FileTable):
    """Which share of the scenes and of the chips belongs to which split. No two share a scene or a chip."""

    shares: Annotated[dict[Name, Share], Field(min_length=1)] = Field(
        description="split → share", examples=[{"train": 0.8, "test": 0.2}]
    )
    by: tuple[str, ...] = Field(
        ("scene",),
        description="what makes another scene of it; view is a pose",
        examples=[["scene", "view"]],
        min_length=1,
    )
    block: Annotated[int, Field(ge=1, le=MOST_SAMPLES, strict=True)] | None = optional(
        "neighbouring poses that stay in one split, where by has view; by default 1", 20
    )
    chips: Annotated[int, Field(ge=1, le=MOST_SAMPLES, strict=True)] | None = optional(
        "serial numbers of each split, of its own; instead of a varied serial", 2
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if abs(sum(self.shares.values()) - 1) > 1e-9:
            raise ValueError(f"shares sum to {sum(self.shares.values()):g}; let them sum to 1")
        for name in self.by:
            if name not in ("scene", "view") and not name.startswith(
                ("parameters.", "traverse.")
            ):
                raise ValueError(
                    f"by has {name!r}; give scene, view, parameters.NAME or traverse.NAME"
                )
        if self.block and "view" not in self.by:
            raise ValueError(
                f'block is {self.block}, of poses, and by names none; give by = ["scene", "view"]'
            )
        return self


class DatasetFile(FileTable):
    """A dataset: what is rendered and exposed, and which files each sample has."""

    name: Name = Field(description="how the dataset is called", examples=["low_light_pairs"])
    description: str = Field(
        "", description="one line for people", examples=["noisy and clean frames"]
    )
    licence: str = Field(
        "", description="under which others may use it", examples=["CC-BY-4.0"]
    )
    seed: Seed = Field(
        1, description="of all random values, renders and temporal noise", examples=[1]
    )
    outputs: tuple[Output, ...] = Field(
        ("raw", "clean", "variance", "preview"),
        description="files of each sample",
        examples=[["raw", "clean"]],
    )
    render: dict[str, Any] = Field(
        {}, description="options of every render", examples=[{"spp": 128, "width": 96}]
    )
    scenes: Annotated[tuple[SceneEntry, ...], Field(min_length=1)] = Field(
        description="tables with name and file",
        examples=[[{"name": "cornell", "file": "cornell_box"}]],
    )
    cameras: Annotated[tuple[CameraEntry, ...], Field(min_length=1)] = Field(
        description="tables with camera", examples=[[{"camera": "bayer_2mp"}]]
    )
    grid: dict[str, Annotated[tuple[Value, ...], Field(min_length=1)]] = Field(
        {},
        description="values of which every combination is made",
        examples=[{"exposure_s": [0.001, 0.01]}],
    )
    list: tuple[dict[str, Value], ...] = Field(
        (),
        description="values that belong together",
        examples=[[{"exposure_s": 0.01, "gain": 400}]],
    )
    random: RandomSweep | None = optional(
        "values drawn at random", {"draws": 100, "values": {}}
    )
    splits: Splits | None = optional("train, test, …", {"shares": {"train": 0.8, "test": 0.2}})

    @model_validator(mode="after")
    def _fits(self) -> Self:
        _unique("scenes", [one.name for one in self.scenes])
        _unique("cameras", [one.name or one.camera for one in self.cameras])
        _unique("outputs", [*self.outputs])
        if not self.outputs:
            raise ValueError(f"outputs is empty; give at least one of {', '.join(OUTPUTS)}")
        given = [*self.grid, *dict.fromkeys(name for row in self.list for name in row)]
        given += [*self.random.values] if self.random else []
        _unique("grid, list and random", [check_field(SAME.get(name, name)) for name in given])
        rows = [
            *self.list,
            *({name: value} for name, values in self.grid.items() for value in values),
        ]
        for name, value in (pair for row in rows for pair in row.items()):
            check_value(name, value)
        if self.splits and self.splits.chips and "serial" in given:
            raise ValueError(
                "splits.chips is given and serial is varied too; leave one of them out"
            )
        timed = [scene.name for scene in self.scenes if scene.has_times]
        check_render(self.render, timed)
        return self

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of all that is varied, in the order of the file."""
        rows = dict.fromkeys(name for row in self.list for name in row)
        return (*self.grid, *rows, *(self.random.values if self.random else ()))


def _unique(where: str, names: list[str]) -> None:
    """Raise ValueError for a name that stands there twice."""
    known = set[str]()
    for name in names:
        if name in known:
            raise ValueError(f"{where} has {name!r} twice; give each once")
        known.add(name)


def read_dataset(source: str | os.PathLike[str] | Config) -> DatasetFile:
    """A dataset file, or its tables. Raises InputError, one sentence."""
    if isinstance(source, Mapping):
        return _checked(source, "the tables")
    refuse_empty(
        os.fspath(source), "the dataset", "give the path of a dataset file, e.g. dataset.toml"
    )
    return read_dataset_text(
        text_of_dataset(Path(source)), f"dataset file {os.fspath(source)!r}"
    )


def text_of_dataset(path: Path) -> str:
    """The text of a dataset file. Raises InputError."""
    return texts.text_of_file(path, "give the path of a dataset file", LARGEST_BYTES)


def read_dataset_text(
    text: str, where: str = "the dataset file in dataset.json"
) -> DatasetFile:
    """The same of its text.  where : it stands, for messages."""
    try:
        return _checked(toml_tables(text), where)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where} is not valid TOML: {error}.") from None


def _checked(tables: Config, where: str) -> DatasetFile:
    try:
        return DatasetFile.model_validate(tables)
    except pydantic.ValidationError as error:
        said = re.sub(r"\s+", " ", sentence(error, DatasetFile, where, "dataset"))
        raise InputError(said.replace(": the dataset: ", ": ", 1)) from None
