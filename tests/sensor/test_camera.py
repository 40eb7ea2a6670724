"""The camera file: every field of every table, by the schema, so that a new field is tested too."""

from __future__ import annotations

import copy
import functools
import json
import math
import pickle
import re
import tomllib
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.camera.datasheet_errors import fields_of
from mitsuba_sensor.camera.shipped import SHIPPED

TABLE1 = tomllib.loads((SHIPPED / "konnik_table1.toml").read_text("utf-8"))
SCHEMA = ms.Camera.model_json_schema()
REMEDY = r"(e\.g\. .+|must be ('.+'|a table)|add the table \[\w+\]|Did you mean '.+')"


@functools.cache
def schema_of(dotted: str) -> dict[str, Any]:
    """JSON Schema of a field, by its dotted name; without the null of an optional one."""
    here: dict[str, Any] = SCHEMA
    for part in dotted.split("."):
        here = here["properties"][part]
        here = next((x for x in here.get("anyOf", ()) if x.get("type") != "null"), here)
        here = SCHEMA["$defs"][here["$ref"].rpartition("/")[2]] if "$ref" in here else here
    return here


def required() -> list[str]:
    """Fields that a camera file cannot do without."""
    tables = ["", *(name for name in FIELDS if "properties" in schema_of(name))]
    found = []
    for table in tables:
        schema = schema_of(table) if table else SCHEMA
        found += [f"{table}.{name}".lstrip(".") for name in schema.get("required", ())]
    return found


FIELDS = tuple(fields_of(ms.Camera))
BY_WAVELENGTH = "sensor.extinction_ratio", "sensor.polarizer_transmission"
"""Fields that are one number, or one for each wavelength; their range is looked at by a function of its own."""
NUMBERS = tuple(
    name
    for name in FIELDS
    if schema_of(name).get("type") in ("number", "integer") and name not in BY_WAVELENGTH
)
CHOICES = tuple(name for name in FIELDS if "enum" in schema_of(name))
WRONG_TYPES: dict[str, tuple[Any, ...]] = {
    "number": ("many", "5", True, [1.0], {"value": 1}),
    "integer": ("many", "5", True, [1], {"value": 1}, 1.5),
    "string": (5, 0.5, True, ["a"], {"a": "b"}),
    "array": (5, "many", True, {"a": 1}),
    "object": (5, "many", True, [1]),
    "boolean": (5, "many", "true", [True], {"a": True}),
}
PINHOLE = {
    "name": "hole",
    "surfaces": [{"semi_diameter_mm": 1, "stop": True}, {"semi_diameter_mm": 1}],
}

ALONG = {"coefficients": [1.0], "powers_r": [0], "powers_dx": [0], "powers_dy": [1]}
RAY_TRANSFER = {
    "thickness_mm": 1,
    "pass_plane_mm": 1,
    "pass_circle_radii_mm": [1],
    "pass_circle_sensitivities": [0],
    "polynomials": [{"output": name, **ALONG} for name in ("x", "y", "dx", "dy")],
}


def with_field(dotted: str, new: Any) -> dict[str, Any]:
    """Table 1 with one field set, or taken away (``...``)."""
    data = copy.deepcopy(TABLE1)
    *path, last = dotted.split(".")
    if path[:2] == ["lens", "prescription"]:
        data["lens"]["prescription"] = copy.deepcopy(PINHOLE)
    if path[2:] == ["ray_transfer"]:
        lens = {"name": "linear", "ray_transfer": copy.deepcopy(RAY_TRANSFER)}
        data["lens"]["prescription"] = lens
    table = data
    for part in path:
        table = table.setdefault(part, {})
    if new is ...:
        del table[last]
    else:
        table[last] = new
    return data


def refusal(data: dict[str, Any]) -> str:
    """The one sentence with which a camera is refused; it says what was given, and is one line."""
    with pytest.raises(ms.InputError) as caught:
        ms.load_camera(data)
    message = str(caught.value)
    assert message.startswith("the dict: ") and "\n" not in message
    assert not re.search(
        "Input|pydantic|tuple|dictionary|instance of|Section|validation", message
    )
    return message.removeprefix("the dict: ")


