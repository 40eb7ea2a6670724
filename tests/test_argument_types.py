"""A value of another type is named, with what to pass instead."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import mitsuba_sensor as ms

CAMERA = ms.load_camera("konnik_table1")
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
