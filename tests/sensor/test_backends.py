"""Same seed, same bytes: NumPy in float32 and the compiled kernel, whatever the camera, the threads, the window."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers import EACH_KIND

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from mitsuba_sensor.core.llvm import backend_problem, drjit
from mitsuba_sensor.sensor import run

problem = backend_problem("llvm")
compiled = pytest.mark.skipif(problem is not None, reason=str(problem))
no_cuda = backend_problem("cuda")

TABLE1 = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)
SHAPE = (231, 217)
"""Fifty thousand pixels, and no multiple of a vector of 8."""

RAMP = np.linspace(0.0, 1.0, SHAPE[0] * SHAPE[1]).reshape(SHAPE) ** 3
NONLINEAR = {
    "readout.reset": "hard",
    "readout.ve_nonlinearity": 0.05,
    "source_follower.vv_nonlinearity": 1.05,
    "adc.gamma": 1.04,
}
UNIFORM = {"weight": 0.2, "family": "uniform", "low": 45, "high": 440, "unit": "dn"}
NORMAL = {"weight": 0.3, "family": "normal", "mean": 400, "sigma": 50, "unit": "e_per_s"}
RTS = {"rts_fraction": 0.2, "rts_amplitude_e_per_s": 900.0, "rts_switching": 0.5}
OPTIONS: dict[str, dict[str, Any]] = {
    "as shipped": {},
    "16 bit, curves, offsets": {
        "adc.bits": 16,
        **NONLINEAR,
        "readout.dsnu_row": 1e-3,
        "readout.dsnu_row_coupling": 0.2,
        "pixel.dsnu_e": 10.0,
        "readout.prnu_col": 0.02,
        "readout.prnu_col_coupling": 0.1,
        "dark_current.components": [UNIFORM, NORMAL],
    },
    "8 bit, coupled maps": {
        "adc.bits": 8,
        "pixel.full_well_e": 1000.0,
        "pixel.prnu_distribution": "ar",
        "pixel.prnu_coupling": 0.25,
        "readout.dsnu_col_coupling": 0.4,
        "dark_current.distribution": "ar",
        "dark_current.coupling": 0.3,
        "pixel.dsnu_e": 10.0,
        "pixel.dsnu_coupling": 0.3,
        **{f"dark_current.{key}": value for key, value in RTS.items()},
    },
    "steps, yield": {
        "pixel.prnu_distribution": "lognormal",
        "pixel.prnu": 0.3,
        "adc.bits": 10,
        "adc.dnl_lsb": {"100": 0.7, "511": -1.0, "900": 0.3},
        "quantum_efficiency.quantum_yield": [2.3, 1.1],
        "quantum_efficiency.fano_factor": 0.1,
    },
    **{
        f"{law} dark": {"dark_current.distribution": law, "dark_current.cv": 0.6}
        for law in ("gaussian", "gamma", "wald", "logistic")
    },
    "no noise at all": {"pixel.prnu": 0.0, "dark_current.cv": 0.0, "readout.dsnu_col": 0.0},
}


def frame(camera: ms.Camera, light: Any, engine: str, **how: Any) -> np.ndarray[Any, Any]:
    return ms.expose(light, camera, EXPOSURE, engine=engine, **how).digital  # type: ignore[arg-type]


def dark_to_saturation(camera: ms.Camera) -> Any:
    """Half of the ramp below 1/8 of the well, its end 10 % beyond it."""
    wavelength = camera.quantum_efficiency.reference_nm
    return RAMP * 1.1 * camera.pixel.full_well_e / camera.qe([wavelength]).max()


@compiled
@pytest.mark.parametrize("case", OPTIONS)
def test_numpy_and_the_kernel_deliver_the_same_bytes_with_every_option(case: str) -> None:
    """0 of 50 000 pixels in each of 9 cameras, from darkness to saturation."""
    camera = TABLE1.replace(**OPTIONS[case])
    light = dark_to_saturation(camera)
    one, other = (
        frame(camera, light, engine, seed=3, serial=8) for engine in ("numpy", "drjit")
    )
    assert one.min() < one.max() and one.dtype == other.dtype
    np.testing.assert_array_equal(one, other)


@compiled
@pytest.mark.parametrize("name", EACH_KIND)
def test_numpy_and_the_kernel_deliver_the_same_bytes_for_every_camera_file(name: str) -> None:
    camera = ms.load_camera(name)
    light = dark_to_saturation(camera)
    np.testing.assert_array_equal(frame(camera, light, "numpy"), frame(camera, light, "drjit"))


@compiled
def test_bands_and_given_maps_are_the_same_on_both() -> None:
    light = dark_to_saturation(TABLE1)[..., None] * [0.2, 0.5, 0.3]
    maps = {
        "prnu": np.random.default_rng(1).normal(1, 0.1, SHAPE),
        "dsnu_col_e": np.full((1, SHAPE[1]), -40.0),
    }
    how: dict[str, Any] = {"wavelengths_nm": [460.0, 550.0, 820.0], "maps": maps}
    np.testing.assert_array_equal(
        frame(TABLE1, light, "numpy", **how), frame(TABLE1, light, "drjit", **how)
    )


@compiled
def test_one_thread_and_two_deliver_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    camera, light = TABLE1.replace(**NONLINEAR), np.tile(dark_to_saturation(TABLE1), (4, 1))
    threads = drjit().thread_count()
    try:
        frames = []
        for count in (1, 2):
            drjit().set_thread_count(count)
            monkeypatch.setattr(run, "processors", lambda count=count: count)
            frames += [frame(camera, light, engine) for engine in ("numpy", "drjit")]
    finally:
        drjit().set_thread_count(threads)
    assert len({one.tobytes() for one in frames}) == 1


@compiled
def test_a_changed_number_compiles_nothing_and_a_source_left_out_does() -> None:
    """Numbers go in as data. (Kernels are counted by Dr.Jit itself.)"""
    dr, light = drjit(), dark_to_saturation(TABLE1)
    camera = TABLE1.replace(**NONLINEAR)

    def compiles(changed: ms.Camera, exposure: ms.Exposure = EXPOSURE, **how: Any) -> int:
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            ms.expose(light, changed, exposure, engine="drjit", **how)
            return sum(not one["cache_hit"] for one in dr.kernel_history([dr.KernelType.JIT]))

    compiles(camera)
    numbers = {
        "pixel.full_well_e": 2e4,
        "pixel.prnu": 0.02,
        "source_follower.gain": 0.7,
        "adc.gamma": 1.1,
    }
    numbers |= {
        "readout.ve_nonlinearity": 0.2,
        "dark_current.cv": 0.3,
        "adc.bits": 11,
        "adc.black_level_dn": 7.0,
    }
    for field, value in numbers.items():
        assert compiles(camera.replace(**{field: value})) == 0, field
    assert (
        compiles(
            camera,
            ms.Exposure(0.02, 280.0),
            seed=9,
            serial=2**40,
            first_frame=77,
            origin=(5, 6),
        )
        == 0
    )
    compiles(camera.replace(**{"adc.gamma": None, "adc.ile": None}))
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        ms.expose(light, camera.replace(**{"adc.gamma": None}), EXPOSURE, engine="drjit")
        shorter = dr.kernel_history([dr.KernelType.JIT])[-1]
        dr.kernel_history_clear()
        ms.expose(light, camera, EXPOSURE, engine="drjit")
        assert dr.kernel_history([dr.KernelType.JIT])[-1]["hash"] != shorter["hash"]


@compiled
def test_auto_compiles_for_much_work_and_not_for_little(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert run.choose_backend("auto", "float32", 1000) is NUMPY_FLOAT32
    assert run.choose_backend("auto", "float32", 10**8).compiled
    assert run.choose_backend("auto", "float64", 10**8) is NUMPY_FLOAT64
    monkeypatch.setattr(run, "backend_problem", lambda backend: "no LLVM")
    assert run.choose_backend("auto", "float32", 10**8) is NUMPY_FLOAT32


def test_without_llvm_the_compiled_engine_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        run, "backend_problem", lambda backend: "no LLVM 17 or newer on this machine"
    )
    monkeypatch.setattr("mitsuba_sensor.core.llvm._first_usable", lambda libraries: None)
    with pytest.raises(
        ms.InputError, match=r"use engine numpy, or .*apt-get install libllvm19\.$"
    ):
        ms.expose([[1.0]], TABLE1, EXPOSURE, engine="drjit")


@pytest.mark.skipif(no_cuda is not None, reason=f"{no_cuda}")
def test_cuda_has_the_same_random_bits_and_at_most_1_dn() -> None:
    light = dark_to_saturation(TABLE1)
    one, other = (
        frame(TABLE1.replace(**NONLINEAR), light, engine).astype(int)
        for engine in ("numpy", "cuda")
    )
    assert np.abs(one - other).max() <= 1
