"""Everything public that is called with names: a wrong name is one sentence, wherever it is."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.argument_names import tells_of_names

CAMERA = ms.load_camera("konnik_table1")
UNKNOWN = "no_such_name"
OF_PYTHON = (BaseException, ms.Stage)
"""Errors, which take any text, and the class that users derive their stages from."""


def functions_of(name: str, public: Any) -> Iterator[tuple[str, Callable[..., Any]]]:
    """A function, or what makes an object of a class and its public methods, by the names that users write."""
    if not isinstance(public, type):
        if inspect.isfunction(public):
            yield name, public
        return
    ours = (public.__module__ or "").startswith(ms.__name__)
    if not ours or issubclass(public, OF_PYTHON):
        return
    yield name, public
    for method in vars(public):
        function = getattr(public, method)
        called = inspect.isfunction(function) or inspect.ismethod(function)
        if called and not method.startswith(("_", "model_")):
            yield f"{name}.{method}", function


def public_functions() -> dict[str, Callable[..., Any]]:
    found = dict[str, Callable[..., Any]]()
    for module, prefix in ((ms, ""), (ms.lab, "lab.")):
        for name in module.__all__:
            found |= functions_of(prefix + name, getattr(module, name))
    return found


PUBLIC = public_functions()
OPEN = {"Camera.replace", "Dataset.where", "Irradiance.with_lights", "Photons.changed"}
"""These take any name; what they do with a wrong one is theirs."""


@pytest.mark.parametrize("name", sorted(PUBLIC.keys() - OPEN))
def test_an_unknown_name_is_one_sentence(name: str) -> None:
    own = tuple([None] * ("." in name and "lab." not in name and name != "Frames.of"))
    with pytest.raises(ms.InputError, match=UNKNOWN):
        PUBLIC[name](*own, **{UNKNOWN: 1})


def test_there_are_many_and_the_open_ones_are_public() -> None:
    assert len(PUBLIC) > 90 and PUBLIC.keys() >= OPEN


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: ms.Photons(1.0, unknown=3), "'unknown' is not a field of Photons; its fields are mean, "),
        (lambda: ms.Photons(), "Photons needs mean"),
        (lambda: ms.SensorNoise("bayer_2mp", whit_e=3), "Did you mean 'white_e'?"),
        (lambda: ms.SensorNoise(), "SensorNoise needs camera"),
        (lambda: ms.SensorNoise("bayer_2mp", white_e=300)(unknown=1), "SensorNoise.__call__; its arguments are image"),
        (lambda: ms.Exposure(1, 2, 3), "given 3 values without a name, which are too many"),
        (lambda: ms.Exposure(1, time_s=3), "given time_s twice"),
        (lambda: CAMERA.replace({"adc.bits": 14}), r"write two stars before it: replace\(\*\*{…}\)"),
        (lambda: ms.expose(1.0, CAMERA, ms.Exposure(1), {"frames": 2}), r"expose\(…, \*\*{…}\)"),
        (lambda: ms.expose(1.0, CAMERA, exposure_s=0.1), r"exposure=Exposure\(time_s=0.1\)"),
        (lambda: ms.expose(), "expose needs photons"),
        (lambda: CAMERA.with_stage(1), "Camera.with_stage needs after"),
        (lambda: ms.list_cameras(1), "list_cameras is given 1 value without a name"),
        (lambda: ms.Camera(naem="x"), "Camera: naem is not a field of a camera file"),
        (lambda: ms.Camera("konnik_table1"), r"Camera is given 1 value without a name"),
    ],
)  # fmt: skip
def test_the_sentence_says_what_to_write(call: Callable[[], object], said: str) -> None:
    with pytest.raises(ms.InputError, match=said):
        call()


def test_what_fits_is_called_and_errors_of_the_body_are_left_alone() -> None:
    @tells_of_names
    def scaled(values: Any, factor: float = 2.0) -> Any:
        """Values times a factor."""
        return values * factor

    assert scaled(3) == 6 and scaled(values=3, factor=1) == 3
    assert str(inspect.signature(scaled)) == "(values: 'Any', factor: 'float' = 2.0) -> 'Any'"
    with pytest.raises(TypeError, match="unsupported operand"):
        scaled(None)
    camera = ms.Camera(**CAMERA.model_dump())
    np.testing.assert_array_equal(camera.qe([550.0]), CAMERA.qe([550.0]))


FRAMES = ms.expose(np.full((4, 6), 100.0), CAMERA, ms.Exposure(0.01), engine="numpy")
ARRAY = np.zeros((2, 2))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: ms.lab.read_bench(CAMERA), r"path is <Camera: .*; pass a path, e.g. 'bench/'"),
        (lambda: ms.Dataset(3), "folder is 3; pass a path, e.g. 'pairs/'"),
        (lambda: ms.read_irradiance(0), "path is 0; pass a path, e.g. 'out/irradiance.exr'"),
        (lambda: FRAMES.save(int), "folder is <class 'int'>; pass a path, e.g. 'out/'"),
        (lambda: FRAMES.preview("x"), "number is 'x'; the frames are numbered from 0 to 0"),
        (lambda: FRAMES.preview(1), "number is 1; the frames are numbered from 0 to 0"),
        (lambda: FRAMES.preview(ARRAY), "number is array"),
        (lambda: CAMERA.filter_index(0), r"shape is 0; it must be \(rows, columns\)"),
        (lambda: CAMERA.filter_index((2, 3), 1.5), r"origin is 1.5; it must be \(row, column\)"),
        (lambda: CAMERA.filter_index((2, "x")), "shape is 'x'; it must be a whole number"),
        (lambda: CAMERA.qe([550.0], "x"), "bandwidths_nm is not numeric; pass widths in nm"),
        (lambda: CAMERA.qe([550.0], [1.0, 2.0]), r"bandwidths_nm has shape \(2,\) and .* one width per band"),
        (lambda: ms.SensorNoise(CAMERA, white_e=3, output=ARRAY), "output is array.*; it must be one of raw"),
        (lambda: ms.light_from_rgb(np.ones((2, 2, 3)), CAMERA, unit=ARRAY), "unit is array"),
        (
            lambda: ms.differentiable(ARRAY, CAMERA, ms.Exposure(0.01), parameters=3),
            "parameters is 3; pass names of fields",
        ),
    ],
)  # fmt: skip
def test_a_value_of_another_type_is_named_and_what_to_pass(
    call: Callable[[], object], said: str
) -> None:
    """Found by random arguments: each of these was a TypeError, a ValueError or an IndexError."""
    with pytest.raises(ms.InputError, match=said):
        call()
