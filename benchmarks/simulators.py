"""Error of frames versus run time: this package on each engine, and four other simulators.

    pip install '.[peers]' && python benchmarks/simulators.py --plot docs/images/readme_simulators.png [--turns 5]

Frames of the industrial CMOS camera at 100 photoelectrons, with the stages that all simulators have: shot noise, dark
current, read noise, black level and rounding. Each simulator is set up as its documentation says. The set-up is timed.
"""

from __future__ import annotations

import argparse
import json
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from timing import alternate, ratio

import mitsuba_sensor as ms
from mitsuba_sensor.camera.emva_sheet import EmvaSheet, camera_of_sheet
from mitsuba_sensor.core.versions import machine
from mitsuba_sensor.pages.drawing import png
from mitsuba_sensor.pages.page import Plot, line

Codes = NDArray[Any]
PITCH_UM, WAVELENGTH_NM, TEMPERATURE_K = 5.0, 550.0, 298.15
CELSIUS = TEMPERATURE_K - 273.15
SHAPE = (500, 500)
MEAN_ELECTRONS, FRAMES_PER_CALL = 100.0, 8
OUR_ENGINES = {
    "NumPy float64": {"engine": "numpy", "precision": "float64"},
    "NumPy float32": {"engine": "numpy", "precision": "float32"},
    "Dr.Jit float32": {"engine": "drjit", "precision": "float32"},
}


# Datasheet of an IMX174 camera (fhotolab.fherb.de, 2016) without spatial noise; dark current and black level assumed.
QE, GAIN_DN_PER_E, READ_NOISE_E, FULL_WELL_E = 0.77, 1 / 8.16, 6.83, 32691.0
DARK_E_PER_S, BITS, BLACK_LEVEL_DN = 5.0, 12, 20.0


def our_camera() -> ms.Camera:
    """Return our camera, as ``mitsuba-sensor cameras new --emva`` makes it, with this black level."""
    sheet = EmvaSheet(
        pitch_um=(PITCH_UM, PITCH_UM),
        size=(1000, 1000),
        wavelength_nm=WAVELENGTH_NM,
        bits=BITS,
        qe_percent=100 * QE,
        gain_dn_per_e=GAIN_DN_PER_E,
        read_noise_e=READ_NOISE_E,
        saturation_e=FULL_WELL_E,
        dsnu_e=0.0,
        prnu_percent=0.0,
        dark_e_per_s=DARK_E_PER_S,
        dark_temperature_c=CELSIUS,
    )
    camera = camera_of_sheet(sheet, "of_the_sheet", "industrial CMOS")
    return camera.replace(**{"adc.black_level_dn": BLACK_LEVEL_DN})


@dataclass(frozen=True)
class Shot:
    """Mean photons of every pixel, exposure time, and number, seed and shape of the frames."""

    photons: float
    time_s: float
    frames: int
    seed: int
    shape: tuple[int, int]


def on_engine(options: dict[str, Any], shot: Shot) -> Codes:
    """Return frames of this package on one engine, computed as a stream."""
    light = np.full(shot.shape, shot.photons)
    exposure = ms.Exposure(shot.time_s, temperature_k=TEMPERATURE_K)
    frames = ms.stream(
        light, our_camera(), exposure, seed=shot.seed, frames=shot.frames, **options
    )
    return np.stack(list(frames))


def of_getframes(shot: Shot) -> Codes:
    """getframes: photons per second."""
    import getframes

    config = getframes.CameraConfig(
        name="of the sheet",
        sensor_type="CMOS",
        resolution=shot.shape,
        pixel_size_um=PITCH_UM,
        quantum_efficiency=QE,
        full_well_e=FULL_WELL_E,
        bit_depth=BITS,
        gain_e_per_adu=1 / GAIN_DN_PER_E,
        bias_offset_adu=BLACK_LEVEL_DN,
        read_noise_e=READ_NOISE_E,
        dark_current_e_per_s=DARK_E_PER_S,
        dark_current_ref_temp_c=CELSIUS,
    )
    camera = getframes.Camera(config, precision="single")
    rate = np.full(shot.shape, shot.photons / shot.time_s, np.float32)
    return np.stack(
        [
            camera.expose(
                rate, shot.time_s, CELSIUS, seed=shot.seed * 1000 + one, include_truth=False
            ).data
            for one in range(shot.frames)
        ]
    )


