"""Gain settings of a camera (ISO, conversion gain): their numbers, and how a camera is set to one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import AfterValidator, Field, model_validator

from ..core import Doubt, InputError
from ..core.errors import shown
from ..stages.datasheet import FileTable, NotNegative, Positive, optional
from ..stages.effects.source_follower_noise import check_shape
from ..stages.gains import gain_behind_register_dn_per_e, sense_gain_v_per_e
from ..stages.usual_range import THOUSANDS, VOLTS_TO_UV, Usual
from .shipped import cameras_with_gains

if TYPE_CHECKING:
    from .camera import Camera

SET = {
    "read_noise_e": "source_follower.read_noise_e",
    "read_noise_shape": "source_follower.read_noise_shape",
    "black_level_dn": "adc.black_level_dn",
    "full_well_e": "pixel.full_well_e",
    "sense_gain_uv_per_e": "readout.sense_gain_uv_per_e",
    "row_noise_e": "readout.row_noise_e",
    "column_noise_e": "readout.column_noise_e",
    "frame_noise_e": "readout.frame_noise_e",
}
"""Number of a setting → camera field that it replaces; the overall gain sets adc.full_scale_v."""

OFFSETS = "readout.dsnu_col", "readout.dsnu_row"
"""Fields in units of the full-well swing; their volts are equal at all settings."""

SAME = 1e-6
"""Relative difference up to which the numbers of camera and setting are equal."""


class GainSetting(FileTable):
    """A gain setting: numbers that replace the camera's."""

    iso: Positive | None = optional("ISO number of the setting; or give name", 800)
    name: Annotated[str, Field(min_length=1)] | None = optional(
        "name of the setting; or give iso", "high conversion gain"
    )
    gain_dn_per_e: Annotated[Positive, Usual(1e-4, 1e3)] = Field(
        description="overall system gain K; sets adc.full_scale_v [DN/e-]", examples=[0.25]
    )
    read_noise_e: Annotated[NotNegative, Usual(0.05, 500)] = Field(
        description="replaces source_follower.read_noise_e [e- rms]", examples=[3.0]
    )
    read_noise_shape: Annotated[float | None, Field(strict=True)] = optional(
        "replaces source_follower.read_noise_shape",
        -0.05,
    )
    black_level_dn: NotNegative | None = optional("replaces adc.black_level_dn [DN]", 64)
    full_well_e: Annotated[
        Annotated[float, Field(ge=1, le=1e30, strict=True)] | None,
        Usual.of(200, 1e8, THOUSANDS),
    ] = optional("replaces pixel.full_well_e [e-]", 33000)
    sense_gain_uv_per_e: Annotated[Positive | None, Usual.of(0.1, 1e3, VOLTS_TO_UV)] = optional(
        "replaces readout.sense_gain_uv_per_e, and so sets the kTC noise [µV/e-]",
        50.0,
    )
    row_noise_e: NotNegative | None = optional("replaces readout.row_noise_e [e- rms]", 0.3)
    column_noise_e: NotNegative | None = optional(
        "replaces readout.column_noise_e [e- rms]", 0.2
    )
    frame_noise_e: NotNegative | None = optional("replaces readout.frame_noise_e [e- rms]", 0.2)

    @model_validator(mode="after")
    def _one_label(self) -> Self:
        if self.iso is not None and self.name is not None:
            raise ValueError("give either iso or name, and not both")
        if self.iso is None and self.name is None:
            raise ValueError("iso and name are missing; give either, e.g. iso = 800")
        return self

    @property
    def label(self) -> str:
        """Name of the setting: "800", "high conversion gain"."""
        return label_of(self.name if self.iso is None else self.iso)


def label_of(setting: object) -> str:
    """Return "800" for 800, 800.0 and "800", and other texts unchanged. Raises InputError for other types."""
    if isinstance(setting, bool) or not isinstance(setting, str | int | float):
        raise InputError(
            f"gain is {shown(setting)}; pass an ISO number or the name of a gain setting, e.g. 800."
        )
    try:
        return f"{float(setting):.10g}"
    except (ValueError, OverflowError):
        return str(setting).strip()


def _fits(gains: tuple[GainSetting, ...]) -> tuple[GainSetting, ...]:
    """Require different names, and equal sets of fields: otherwise numbers would depend on the previous setting."""
    for label, count in Counter(setting.label for setting in gains).items():
        if count > 1:
            raise ValueError(f"{count} gain settings are called {label!r}; rename all but one")
    for field in SET:
        given = [setting.label for setting in gains if getattr(setting, field) is not None]
        missing = [setting.label for setting in gains if getattr(setting, field) is None]
        if given and missing:
            raise ValueError(
                f"gain setting {given[0]!r} has {field}, but {missing[0]!r} does not; give it in all or none"
            )
    return gains


Gains = Annotated[tuple[GainSetting, ...], AfterValidator(_fits)]


