"""The tables [[scenes]] of a dataset file: a scene, its cameras' poses and times, and what is set in it."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import Field, PlainValidator, model_validator

from ..core import InputError
from ..render.scene.motion import KeyPose, Number, Vector, read_motion
from ..stages.datasheet import FileTable, optional
from .keys import Facts
from .values import plain_value, value_or_list

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
