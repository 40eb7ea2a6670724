"""Errors and notes name what the caller used: arguments in Python, flags on the command line."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
import mitsuba_sensor.cli.commands
from mitsuba_sensor.cli.flag_names import with_flags

TABLE = {
    "spp is 0; it must be at least 1": "--spp is 0; it must be at least 1",
    "gain is '800'; the gain settings are 100, 400": "--gain is 800; the gain settings are 100, 400",
    "spp is 16 and noise_ratio is 0.1; omit one of them.": "--spp is 16 and --noise-ratio is 0.1; omit one of them.",
    "luminance is 0.0; it must be above 0": "--luminance is 0; it must be above 0",
    "luminance is 0.05 and the picture is black": "--luminance is 0.05 and the picture is black",
    "time_s is -1; it must be at least 0": "--exposure-s is -1; it must be at least 0",
    "raise spp=, or set noise_ratio=0.1.": "raise --spp, or set --noise-ratio 0.1.",
    "the frame is wide; set width=640 (first_frame=3)": "the frame is wide; set --width 640 (--first-frame 3)",
    "set denoise=False or denoise=True": "set --no-denoise or --denoise",
    "pass light_groups='auto'": "pass --light-groups auto",
    "pass infrared={'leaf_*': 'vegetation'}.": "pass --infrared 'leaf_*=vegetation'.",
    'set lights={"lamps": 0.2}': "set --light lamps=0.2",
    "pass Exposure(time_s=0.1, temperature_k=290).": "pass --exposure-s 0.1 --temperature-k 290.",
    'pass exposure=Exposure(time_s=0.1), or exposure="auto".': "pass --exposure-s 0.1, or --exposure-s auto.",
    'use camera.replace(**{"adc.bits": 14, "readouts": None}).': "use --set adc.bits=14 --set readouts=none.",
    "use camera.at_gain('800').": "use --gain 800.",
    "use camera.at_readout('high').": "use --readout high.",
    "give both, and not both. None unsets a field.": "give both, and not both. --set FIELD=none unsets a field.",
    "ms.check_camera lists all 2 errors.": "`cameras check` lists all 2 errors.",
    "give tile=3, sensor.rows=12 or 'spp=2'": "give tile=3, sensor.rows=12 or 'spp=2'",
    "-D width=100, --set gain=3, a/width=3": "-D width=100, --set gain=3, a/width=3",
}
"""Message in Python → message on the terminal."""


@pytest.mark.parametrize("message", TABLE)
def test_arguments_become_flags(message: str) -> None:
    assert with_flags(message) == TABLE[message] == with_flags(TABLE[message])


PHOTONS = np.full((2, 1901), 9.0)
CALLS: dict[str, Callable[[], Any]] = {
    "outside the sensor": lambda: ms.expose(PHOTONS, "konnik_table1", ms.Exposure(0.1)),
    "saturated": lambda: ms.expose(PHOTONS[:, :9] * 1e8, "konnik_table1", ms.Exposure(0.1)),
    "temperature": lambda: ms.expose(PHOTONS[:, :9], "konnik_table1", ms.Exposure(0.1, 25)),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_a_warning_in_python_names_no_flag(call: Callable[[], Any]) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ms.SensorWarning)
        call()
    assert caught and not [
        x for x in caught if re.search(r"(^|[ (`])-{1,2}[a-zA-Z]", str(x.message))
    ]


@pytest.mark.parametrize("name", ["frames", "tolerance_dn"])
def test_an_error_names_the_argument_or_the_flag(
    name: str, light_file: Any, cli: Callable[..., Any]
) -> None:
    flag = f"--{name.replace('_', '-')}"
    done = cli("expose", light_file, "-o", light_file.parent / "none", flag, "-1")
    assert done.exit_code == 2 and f"error: {flag} is -1" in done.stderr
    with pytest.raises(ms.InputError, match=f"^{name} is -1"):
        ms.capture(light_file, **{name: -1})
