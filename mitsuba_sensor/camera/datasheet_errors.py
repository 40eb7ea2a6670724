"""Errors of camera, motion and dataset files: value, allowed values, example and meaning of each wrong field.

Unknown fields get a suggestion, which may come from the terms of datasheets and standards.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple, TypeAlias, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..core import closest, nearest
from ..core.errors import shown
from ..core.number_text import number_hint
from ..stages.usual_range import Usual

Loc: TypeAlias = tuple[str | int, ...]

KEY = "[key]"  # in the location of an error about a key, instead of its value
NUMBER_TYPES, CHOICE_TYPE = ("float_type", "int_type"), "literal_error"
TEXTS = {
    r"^\w+ should ": "",
    r"valid dictionary.*": "table",
    r"valid tuple": "list",
    r"valid (integer|.*fractional part)": "whole number",
    r"valid string": "text in quotes",
    r"valid | after validation.*": "",
    r"greater than or equal to 0\.0{29}1": "above 0",
    r"greater than or equal to": "at least",
    r"less than or equal to": "at most",
    r"greater than": "above",
    r"less than": "below",
}
"""Pattern in Pydantic's messages → replacement."""

GAIN = "readout.gain_dn_per_e"
TERMS = {
    GAIN: "k gain system_gain overall_system_gain camera_gain gain_dn gain_adu sensor_gain dn_per_e adu_per_e",
    "readout.sense_gain_uv_per_e": (
        "conversion_gain cvf charge_conversion_gain sense_node_gain uv_per_e conversion_gain_uv_per_e"
    ),
    "source_follower.read_noise_e": (
        "read_noise readout_noise temporal_dark_noise dark_noise sigma_d sigma_read noise_floor temporal_noise"
    ),
    "pixel.full_well_e": (
        "full_well full_well_capacity fwc well well_depth well_capacity saturation saturation_capacity "
        "mu_e_sat u_e_sat charge_capacity linear_full_well"
    ),
    "quantum_efficiency.value": "qe eta quantum_efficiency peak_qe efficiency",
    "dark_current.rate_e_per_s": (
        "dark_current dark_rate dark_signal dark_current_rate mu_i u_i u_i_mean mu_i_mean dark_e_per_s"
    ),
    "dark_current.at_temperature_k": "dark_temperature reference_temperature dark_current_temperature",
    "dark_current.doubling_k": "doubling_temperature t_d doubling",
    "dark_current.cv": "dcnu dark_current_nonuniformity dark_fpn",
    "adc.bits": (
        "bits bit_depth bitdepth adc_bits resolution_bits adc_resolution quantisation quantization digitization"
    ),
    "adc.black_level_dn": "black_level offset dark_level bias bias_level black blacklevel",
    "adc.full_scale_v": "full_scale adc_range adc_full_scale reference_voltage",
    "pixel.pitch_x_um": "pixel_pitch pitch pixel_size pixel_width pitch_um pixel_size_um pitch_x size_x",
    "pixel.pitch_y_um": "pixel_height pitch_y size_y",
    "pixel.fill_factor": "fillfactor ff",
    "pixel.prnu": "prnu prnu1288 photo_response_nonuniformity gain_nonuniformity",
    "pixel.dsnu_e": "dsnu dsnu1288 dark_signal_nonuniformity offset_nonuniformity",
    "readout.row_noise_e": "row_noise temporal_row_noise",
    "readout.column_noise_e": "column_noise temporal_column_noise",
    "readout.frame_noise_e": "frame_noise black_level_jitter offset_jitter temporal_frame_noise",
    "sensor.columns": "columns width pixels_x horizontal_pixels x_resolution resolution cols image_width",
    "sensor.rows": "rows height pixels_y vertical_pixels y_resolution lines image_height",
    "sensor.row_time_us": "row_time line_time",
    "lens.f_number": "f_number fnumber aperture f_stop f",
    "lens.focal_length_mm": "focal_length focal_length_mm",
}
"""Key → its names on datasheets, separated by blanks."""
RECIPROCALS = (
    "inverse_gain inverse_k conversion_factor e_per_dn e_per_adu gain_e_per_dn gain_e_per_adu"
)
"""Names of electrons per DN, the reciprocal of the gain."""
MEANT = {term: key for key, terms in TERMS.items() for term in terms.split()}
MEANT |= dict.fromkeys(RECIPROCALS.split(), GAIN)
UNIT = re.compile(r"_(?:e|dn|um|nm|v|uv|k|c|s|us|percent|pct|electrons|adu|bit)$")