def of_galsim(shot: Shot) -> Codes:
    """GalSim: an image of mean electrons, and CCDNoise. Black level and clips are its user's NumPy."""
    import galsim

    noise = galsim.CCDNoise(
        galsim.BaseDeviate(shot.seed + 1),
        gain=1 / GAIN_DN_PER_E,
        read_noise=READ_NOISE_E,
        sky_level=DARK_E_PER_S * shot.time_s * GAIN_DN_PER_E,
    )
    found = []
    for _ in range(shot.frames):
        mean_e = np.full(shot.shape, shot.photons * QE, np.float32)
        image = galsim.ImageF(mean_e * np.float32(GAIN_DN_PER_E))
        image.addNoise(noise)
        image += noise.sky_level + BLACK_LEVEL_DN
        image.quantize()
        found.append(np.clip(image.array, 0, 2**BITS - 1).astype(np.uint16))
    return np.stack(found)


def of_emva1288(shot: Shot) -> Codes:
    """The simulator of the package emva1288. It clips electrons at 0, so the black level is given as electrons."""
    from emva1288.camera import Camera
    from emva1288.camera.routines import Qe, get_radiance

    wavelengths, time_ns = np.array([WAVELENGTH_NM]), shot.time_s * 1e9
    black_e = BLACK_LEVEL_DN / GAIN_DN_PER_E
    camera = Camera(
        pixel_area=PITCH_UM**2,
        bit_depth=BITS,
        width=shot.shape[1],
        height=shot.shape[0],
        temperature=CELSIUS,
        temperature_ref=CELSIUS,
        qe=Qe(np.full((*shot.shape, 1), QE), wavelengths, shot.shape[1], shot.shape[0]),
        exposure=time_ns,
        K=GAIN_DN_PER_E,
        K_min=GAIN_DN_PER_E,
        K_max=GAIN_DN_PER_E,
        dark_current_ref=DARK_E_PER_S,
        dark_signal_0=black_e,
        sigma2_dark_0=READ_NOISE_E**2,
        u_esat=FULL_WELL_E + black_e,
        prnu=np.ones(shot.shape),
        dsnu=np.zeros(shot.shape),
        seed=shot.seed,
    )
    light = get_radiance(
        time_ns, np.full((*shot.shape, 1), shot.photons), PITCH_UM**2, 8, wavelengths
    )
    return np.stack([camera.grab(light) for _ in range(shot.frames)])


def of_pyxel(shot: Shot) -> Codes:
    """Pyxel's CMOS."""
    import pyxel
    from pyxel.exposure import Exposure, Readout

    np.random.seed(shot.seed)
    detector, pipeline = _pyxel_detector(shot.shape), _pyxel_pipeline(shot)
    mode = Exposure(Readout(times=[shot.time_s]))
    taken = [
        pyxel.run_mode(mode=mode, detector=detector, pipeline=pipeline)
        for _ in range(shot.frames)
    ]
    return np.stack([one["/bucket/image"].to_numpy()[0] for one in taken])


def _pyxel_detector(shape: tuple[int, int]) -> Any:
    """1 µV/e-. The converter truncates: an input range that begins half a code lower makes it round."""
    from pyxel.detectors import CMOS, CMOSCharacteristics, CMOSGeometry, Environment
    from pyxel.detectors.charge_to_volt_settings import ChargeToVoltSettings

    volts_per_dn = 1e-6 / GAIN_DN_PER_E
    lowest_v = -(BLACK_LEVEL_DN + 0.5) * volts_per_dn
    return CMOS(
        geometry=CMOSGeometry(row=shape[0], col=shape[1]),
        environment=Environment(temperature=TEMPERATURE_K),
        characteristics=CMOSCharacteristics(
            quantum_efficiency=QE,
            charge_to_volt=ChargeToVoltSettings(value=1e-6),
            full_well_capacity=FULL_WELL_E,
            adc_bit_resolution=BITS,
            adc_voltage_range=(lowest_v, lowest_v + (2**BITS - 1) * volts_per_dn),
        ),
    )


def _pyxel_pipeline(shot: Shot) -> Any:
    """The models in the order of the pipeline."""
    from pyxel.pipelines import DetectionPipeline, ModelFunction

    def model(path: str, **arguments: Any) -> ModelFunction:
        return ModelFunction(f"pyxel.models.{path}", path.rpartition(".")[2], arguments)

    collect = ModelFunction("simulators.collect", "collect", {"photons": shot.photons})
    return DetectionPipeline(
        photon_collection=[collect, model("photon_collection.shot_noise")],
        charge_generation=[
            model("charge_generation.simple_conversion"),
            model("charge_generation.simple_dark_current", dark_rate=DARK_E_PER_S),
        ],
        charge_collection=[
            model("charge_collection.simple_collection"),
            model("charge_collection.simple_full_well"),
        ],
        charge_measurement=[
            model("charge_measurement.simple_measurement"),
            model("charge_measurement.output_node_noise", std_deviation=READ_NOISE_E * 1e-6),
        ],
        readout_electronics=[model("readout_electronics.simple_adc")],
    )


