"""A sensor that is kept from call to call delivers the frames of expose(), and says what it keeps."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import backend_problem

EXPOSURE = ms.Exposure(0.1)
CAMERAS = {
    "table 1": ms.load_camera("konnik_table1").replace(
        **{"dark_current.cv": 0.4, "readout.prnu_col": 0.002}
    ),
    "rts, ar": ms.load_camera("konnik_table1").replace(
        **{
            "dark_current.rts_fraction": 0.1,
            "dark_current.rts_amplitude_e_per_s": 500.0,
            "pixel.dsnu_e": 5.0,
            "pixel.dsnu_coupling": 0.25,
        }
    ),
}
ENGINES = ["numpy", "drjit"] if backend_problem("llvm") is None else ["numpy"]


def light(seed: int, shape: tuple[int, int] = (40, 60)) -> Any:
    return np.random.default_rng(seed).uniform(0, 50_000, shape)


@pytest.mark.usefixtures("few_windows")
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    "name", ["table 1", pytest.param("rts, ar", marks=pytest.mark.exhaustive)]
)
def test_calls_one_after_the_other_are_the_frames_of_expose(name: str, engine: str) -> None:
    """Light, exposure, shape, origin, seed and number of frames change from call to call; the bytes are the same.

    Frames are numbered on from call to call; a call that says where it begins does not set the count back.
    """
    camera, sensor = CAMERAS[name], ms.Sensor(CAMERAS[name], serial=7)
    calls: list[tuple[Any, ms.Exposure, dict[str, Any]]] = [
        (light(1), EXPOSURE, {}),
        (light(2), EXPOSURE, {"frames": 3}),
        (light(3), ms.Exposure(1.0, 320.0), {"seed": 5, "first_frame": 9}),
        (light(3), EXPOSURE, {"first_frame": 2}),
        (light(4, (20, 30)), EXPOSURE, {"origin": (3, 5)}),
        (light(1), EXPOSURE, {"precision": "float64"} if engine == "numpy" else {}),
        (light(5), EXPOSURE, {"keep": ("electrons", "photons")}),
        (light(1), EXPOSURE, {"tolerance_dn": 0.5}),
    ]
    for (photons, exposure, options), number in zip(
        calls, (0, 1, 9, 2, 10, 11, 12, 13), strict=True
    ):
        assert options.get("first_frame", sensor.frames_taken) == number
        kept = sensor.expose(photons, exposure, engine=engine, **options)
        options = {"first_frame": number, **options}
        fresh = ms.expose(photons, camera, exposure, serial=7, engine=engine, **options)
        np.testing.assert_array_equal(kept.digital, fresh.digital)
        for one in options.get("keep", ()):
            np.testing.assert_array_equal(getattr(kept, one), getattr(fresh, one))
    streamed = sensor.stream(light(2), EXPOSURE, engine=engine, frames=3)
    assert sensor.frames_taken == 17, "the frames of a stream count as soon as it is there"
    again = sensor.expose(light(2), EXPOSURE, engine=engine, frames=3, first_frame=14)
    np.testing.assert_array_equal(np.array(list(streamed)), again.digital)


@pytest.mark.parametrize("engine", ENGINES)
def test_two_calls_with_the_same_light_have_other_noise(engine: str) -> None:
    """|ρ| < 5/√n of 2^14 pixels of shot and read noise, 6e-7 false alarms; an error takes no number."""
    camera = CAMERAS["table 1"].replace(
        **{"pixel.prnu": 0.0, "readout.prnu_col": 0.0, "readout.dsnu_col": 0.0}
    )
    sensor, flat = (
        ms.Sensor(camera.replace(**{"dark_current.cv": 0.0})),
        np.full((128, 128), 1000.0),
    )
    one = sensor.expose(flat, EXPOSURE, engine=engine)
    with pytest.raises(ms.InputError, match="NaN"):
        sensor.expose(flat * np.nan, EXPOSURE, engine=engine)
    assert sensor.frames_taken == 1 and "1 frames taken" in repr(sensor)
    two = sensor.expose(flat, EXPOSURE, engine=engine)
    assert (one.first.index, two.first.index) == (0, 1)
    assert abs(np.corrcoef(one.digital.ravel(), two.digital.ravel())[0, 1]) < 5 / 128
    sensor.clear()
    assert sensor.expose(flat, EXPOSURE, engine=engine).first.index == 2
    sensor.frames_taken = 0
    np.testing.assert_array_equal(
        sensor.expose(flat, EXPOSURE, engine=engine).digital, one.digital
    )


def mean_photons(kind: str) -> Any:
    """300 × 500, with what a kernel may detect in another way than the host."""
    photons = light(6, (300, 500))
    photons[0, :6] = [0.0, -0.0, 1e-320, 1e29, 1e300, 1e308]
    shifted = np.empty(photons.size + 1)[1:].reshape(photons.shape)
    shifted[...] = photons
    single = photons.clip(max=3e38).astype(np.float32)
    kinds = {
        "plain": photons,
        "bands": photons[..., None],
        "shifted": shifted,
    }
    return {**kinds, "float32": single}[kind]


@pytest.mark.parametrize("qe", [1 / 3, 0.0])
@pytest.mark.parametrize("kind", ["plain", "bands", "shifted", "float32"])
@pytest.mark.filterwarnings("ignore:overflow")
def test_light_that_the_kernel_detects_is_that_of_a_stream_and_of_the_host(
    kind: str, qe: float
) -> None:
    """The bytes of the frame and of the mean photoelectrons; also where photons times QE ends between two float32s."""
    camera = CAMERAS["table 1"].replace(**{"quantum_efficiency.value": qe})
    sensor, photons = ms.Sensor(camera, serial=7), mean_photons(kind)
    options: Any = {"wavelengths_nm": [550.0]} if kind == "bands" else {}
    fast = [
        sensor.expose(photons, EXPOSURE, engine=engine, first_frame=1, **options)
        for engine in ENGINES
    ]
    streamed = list(
        sensor.stream(photons, EXPOSURE, engine=ENGINES[-1], frames=2, first_frame=0, **options)
    )[1]
    cropped = sensor.expose(
        photons[7:], EXPOSURE, engine=ENGINES[-1], first_frame=1, origin=(7, 0), **options
    )
    for one in fast:
        np.testing.assert_array_equal(one.digital[0], streamed)
        np.testing.assert_array_equal(one.digital[0, 7:], cropped.digital[0])
        np.testing.assert_array_equal(one.detected.mean_e, fast[0].detected.mean_e)


@pytest.mark.parametrize("engine", ENGINES[-1:])
def test_threads_never_take_the_same_frame(engine: Any) -> None:
    """Whoever comes first, the frames are the first 40 of this chip, each of them once."""
    photons, asked = light(1), {"wavelengths_nm": [550.0], "engine": engine}
    alone, shared = (ms.Sensor(CAMERAS["table 1"], serial=7) for _ in range(2))
    expected = {alone.expose(photons, EXPOSURE, **asked).digital.tobytes() for _ in range(40)}
    with ThreadPoolExecutor(8) as pool:
        taken = list(
            pool.map(
                lambda _: shared.expose(photons, EXPOSURE, **asked).digital.tobytes(), range(40)
            )
        )
    assert len(expected) == 40 and set(taken) == expected and shared.frames_taken == 40