def outside(dotted: str) -> list[float]:
    """Numbers just beyond the range that the schema gives, and what is no finite number."""
    schema = schema_of(dotted)
    bad: list[float] = [math.nan, math.inf, -math.inf] if schema["type"] == "number" else []
    if "exclusiveMinimum" in schema:
        bad += [schema["exclusiveMinimum"], schema["exclusiveMinimum"] - 1]
    if "minimum" in schema:
        bad += [schema["minimum"] - 1]
        if schema["type"] == "number" and schema["minimum"] > 0:
            bad += [0.0, 0.9 * schema["minimum"]]
    if "maximum" in schema:
        bad += [
            schema["maximum"] * 1.001 if schema["type"] == "number" else schema["maximum"] + 1
        ]
    return bad


@pytest.mark.parametrize("dotted", NUMBERS)
def test_every_number_out_of_range_is_refused_with_value_range_and_example(dotted: str) -> None:
    assert outside(dotted)
    for bad in outside(dotted):
        message = refusal(with_field(dotted, bad))
        assert re.match(
            rf"{dotted} is -?(nan|inf|[\d.e+-]+); it must be .+, e\.g\. .+ \(.+\)(; .+)?\.$",
            message,
        ), message
        assert repr(bad) in message


@pytest.mark.parametrize("dotted", FIELDS[::4])
def test_every_field_of_the_wrong_type_is_refused_with_the_way_out(dotted: str) -> None:
    """No coercion: "5" is no number, 1.5 is no count, true is not 1."""
    for bad in WRONG_TYPES[schema_of(dotted)["type"]]:
        if dotted in BY_WAVELENGTH and isinstance(bad, list):
            continue
        message = refusal(with_field(dotted, bad))
        assert message.startswith(dotted) and re.search(REMEDY, message), message


@pytest.mark.parametrize("dotted", CHOICES)
def test_every_unknown_choice_is_refused_with_the_choices(dotted: str) -> None:
    message = refusal(with_field(dotted, "unheard_of"))
    assert "'unheard_of'" in message
    assert all(repr(choice) in message for choice in schema_of(dotted)["enum"])


@pytest.mark.parametrize("dotted", required())
def test_every_missing_field_is_named_with_an_example(dotted: str) -> None:
    message = refusal(with_field(dotted, ...))
    assert re.match(rf"{dotted} is missing; .*{REMEDY}", message), message


@pytest.mark.parametrize("dotted", [name for name in FIELDS if "." in name][::4])
def test_every_misspelt_field_is_refused_with_the_right_one(dotted: str) -> None:
    """A letter too many, in a file and in replace(): the field that was meant is named."""
    data = with_field(dotted + "s", 1)
    message = refusal(data)
    assert dotted + "s" in message and f"Did you mean '{dotted}'?" in message
    with pytest.raises(ms.InputError, match=re.escape(f"Did you mean '{dotted}'?")):
        ms.load_camera("konnik_table1").replace(**{dotted + "s": 1})


NOT_ALONE = (
    *BY_WAVELENGTH,
    "lens.glare_width_mm",
    "dark_current",
    "source_follower",
    "readout.em_gain",
    "readout.ve_k1",
    "lens.focal_length_mm",
    "lens.focus_m",
    "lens.prescription",
)


@pytest.mark.parametrize("dotted", FIELDS)
def test_every_field_has_a_description_an_example_and_the_example_is_right(dotted: str) -> None:
    """What the schema and the sentences show must itself be accepted (tables have fields instead)."""
    schema = schema_of(dotted)
    if "properties" in schema:
        assert schema["description"]
        return
    info = fields_of(ms.Camera)[dotted]
    assert info.description and info.examples
    if schema["type"] == "number" and not dotted.startswith(NOT_ALONE):
        assert ms.load_camera("konnik_table1").replace(**{dotted: info.examples[0]})


def test_replace_makes_another_camera_and_leaves_the_first() -> None:
    camera = ms.load_camera("konnik_table1")
    other = camera.replace(**{"adc.bits": 14, "pixel.prnu": 0.01})
    assert (other.adc.bits, other.pixel.prnu) == (14, 0.01)
    assert (camera.adc.bits, camera.pixel.prnu) == (12, 0.005)
    assert other != camera and other.replace(**{"adc.bits": 12}) != camera
    assert (
        other.sources["adc.bits"] == "set by the user"
        and camera.sources["adc.bits"] != "set by the user"
    )
    assert camera.replace() == camera
    with pytest.raises(ValueError):
        camera.adc.bits = 14


