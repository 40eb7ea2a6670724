"""The bytes of frames of 30 cameras, three engines and three seeds are those on record: refactoring must not move them.

tests/data/frame_digests.json was recorded before the simulation was halved. A change that moves the physics on purpose
records it again: `python tests/sensor/test_frame_digests.py`.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from itertools import product

import numpy as np
import pytest
from helpers import DATA

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import backend_problem

RECORD = DATA / "frame_digests.json"
ENGINES = {"float64": ("numpy", "float64"), "numpy": ("numpy", "float32")}
ENGINES |= {"drjit": ("drjit", "float32")}
SEEDS = (1, 2, 77)

VARIANTS = {
    "ipc": ("konnik_table1", {"readout.ipc_coupling": 0.02}),
    "blooming": ("eev_44_82", {"pixel.blooming": 0.9, "pixel.full_well_e": 9000.0}),
    "knee": ("bayer_2mp", {"pixel.full_well_e": 9000.0, "pixel.full_well_knee_e": 300.0}),
    "hits": ("eso_efosc2", {"pixel.hits_per_cm2_s": 3e5, "pixel.hit_e": 900.0}),
    "lag": ("sony_imx174", {"quantum_efficiency.image_lag": 0.02}),
    "diffusion": ("bayer_2mp", {"quantum_efficiency.diffusion_um": [1.5] * 33}),
    "yield": (
        "konnik_table1",
        {
            "quantum_efficiency.quantum_yield": [1.5, 1.5],
            "quantum_efficiency.fano_factor": 0.12,
        },
    ),
    "prnu_ar": ("konnik_table1", {"pixel.prnu": 0.02, "pixel.prnu_distribution": "ar"}),
    "gamma": ("bayer_2mp", {"adc.gamma": 2.2}),
    "tukey": (
        "sony_imx174",
        {
            "source_follower.read_noise_distribution": "tukey_lambda",
            "source_follower.read_noise_shape": -0.1,
        },
    ),
    "rtn": (
        "bayer_2mp",
        {
            "source_follower.rtn_pixel_fraction": 0.1,
            "source_follower.rtn_pixel_amplitude_e": 8.0,
        },
    ),
}
"""Effects that no shipped camera has."""


def camera_of(name: str) -> ms.Camera:
    base, changes = VARIANTS.get(name, (name, {}))
    return ms.load_camera(base).replace(**changes)


def digests(name: str, engine: str) -> list[str]:
    """The first 16 digits of the SHA-256 of two frames for each seed."""
    camera = camera_of(name)
    ramp = np.geomspace(0.5, 40_000.0, 24 * 32).reshape(24, 32, 1) * np.array([0.3, 0.45, 0.25])
    photons = ms.Photons(ramp, np.array([450.0, 550.0, 650.0]))
    found = []
    for seed in SEEDS:
        chosen, precision = ENGINES[engine]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            frames = ms.expose(
                photons, camera, ms.Exposure(0.02), seed=seed, serial=seed + 3, frames=2,
                engine=chosen, precision=precision,
            )  # fmt: skip
        found.append(hashlib.sha256(frames.digital.tobytes()).hexdigest()[:16])
    return found


NAMES = [*ms.list_cameras(), *VARIANTS]


CASES = [*product(NAMES, ("float64", "numpy")), *product(NAMES[::3], ["drjit"])]
"""Of the compiled engine a third: that it has the bytes of NumPy is tested in test_backends.py."""


@pytest.mark.parametrize(("name", "engine"), CASES)
def test_frames_have_the_bytes_on_record(name: str, engine: str) -> None:
    if engine == "drjit" and (problem := backend_problem("llvm")):
        pytest.skip(problem)
    assert digests(name, engine) == json.loads(RECORD.read_text())[name][engine]


if __name__ == "__main__":
    RECORD.write_text(
        json.dumps(
            {name: {one: digests(name, one) for one in ENGINES} for name in NAMES}, indent=1
        )
        + "\n"
    )