def wrong_gain(camera: Camera) -> Iterator[str]:
    """Yield errors for an unknown setting, and for a read noise shape that its distribution does not allow."""
    for setting in camera.gains:
        if setting.read_noise_shape is not None:
            distribution = camera.source_follower.read_noise_distribution
            try:
                check_shape(distribution, setting.read_noise_shape)
            except ValueError as error:
                yield f"gain setting {setting.label!r}: {error}; or unset gains"
    labels = [setting.label for setting in camera.gains]
    if camera.gain is not None and camera.gain not in labels:
        yield _unknown_gain(camera, camera.gain)


def _unknown_gain(camera: Camera, label: str) -> str:
    """Return the message about a gain setting that the camera does not have."""
    if camera.gains:
        labels = ", ".join(setting.label for setting in camera.gains)
        return f"gain is {label!r}; the gain settings of {camera.name} are {labels}"
    return (
        f"gain is {label!r}, but {camera.name} has no gain settings; omit gain, add [[gains]] to its file, or use "
        f"{', '.join(cameras_with_gains(label))}"
    )


def at_gain(camera: Camera, setting: float | str) -> Camera:
    """Return the camera at a setting; see :meth:`Camera.at_gain`."""
    label = label_of(setting)
    if label == camera.gain:
        return camera
    settings = {setting.label: setting for setting in camera.gains}
    if label not in settings:
        raise InputError(f"{_unknown_gain(camera, label)}.")
    changes = _changes(camera, settings[label])
    sources = {name: f"gain setting {label}" for name, x in changes.items() if x is not None}
    changed = camera.replace(**changes)
    return changed.model_copy(update={"gain": label, "sources": {**changed.sources, **sources}})


def _changes(camera: Camera, setting: GainSetting) -> dict[str, Any]:
    """Return the fields that a setting changes. Full scale: V_FS = A_SN·A_SF·A_CDS·2^bits/K."""
    numbers = {field: getattr(setting, name) for name, field in SET.items()}
    given: dict[str, Any] = {field: x for field, x in numbers.items() if x is not None}
    well_e: float = camera.pixel.full_well_e
    new_sense_v = sense_v = sense_gain_v_per_e(camera)
    if setting.sense_gain_uv_per_e is not None:
        new_sense_v = setting.sense_gain_uv_per_e * 1e-6
    per_e_v = new_sense_v * camera.source_follower.gain * camera.readout.cds_gain
    if camera.readout.gain_dn_per_e is not None:
        given["readout.gain_dn_per_e"] = setting.gain_dn_per_e
    else:
        given["adc.full_scale_v"] = per_e_v * 2.0**camera.adc.bits / setting.gain_dn_per_e
    if camera.source_follower.white_nv_per_rthz is not None:
        given["source_follower.white_nv_per_rthz"] = None  # replaced by read_noise_e
    swing = well_e * sense_v / (given.get("pixel.full_well_e", well_e) * new_sense_v)
    for field in OFFSETS:
        offset = getattr(camera.readout, field.partition(".")[2])
        if offset and not math.isclose(swing, 1):
            given[field] = offset * swing
    return given


def require_sense_gain(camera: Camera, tables: Mapping[str, Any]) -> None:
    """Raise InputError if tables in which adc.full_scale_v replaced this camera's K have no sense gain."""
    readout = tables["readout"]
    if readout.get("sense_gain_uv_per_e") is None and readout.get("ve_k1_c") is None:
        raise InputError(
            f"{camera.name}: adc.full_scale_v replaces readout.gain_dn_per_e {camera.readout.gain_dn_per_e:.4g}, and "
            "the sense gain is missing; also set readout.sense_gain_uv_per_e, e.g. 5, or set readout.gain_dn_per_e."
        )


def replaced_gain_notes(camera: Camera, changed: Camera) -> Iterator[Doubt]:
    """Yield a note if K differs after adc.full_scale_v replaced readout.gain_dn_per_e."""
    old, new = camera.system_gain_dn_per_e, changed.system_gain_dn_per_e
    if not math.isclose(old, new, rel_tol=SAME):
        yield Doubt(
            f"readout.gain_dn_per_e {camera.readout.gain_dn_per_e:.4g} was replaced by adc.full_scale_v; K is now "
            f"{new:.4g} DN/e-; set readout.gain_dn_per_e instead to choose K"
        )


def gain_notes(camera: Camera) -> tuple[str, ...]:
    """Return notes on numbers that differ from the camera's gain setting."""
    setting = next((x for x in camera.gains if x.label == camera.gain), None)
    if setting is None:
        return ()
    numbers: dict[str, float | None] = {"gain_dn_per_e": gain_behind_register_dn_per_e(camera)}
    for name, field in SET.items():
        table, key = field.split(".")
        numbers[name] = getattr(getattr(camera, table), key)
    return tuple(
        f"gain is {setting.label!r} with {name} = {number:.6g}, but the camera's {name} is "
        f"{'unset' if has is None else f'{has:.6g}'}; call camera.at_gain after all other changes, or omit gain"
        for name, has in numbers.items()
        if (number := getattr(setting, name)) is not None
        and (has is None or not math.isclose(has, number, rel_tol=SAME))
    )
