"""The gain settings of a camera (ISO, conversion gain): what changes from one to the next, and how it is set."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import AfterValidator, Field, model_validator

from ..core import InputError
from ..stages.datasheet import FileTable, NotNegative, Positive, optional
from ..stages.effects.source_follower_noise import check_shape
from ..stages.gains import gain_behind_register_dn_per_e, sense_gain_v_per_e
from ..stages.usual_range import THOUSANDS, VOLTS_TO_UV, Usual

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
"""Number of a setting → the field of the camera that it takes the place of; the overall gain sets adc.full_scale_v."""

OFFSETS = "readout.dsnu_col", "readout.dsnu_row"
"""Fields in units of the full-well swing, whose volts no setting changes."""

SAME = 1e-6
"""Relative difference up to which a number of the camera is that of its setting."""


class GainSetting(FileTable):
    """One gain setting: the numbers that it has in place of those above."""

    iso: Positive | None = optional("ISO number of the setting, or name", 800)
    name: Annotated[str, Field(min_length=1)] | None = optional(
        "name of the setting, or iso", "high conversion gain"
    )
    gain_dn_per_e: Annotated[Positive, Usual(1e-4, 1e3)] = Field(
        description="overall system gain K; sets adc.full_scale_v [DN/e-]", examples=[0.25]
    )
    read_noise_e: Annotated[NotNegative, Usual(0.05, 500)] = Field(
        description="read noise; sets source_follower.read_noise_e [e- rms]", examples=[3.0]
    )
    read_noise_shape: Annotated[float | None, Field(strict=True)] = optional(
        "shape of the distribution of the read noise; sets source_follower.read_noise_shape",
        -0.05,
    )
    black_level_dn: NotNegative | None = optional(
        "code of darkness; sets adc.black_level_dn [DN]", 64
    )
    full_well_e: Annotated[
        Annotated[float, Field(ge=1, le=1e30, strict=True)] | None,
        Usual.of(200, 1e8, THOUSANDS),
    ] = optional("saturation capacity; sets pixel.full_well_e [e-]", 33000)
    sense_gain_uv_per_e: Annotated[Positive | None, Usual.of(0.1, 1e3, VOLTS_TO_UV)] = optional(
        "conversion gain of the sense node; sets readout.sense_gain_uv_per_e, and with it the kTC noise [µV/e-]",
        50.0,
    )
    row_noise_e: NotNegative | None = optional(
        "temporal row noise; sets readout.row_noise_e [e- rms]", 0.3
    )
    column_noise_e: NotNegative | None = optional(
        "temporal column noise; sets readout.column_noise_e [e- rms]", 0.2
    )
    frame_noise_e: NotNegative | None = optional(
        "jitter of the black level; sets readout.frame_noise_e [e- rms]", 0.2
    )

    @model_validator(mode="after")
    def _one_label(self) -> Self:
        if self.iso is not None and self.name is not None:
            raise ValueError("give a gain setting either an iso or a name, and not both")
        if self.iso is None and self.name is None:
            raise ValueError("a gain setting needs an iso, e.g. 800, or a name")
        return self

    @property
    def label(self) -> str:
        """What the setting is called: "800", "high conversion gain"."""
        return label_of(self.name if self.iso is None else self.iso)


def label_of(setting: object) -> str:
    """800, 800.0, "800" → "800"; another text as it is. Raises InputError for what is neither number nor text."""
    if isinstance(setting, bool) or not isinstance(setting, str | int | float):
        raise InputError(
            f"gain is {setting!r}; pass an ISO number or the name of a gain setting, e.g. 800."
        )
    try:
        return f"{float(setting):.10g}"
    except (ValueError, OverflowError):
        return str(setting).strip()


def _fits(gains: tuple[GainSetting, ...]) -> tuple[GainSetting, ...]:
    """Every setting has a name of its own, and the same numbers: else they would depend on the one set before."""
    for label, count in Counter(one.label for one in gains).items():
        if count > 1:
            raise ValueError(
                f"{count} gain settings are called {label!r}; give each another iso or name"
            )
    for field in SET:
        with_it = [one.label for one in gains if getattr(one, field) is not None]
        without = [one.label for one in gains if getattr(one, field) is None]
        if with_it and without:
            raise ValueError(
                f"the gain setting {with_it[0]!r} has {field} and {without[0]!r} has none; give it in all or in none"
            )
    return gains


Gains = Annotated[tuple[GainSetting, ...], AfterValidator(_fits)]


def wrong_gain(camera: Camera) -> Iterator[str]:
    """Sentences for a setting that the camera does not have, or whose shape is none of its read noise."""
    for one in camera.gains:
        if one.read_noise_shape is not None:
            try:
                check_shape(
                    camera.source_follower.read_noise_distribution, one.read_noise_shape
                )
            except ValueError as error:
                yield f"gain setting {one.label!r}: {error}; or unset gains"
    known = [one.label for one in camera.gains]
    if camera.gain is not None and camera.gain not in known:
        yield f"gain is {camera.gain!r}; its settings are {', '.join(known) or 'none: add [[gains]]'}"


def at_gain(camera: Camera, setting: float | str) -> Camera:
    """See :meth:`Camera.at_gain`."""
    label = label_of(setting)
    if label == camera.gain:
        return camera
    found = {one.label: one for one in camera.gains}
    if label not in found:
        if not found:
            remedy = "add [[gains]] to its file, or leave the gain out"
            raise InputError(
                f"gain is {label!r}, and {camera.name} has no gain settings; {remedy}."
            )
        raise InputError(
            f"gain is {label!r}; the gain settings of {camera.name} are {', '.join(found)}."
        )
    changes = _changes(camera, found[label])
    of_ladder = {
        field: f"gain setting {label}" for field, value in changes.items() if value is not None
    }
    changed = camera.replace(**changes)
    return changed.model_copy(
        update={"gain": label, "sources": {**changed.sources, **of_ladder}}
    )


def _changes(camera: Camera, setting: GainSetting) -> dict[str, Any]:
    """The fields of the camera at this setting. Full scale: V_FS = A_SN·A_SF·A_CDS·2^bits/K."""
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
        given["source_follower.white_nv_per_rthz"] = None  # it is given in electrons now
    swing = well_e * sense_v / (given.get("pixel.full_well_e", well_e) * new_sense_v)
    for field in OFFSETS:
        offset = getattr(camera.readout, field.partition(".")[2])
        if offset and not math.isclose(swing, 1):
            given[field] = offset * swing
    return given


def gain_notes(camera: Camera) -> tuple[str, ...]:
    """Where a camera says that it is at a setting and has other numbers: changed since, or written by hand."""
    found = next((one for one in camera.gains if one.label == camera.gain), None)
    if found is None:
        return ()
    numbers: dict[str, float | None] = {"gain_dn_per_e": gain_behind_register_dn_per_e(camera)}
    for name, field in SET.items():
        table, key = field.split(".")
        numbers[name] = getattr(getattr(camera, table), key)
    return tuple(
        f"gain is {found.label!r}, whose {name} is {wanted:.6g}, and the camera's is "
        f"{'not set' if has is None else f'{has:.6g}'}; call camera.at_gain after all other changes, or leave gain out"
        for name, has in numbers.items()
        if (wanted := getattr(found, name)) is not None
        and (has is None or not math.isclose(has, wanted, rel_tol=SAME))
    )