def collect(detector: Any, photons: float) -> None:
    """A Pyxel model: the same photons in every pixel."""
    detector.photon += np.full(detector.geometry.shape, photons)


OTHERS: dict[str, Callable[[Shot], Codes]] = {
    "getframes": of_getframes,
    "emva1288": of_emva1288,
    "pyxel": of_pyxel,
    "galsim": of_galsim,
}


class Timed:
    """Frames of a simulator, eight in each call: a task of ``alternate``.

    frames_of : function shot → frames.
    """

    runs = FRAMES_PER_CALL

    def __init__(self, frames_of: Callable[[Shot], Codes]) -> None:
        self.frames_of, self.calls = frames_of, list[Codes]()

    def __call__(self) -> None:
        photons, seed = MEAN_ELECTRONS / QE, 1 + len(self.calls)
        shot = Shot(photons, 1.0, FRAMES_PER_CALL, seed, SHAPE)
        self.calls.append(self.frames_of(shot))

    def error_dn(self) -> float:
        """Return the larger deviation of mean and temporal σ from their closed forms, over all calls [DN]."""
        mean_dn = np.mean([frames.mean(dtype=float) for frames in self.calls])
        variance_dn2 = np.mean([np.var(one, 0, float, ddof=1).mean() for one in self.calls])
        mean, sigma = expected_dn()
        return float(max(abs(mean_dn - mean), abs(np.sqrt(variance_dn2) - sigma)))


def expected_dn() -> tuple[float, float]:
    """Return mean and temporal σ [DN] of Poisson electrons, normal read noise and rounding (EMVA 1288, eq. 11)."""
    mean_e = MEAN_ELECTRONS + DARK_E_PER_S
    variance_e2 = mean_e + READ_NOISE_E**2
    sigma_dn = math.sqrt(GAIN_DN_PER_E**2 * variance_e2 + 1 / 12)
    return GAIN_DN_PER_E * mean_e + BLACK_LEVEL_DN, sigma_dn


def work_precision(turns: int) -> dict[str, dict[str, float]]:
    """Return run time and error of this package on each engine and of every installed simulator, timed in turns."""
    tasks = {
        f"this package, {name}": Timed(partial(on_engine, options))
        for name, options in OUR_ENGINES.items()
    }
    tasks |= {name: Timed(frames) for name, frames in OTHERS.items() if find_spec(name)}
    seconds = alternate(tasks, turns)
    first = seconds["this package, NumPy float64"]
    fastest = seconds["this package, Dr.Jit float32"]
    return {
        name: {
            "ns_per_pixel": 1e9 * float(np.median(seconds[name])) / math.prod(SHAPE),
            "error_dn": task.error_dn(),
            "times_as_fast_as_float64": ratio(first, seconds[name]),
            "drjit_times_as_fast": ratio(seconds[name], fastest),
        }
        for name, task in tasks.items()
    }


def plot_of(results: dict[str, dict[str, float]], turns: int) -> Plot:
    """Plot error versus run time, with the level that this many frames can resolve."""
    sigma_dn = expected_dn()[1]
    error_dn = sigma_dn / math.sqrt((turns + 1) * FRAMES_PER_CALL * math.prod(SHAPE))
    lines = [
        line(name, [(one["ns_per_pixel"], max(one["error_dn"], error_dn / 10))], joined=False)
        for name, one in results.items()
    ]
    title, axis = "Frame error versus run time", "error of mean or temporal σ [DN]"
    levels = {"2 standard errors": 2 * error_dn}
    return Plot(title, "run time [ns/pixel]", axis, tuple(lines), levels=levels)


def main() -> None:
    """Run every simulator that is installed, draw the plot, print the numbers."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--turns", type=int, default=5, help="timed turns (default 5)")
    parser.add_argument("--plot", type=Path, help="PNG file to draw")
    parser.add_argument("--json", action="store_true", help="accepted; JSON is always printed")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of the other packages
    results = work_precision(options.turns)
    if options.plot:
        options.plot.write_bytes(png(plot_of(results, options.turns)))
    print(json.dumps({**machine(), "turns": options.turns, "simulators": results}, indent=1))


if __name__ == "__main__":
    main()
