"""What is typed wrong in Python: one InputError each, with the value or the way out, and nothing is written.

tests/data/wrong_inputs.txt has more, with whole command lines.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms

ONES = np.ones((4, 4))
NAMES: dict[str, Any] = {
    "ms": ms,
    "np": np,
    "camera": ms.load_camera("konnik_table1"),
    "colour": ms.load_camera("bayer_2mp"),
    "exposure": ms.Exposure(0.01),
    "ones": ONES,
    "hidden": np.ma.masked_array(ONES, np.eye(4, dtype=bool)),
    "hidden_nm": np.ma.masked_array([550.0], [True]),
    "gain": ms.lab.Quantity("K", "gain", 0.25, 0.24, 0.26, "DN/e-", "6.6"),
}

WRONG = {
    # values of another type: each of these was a TypeError, a ValueError or an IndexError
    "ms.lab.read_bench(camera)": "path is <Camera: ",
    "ms.Dataset(3)": "folder is 3",
    "ms.read_irradiance(0)": "path is 0",
    "frames.save(int)": "folder is <class 'int'>",
    "frames.save('frame.tiff')": "looks like a file",
    "frames.preview('x')": "number is 'x'",
    "frames.preview(1)": "number is 1",
    "frames.preview(ones)": "number is array",
    "ms.write_tiff('x.tiff', frames)": "frames.digital",
    "ms.write_tiff(frames, 'x.tiff')": "the path is the first argument",
    "ms.write_tiff('x.tiff', frames.digital.astype(np.int64))": "frames",
    "camera.filter_index(0)": "shape is 0",
    "camera.filter_index((2, 3), 1.5)": "origin is 1.5",
    "camera.filter_index((2, 'x'))": "shape is 'x'",
    "camera.qe([550.0], 'x')": "bandwidths_nm is not numeric",
    "camera.qe([550.0], [1.0, 2.0])": "bandwidths_nm has shape (2,)",
    "ms.SensorNoise(camera, white_e=3, output=ones)": "output is array",
    "ms.light_from_rgb(np.ones((2, 2, 3)), camera, unit=ones)": "unit is array",
    "ms.differentiable(ones, camera, exposure, parameters=3)": "parameters is 3",
    "ms.check_stage(camera.stages[1], camera=np.float32(2))": "camera is ",
    "gain.covers([0.25, 0.3])": "value ",
    "gain.covers(None)": "value ",
    "setattr(camera, 'name', 'x')": "camera.replace",
    "setattr(camera.adc, 'bits', 10)": "bits cannot be changed in place",
    "frames - 3": "frames.minus(dark)",
    "np.ones(3) - frames": "frames.minus(dark)",
    "ms.plan(camera, exposure, light)": "collect(light, camera, exposure)",
    "ms.expose(ones)": "camera is None",
    "ms.expose(light)": "the irradiance names none",
    "ms.capture(light, None, exposure)": "no camera is given",
    "ms.expose('light.exr', camera, exposure)": "read the file first",
    "ms.capture(ones, camera, exposure)": "an array of shape (4, 4)",
    # words of one's own
    "ms.expose(ones, camera, exposure_s=0.1)": "Pass exposure=Exposure(time_s=0.1",
    "ms.expose(ones, camera, integration_time=2)": "Pass exposure=Exposure(",
    "ms.expose(ones, camera, iso=800)": "gain",
    "ms.expose(ones, camera, n_frames=3)": "frames",
    "ms.expose(ones, camera, tolerance_db=3)": "Did you mean 'tolerance_dn'",
    "ms.capture('flat_field', camera, 0.1)": "pass Exposure(time_s=0.1)",
    "ms.load_camera('sony_imx147')": "Did you mean 'sony_imx174'",
    "ms.load_camera('IMX 477')": "Did you mean 'raspberry_pi_hq'",
    "ms.Exposure(0.1, temperature=300)": "Did you mean 'temperature_k'",
    "ms.Exposure(0.1, iso=800)": "The arguments are time_s, temperature_k",
    "ms.Sensor(camera, seril=1)": "Did you mean 'serial'",
    "ms.Metering(shre=1)": "Did you mean 'share'",
    "ms.AutoExposure(dampng=1)": "Did you mean 'damping'",
    "ms.Photons(ones, wavelength_nm=500)": "Did you mean 'wavelengths_nm'",
    # arguments of exposures
    "ms.expose(ones, camera, exposure, first_frame=2**32)": "from 0 to 4294967295",
    "ms.expose(ones, camera, exposure, seed=2**64)": "seed is 18446744073709551616",
    "ms.expose(ones, camera, exposure, keep=None)": "keep names None",
    "ms.expose(ones, camera, exposure, keep=ones)": "keep names array",
    "ms.Exposure('9' * 5000)": "time_s is '999",  # took 27 s
    "ms.capture('9' * 5000, camera, exposure)": "there is no file",
    "ms.read_irradiance('\\0')": "No such file",
    "ms.expose(ones, 'scmos_dual_gain', exposure, keep='volts')": "scmos_dual_gain combines",
    "ms.expose(ones, camera, exposure, maps={'prnu': [['1.0'] * 4] * 4})": "not numeric",
    "ms.expose(ones, camera, exposure, maps={'prnu': ones * 1j})": "complex",
    "ms.expose(ones, camera, exposure, maps={'prnu': [[1.0], [1.0, 2.0]]})": "rows of different lengths",
    "ms.expose(ones, camera, exposure, maps={3: ones})": "maps names 3",
    "ms.expose(ones, camera, exposure, plan='fast')": "pass what plan",
    "ms.expose(ones, camera, exposure, wavelengths_nm='green')": "numbers in nm",
    "ms.expose(ones, camera, exposure, wavelengths_nm=[np.inf])": "wavelengths_nm is inf",
    "ms.expose([[1.0, 2.0], [3.0]], camera, exposure)": "photons has rows",
    "ms.expose({'mean': 1000}, camera, exposure)": "photons is not numeric",
    # pictures
    "ms.expose(np.ones((3, 20, 30)), camera, exposure)": "ms.light_from_rgb",
    "ms.expose(np.ones((20, 30, 3)), camera, exposure)": "ms.light_from_rgb",
    "ms.SensorNoise(colour, white_e=100)(np.ones((3, 20, 30)))": "planes",
    "ms.expose(ms.Photons(np.ones((4, 4, 2)), detected=True), colour, exposure)": "(H, W, 3)",
    "ms.expose(ms.Photons(np.ones((4, 4, 3)), detected=True), colour, exposure, keep='photons')": "keep",
    # masked values: NumPy drops the mask and goes on with what is under it
    **dict.fromkeys(
        (
            "ms.expose(hidden, camera, exposure)",
            "ms.stream(hidden, camera, exposure)",
            "ms.expose(ms.Photons(hidden[..., None], [550.0]), colour, exposure)",
            "ms.differentiable(hidden, camera, exposure, 'photons')",
            "ms.expose(ones, camera, exposure, wavelengths_nm=hidden_nm)",
            "ms.expose(ones, camera, exposure, maps={'prnu': hidden})",
            "ms.collect(hidden, camera, exposure)",
            "ms.lab.Stack(hidden[None], 0.01)",
            "ms.write_tiff('x.tiff', hidden.astype(np.uint16))",
            "camera.qe(hidden_nm)",
        ),
        "masked value(s)",
    ),
    # True would be one second, one kelvin, one nanometre
    **{
        call.replace("yes", yes): "True"
        for yes in ("True", "np.True_")
        for call in (
            "ms.Exposure(time_s=yes)",
            "ms.Exposure(1.0, yes)",
            "ms.collect(ones, camera, exposure, wavelengths_nm=yes)",
            "camera.replace(**{'pixel.full_well_e': yes})",
            "ms.Sensor(camera, most_bytes=yes)",
            "ms.lab.Stack(ones[None], yes)",
        )
    },
    "ms.expose(ones, camera, exposure, maps={'prnu': ones == 1})": "Boolean",
    "camera.qe([True])": "Boolean",
}


@pytest.mark.parametrize("call", WRONG)
def test_a_wrong_call_is_one_sentence(
    call: str, light: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    frames = ms.expose(ONES, "konnik_table1", ms.Exposure(0.01), engine="numpy")
    with pytest.raises(ms.InputError) as error:
        eval(call, NAMES | {"light": light, "frames": frames})
    assert WRONG[call] in str(error.value)
    assert not list(tmp_path.iterdir())


def test_a_masked_array_in_which_nothing_is_masked_is_an_array() -> None:
    whole, masked = (
        ms.expose(one, "konnik_table1", ms.Exposure(0.01)).digital
        for one in (ONES, np.ma.masked_array(ONES))
    )
    np.testing.assert_array_equal(masked, whole)
