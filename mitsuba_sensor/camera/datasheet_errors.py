"""Sentences from a failed check of a camera or motion file: field, value, allowed range, meaning and example.

Terms of data sheets and standards say which key is proposed where one is not known.
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

from ..core import closest
from ..core.errors import shown
from ..core.number_text import number_hint
from ..stages.usual_range import Usual

Loc: TypeAlias = tuple[str | int, ...]

KEY = "[key]"  # where pydantic's errors name a key of a table instead of its value
NUMBER_TYPES = ("float_type", "int_type")
TEXTS = {
    r"^\w+ should ": "",
    r"valid dictionary.*": "table",
    r"valid tuple": "list",
    r"valid (integer|.*fractional part)": "whole number",
    r"valid string": "text in quotes",
    r"valid | after validation.*": "",
    r"greater than or equal to": "at least",
    r"less than or equal to": "at most",
    r"greater than": "above",
    r"less than": "below",
}
"""Pydantic's texts → those of a camera file."""

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
"""Key → terms that mean it, apart by blanks."""
ONE_OVER = {
    "inverse_gain",
    "inverse_k",
    "conversion_factor",
    "e_per_dn",
    "e_per_adu",
    "gain_e_per_dn",
    "gain_e_per_adu",
}
"""Terms for electrons per DN, which are one over the gain."""
MEANT = {term: key for key, terms in TERMS.items() for term in terms.split()}
MEANT |= dict.fromkeys(ONE_OVER, GAIN)
UNIT = re.compile(r"_(?:e|dn|um|nm|v|uv|k|c|s|us|percent|pct|electrons|adu|bit)$")


def inner_table(annotation: Any) -> tuple[type[BaseModel] | None, Any]:
    """Return the table inside an annotation, and tuple or dict if there are several of them."""
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
    """One error.  loc : its place in the file.  kind : pydantic's name of the error."""

    loc: Loc
    text: str
    kind: str


def faults(error: ValidationError, model: type[BaseModel], kind: str = "camera") -> list[Fault]:
    """Return all errors; an unknown field in place of a missing one counts once.  kind : of the file."""
    found = [
        (tuple(part for part in one["loc"] if part != KEY), one["type"], one)
        for one in error.errors(include_url=False)
    ]
    missing = {dotted(loc) for loc, what, _ in found if what == "missing"}
    meant = {
        loc: _meant(loc, one["input"], model, missing)
        for loc, what, one in found
        if what == "extra_forbidden"
    }
    return [
        Fault(loc, _text(loc, one, model, kind, meant.get(loc)), what)
        for loc, what, one in found
        if what != "missing" or dotted(loc) not in meant.values()
    ]


def sentence(
    error: ValidationError, model: type[BaseModel], where: str, kind: str = "camera"
) -> str:
    """Return the first error as one sentence.  kind : of the file."""
    return f"{where}: {faults(error, model, kind)[0].text}"


def dotted(loc: Loc) -> str:
    """Return the place of a value as one name."""
    return ".".join(map(str, loc))


def _meant(loc: Loc, value: object, model: type[BaseModel], missing: set[str]) -> str | None:
    """Return the field that an unknown one probably means, first among the missing ones; for an unknown table, the
    field that one of its keys means."""
    path = dotted(loc)
    _, table = _declared(loc, model)
    known = [*fields_of(model), *(dotted((*loc[:-1], name)) for name in table.model_fields)]
    names = [path]
    if isinstance(value, Mapping):
        names += [f"{path}.{key}" for key in value]
    meant = (key_meant(name, keys) for name in names for keys in (missing, known))
    return next(filter(None, meant), None)


def _text(
    loc: Loc, one: ErrorDetails, model: type[BaseModel], kind: str, meant: str | None
) -> str:
    """Return the sentence of an error.  meant : the field that an unknown one means."""
    path, what, value = dotted(loc), one["type"], one["input"]
    if what == "extra_forbidden":
        return f"{path} is not a field of a {kind} file.{proposal(path, meant)}"
    if what == "value_error":
        said = str(one["ctx"]["error"]).removesuffix(".")
        return f"{path or f'the {kind}'}: {said}{'' if said.endswith('?') else '.'}"
    field, _ = _declared(loc, model)
    about = f"add the table [{path}]"
    if field and field.description:
        example = f", e.g. {field.examples[0]!r}" if field.examples else ""
        about = f"{field.description}{example}"
    if what == "missing":
        return f"{path} is missing; {about}."
    rule = one["msg"]
    for pattern, ours in TEXTS.items():
        rule = re.sub(pattern, ours, rule)
    rule = re.sub(r"\d+\.\d{7,}|\d{9,}", lambda long: f"{float(long[0]):.10g}", rule)
    hint = ""
    if what in NUMBER_TYPES:
        hint = number_hint(path, value)
    elif field and (usual := usual_of(field)):
        hint = next((usual.right(number) for number in _numbers(value)), "")
    text = f"{path} is {shown(value)[:60]}; it must {rule} ({about}{hint and f'; {hint}'})."
    if what not in NUMBER_TYPES and MEANT.get(path) in fields_of(model):
        text += proposal(path, MEANT[path])
    return text


def _declared(loc: Loc, model: type[BaseModel]) -> tuple[FieldInfo | None, type[BaseModel]]:
    """Return the last declared field on the way to a value, and the innermost table around the value."""
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
    """Return field and sentence for every number of a file that is outside its usual range."""
    found = []
    for name, field in fields_of(model).items():
        usual, value = usual_of(field), _value_at(data, name)
        unusual = next((x for x in _numbers(value) if usual and not usual.includes(x)), None)
        if usual and unusual is not None:
            verb = "is" if isinstance(value, int | float) else "has"
            found.append((name, usual.doubt(name, unusual, verb)))
    return found


def _value_at(data: object, name: str) -> object:
    """Return the value of a field, None if it is not set."""
    for part in name.split("."):
        data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _numbers(value: object) -> Iterator[float]:
    """Yield the numbers in a value, which may be a list or a table, that a float can hold."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for one in value:
            yield from _numbers(one)
    elif type(value) in (int, float) and abs(value) <= sys.float_info.max:  # type: ignore[arg-type]
        yield value  # type: ignore[misc]


def usual_of(field: FieldInfo) -> Usual | None:
    """Return the usual range of a number of a camera file, if it is declared."""
    return next((one for one in field.metadata if isinstance(one, Usual)), None)


def key_meant(name: str, known: Iterable[str]) -> str | None:
    """Return the key that a name of a data sheet means, or of which it is a misspelling.

    name : dotted, ``pixel.full_well`` or ``K``.  known : keys that there are.
    """
    keys = set(known)
    last = _as_term(name.rpartition(".")[2])
    for term in (_as_term(name), last, UNIT.sub("", last)):
        if MEANT.get(term) in keys:
            return MEANT[term]
    return closest(name, sorted(keys))


def proposal(name: str, key: str | None) -> str:
    """Return `` Did you mean …?`` with the key that a name means, or an empty text without a key."""
    if key is None:
        return ""
    if _as_term(name.rpartition(".")[2]) in ONE_OVER:
        return f" Did you mean {key!r}, which is one over the electrons per DN?"
    return f" Did you mean {key!r}?"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `` Did you mean …?`` with the key that a name means, or an empty text."""
    return proposal(name, key_meant(name, known))


def _as_term(name: str) -> str:
    """Return a name in small letters, with _ between its terms."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