@pytest.mark.parametrize("name", ms.list_cameras())
def test_every_number_of_a_shipped_camera_has_a_source(name: str) -> None:
    """Every number has a father; the curves of all filters share one. And no source speaks of what is not there."""
    data = tomllib.loads((SHIPPED / f"{name}.toml").read_text("utf-8"))
    camera = ms.load_camera(name)
    assert camera.name == name and camera.description

    def numbers(table: dict[str, Any], path: str) -> list[str]:
        found = []
        for key, x in table.items():
            dotted = f"{path}.{key}".lstrip(".")
            if isinstance(x, dict) and dotted != "quantum_efficiency.curves":
                found += numbers(x, dotted)
            elif not isinstance(x, str) and dotted != "quantum_efficiency.tile":
                found.append(dotted)
        return found

    wanted = set(numbers({k: v for k, v in data.items() if k != "sources"}, ""))
    assert wanted == set(camera.sources)
    assert all(len(text) > 8 for text in camera.sources.values())


@pytest.mark.parametrize("name", ms.list_cameras())
def test_a_shipped_camera_sees_its_reference_wavelength(name: str) -> None:
    camera = ms.load_camera(name)
    assert camera.qe([camera.quantum_efficiency.reference_nm]).max() > 0
    low, high = camera.band_nm
    assert 200 <= low < high <= 1800
    assert not camera.qe([low - 1, high + 1]).any()


def test_quantum_efficiency_is_linear_between_its_points_and_zero_outside() -> None:
    camera = ms.load_camera("konnik_table1").replace(
        **{
            "quantum_efficiency.wavelengths_nm": [400, 500, 700],
            "quantum_efficiency.curves": {"mono": [0.2, 0.6, 0.0]},
        }
    )
    np.testing.assert_allclose(
        camera.qe([399.999, 400, 425, 500, 650, 700, 700.001]),
        [[0, 0.2, 0.3, 0.6, 0.15, 0, 0]],
        atol=1e-12,
    )
    assert camera.band_nm == (400, 700)


def test_the_band_is_where_any_filter_sees_and_no_wider_than_its_neighbours() -> None:
    """From the last point before the first one that is seen, because the curve rises from there."""
    camera = ms.load_camera("konnik_table1").replace(
        **{
            "quantum_efficiency.wavelengths_nm": [300, 350, 400, 500, 600, 650, 700],
            "quantum_efficiency.curves": {
                "A": [0, 0, 0, 0.5, 0, 0, 0],
                "B": [0, 0, 0, 0, 0.5, 0, 0],
            },
            "quantum_efficiency.tile": [["A", "B"]],
        }
    )
    assert camera.band_nm == (400, 650)


def test_the_mosaic_repeats_from_the_first_pixel_of_the_sensor() -> None:
    camera = ms.load_camera("bayer_2mp")
    assert camera.filter_names == ("R", "G", "B")
    np.testing.assert_array_equal(camera.filter_index((2, 4)), [[0, 1, 0, 1], [1, 2, 1, 2]])
    np.testing.assert_array_equal(camera.filter_index((2, 2), origin=(1, 1)), [[2, 1], [1, 0]])
    np.testing.assert_array_equal(
        camera.filter_index((3, 3), (5, 4)), camera.filter_index((9, 9))[5:8, 4:7]
    )


@pytest.mark.parametrize("name", ms.list_cameras())
def test_a_camera_survives_pickling_and_copying(name: str) -> None:
    """Its chain too, once it is built; model_dump is what frame.json holds."""
    camera = ms.load_camera(name)
    stages = camera.stages
    for other in (
        pickle.loads(pickle.dumps(camera)),
        ms.Camera.model_validate(json.loads(json.dumps(camera.model_dump(), allow_nan=False))),
        copy.deepcopy(camera),
        camera.model_copy(),
    ):
        assert other == camera and other.stages == stages


def test_equal_cameras_have_one_hash() -> None:
    """However they came about; whole numbers and floats that are equal; another value has another one."""
    camera = ms.load_camera("bayer_2mp")
    again = ms.load_camera(camera.to_toml())
    whole, real = (camera.replace(**{"adc.black_level_dn": value}) for value in (64, 64.0))
    assert camera == again and hash(camera) == hash(again) and len({camera, again}) == 1
    assert whole == real and hash(whole) == hash(real) and hash(camera.lens) == hash(again.lens)
    others = [
        camera.replace(**{"adc.bits": 14}),
        *(ms.load_camera(name) for name in ms.list_cameras()),
    ]
    assert len({*others, camera}) == len(others)