def inner_table(annotation: Any) -> tuple[type[BaseModel] | None, Any]:
    """Return the table inside an annotation, and tuple or dict if the annotation holds several tables."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation, None
    for part in get_args(annotation):
        table, container = inner_table(part)
        if table:
            origin = get_origin(annotation)
            return table, origin if origin in (tuple, dict) else container
    return None, None


@cache
def fields_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return every field of a model and of the tables below it, by dotted name."""
    fields = {}
    for name, info in model.model_fields.items():
        fields[name] = info
        table, container = inner_table(info.annotation)
        if table and not container:
            fields |= {f"{name}.{below}": x for below, x in fields_of(table).items()}
    return fields


class Fault(NamedTuple):
    """An error.  loc : place in the file.  kind : Pydantic's name of the error."""

    loc: Loc
    text: str
    kind: str


def faults(error: ValidationError, model: type[BaseModel], kind: str = "camera") -> list[Fault]:
    """Return all errors, unknown fields first; a misspelled required field counts once.  kind : of the file."""
    errors = {
        tuple(part for part in details["loc"] if part != KEY): details
        for details in error.errors(include_url=False)
    }
    missing = {dotted(loc) for loc, details in errors.items() if details["type"] == "missing"}
    meant = {
        loc: _meant(loc, details["input"], model, missing)
        for loc, details in errors.items()
        if details["type"] == "extra_forbidden"
    }
    wrong = [
        Fault(loc, _text(loc, details, model, kind, meant.get(loc)), details["type"])
        for loc, details in errors.items()
        if details["type"] != "missing" or dotted(loc) not in meant.values()
    ]
    return sorted(wrong, key=lambda fault: fault.loc not in meant)


def sentence(
    error: ValidationError, model: type[BaseModel], where: str, kind: str = "camera"
) -> str:
    """Return the message about the first error.  where : name of the file.  kind : of the file."""
    return f"{where}: {faults(error, model, kind)[0].text}"


def dotted(loc: Loc) -> str:
    """Return the place of a value as a dotted name."""
    return ".".join(map(str, loc))


def _meant(loc: Loc, value: object, model: type[BaseModel], missing: set[str]) -> str | None:
    """Return the field that an unknown field or table probably means; missing fields are tried first."""
    path = dotted(loc)
    _, table = _declared(loc, model)
    known = [*fields_of(model), *(dotted((*loc[:-1], name)) for name in table.model_fields)]
    known = [
        name for name in known if len(loc) == 1 or "." in name
    ]  # no whole table for a field
    names = [path]
    if isinstance(value, Mapping):
        names += [f"{path}.{key}" for key in value]
    meant = (key_meant(name, keys) for name in names for keys in (missing, known))
    return next(filter(None, meant), None)


def _text(
    loc: Loc, details: ErrorDetails, model: type[BaseModel], kind: str, meant: str | None
) -> str:
    """Return the message about an error.  meant : the field that an unknown field means."""
    path, what, value = dotted(loc), details["type"], details["input"]
    if what == "extra_forbidden":
        return unknown_field(loc, meant, model, kind)
    if what == "value_error":
        reason = str(details["ctx"]["error"]).removesuffix(".")
        return f"{f'{path}: ' if path else ''}{reason}{'' if reason.endswith('?') else '.'}"
    field, _ = _declared(loc, model)
    about = ""
    if field and field.description:
        example = (
            f", e.g. {field.examples[0]!r}" if field.examples and what != CHOICE_TYPE else ""
        )
        about = f"{example} ({field.description})"
    if what == "missing":
        return f"{path} is missing; add {f'it{about}' if about else f'the table [{path}]'}."
    rule = details["msg"]
    for pattern, ours in TEXTS.items():
        rule = re.sub(pattern, ours, rule)
    rule = re.sub(r"\d+\.\d{7,}|\d{9,}", lambda long: f"{float(long[0]):.10g}", rule)
    hint = ""
    if what in NUMBER_TYPES:
        hint = number_hint(path, value)
    elif field and (usual := usual_of(field)):
        hint = next((usual.right(number) for number in _numbers(value)), "")
    text = f"{path} is {shown(value)[:60]}; it must {rule}{about}{hint and f'; {hint}'}."
    if what == CHOICE_TYPE:
        text += nearest(str(value), re.findall(r"'([^']*)'", details["ctx"]["expected"]))
    if what not in NUMBER_TYPES and MEANT.get(path) in fields_of(model):
        text += proposal(path, MEANT[path])
    return text


def unknown_field(loc: Loc, meant: str | None, model: type[BaseModel], kind: str) -> str:
    """Return the message about a field that does not exist.  meant : the field that it means.  kind : of the file."""
    path = dotted(loc)
    end = proposal(path, meant)
    if not end:
        table = _declared(loc, model)[1]
        tables = [part for part in loc[:-1] if isinstance(part, str)]
        around = "the file" if table is model else f"[{'.'.join(tables)}]"
        end = f" The fields of {around} are {', '.join(table.model_fields)}."
    return f"{path} is not a field of a {kind} file.{end}"


def _declared(loc: Loc, model: type[BaseModel]) -> tuple[FieldInfo | None, type[BaseModel]]:
    """Return the innermost declared field around a value, and the innermost table around it."""
    field, table, parts = None, model, iter(loc)
    for part in parts:
        if part not in table.model_fields:
            break
        field = table.model_fields[str(part)]
        inner, container = inner_table(field.annotation)
        if inner is None:
            break
        table = inner
        if container:
            next(parts, None)  # the index in a list, or a name that the file chooses
    return field, table


def doubts(data: Mapping[str, Any], model: type[BaseModel]) -> list[tuple[str, str]]:
    """Return the field and a note for every number of a file that is outside its usual range."""
    notes = []
    for name, field in fields_of(model).items():
        usual, value = usual_of(field), _value_at(data, name)
        unusual = next((x for x in _numbers(value) if usual and not usual.includes(x)), None)
        if usual and unusual is not None:
            verb = "is" if isinstance(value, int | float) else "has"
            notes.append((name, usual.doubt(name, unusual, verb)))
    return notes


def _value_at(data: object, name: str) -> object:
    """Return the value of a field, or None if it is unset."""
    for part in name.split("."):
        data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _numbers(value: object) -> Iterator[float]:
    """Yield the numbers that a float can hold, in a value, list or table."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for element in value:
            yield from _numbers(element)
    elif type(value) in (int, float) and abs(value) <= sys.float_info.max:  # type: ignore[arg-type]
        yield value  # type: ignore[misc]


def usual_of(field: FieldInfo) -> Usual | None:
    """Return the declared usual range of a number of a camera file, or None."""
    return next((item for item in field.metadata if isinstance(item, Usual)), None)


def key_meant(name: str, known: Iterable[str]) -> str | None:
    """Return the key that a datasheet's name means or misspells, or None.

    name : dotted, ``pixel.full_well`` or ``K``.  known : all keys.
    """
    keys = {key for key in known if not name.startswith(f"{key}.")}
    last = _as_term(name.rpartition(".")[2])
    for term in (_as_term(name), last, UNIT.sub("", last)):
        if MEANT.get(term) in keys:
            return MEANT[term]
    longer = [key for key in keys if key.rpartition(".")[2].startswith(f"{last}_")]
    return longer[0] if len(longer) == 1 else closest(name, sorted(keys))


def proposal(name: str, key: str | None) -> str:
    """Return `` Did you mean …?`` with the key that a name means; empty without a key."""
    if key is None:
        return ""
    if _as_term(name.rpartition(".")[2]) in RECIPROCALS.split():
        return f" Did you mean {key!r}, the reciprocal of the electrons per DN?"
    return f" Did you mean {key!r}?"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `` Did you mean …?`` with the key that a name means; empty if it means none."""
    return proposal(name, key_meant(name, known))


def _as_term(name: str) -> str:
    """Return a name in lower case with _ between its words."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
