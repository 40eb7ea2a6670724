"""Frames of a data sheet by five simulators, each set up as its own documentation says.

Every simulator has one function, (sheet, shot) to frames (N, H, W). Each is given all of the sheet that
it can model.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from datasheets import PITCH_UM, TEMPERATURE_K, WAVELENGTH_NM, Datasheet, camera_of
from numpy.typing import NDArray

import mitsuba_sensor as ms

Codes = NDArray[Any]
CHIP = 1288
"""Seed of everything that belongs to the chip: PRNU and DSNU."""
CELSIUS = TEMPERATURE_K - 273.15
PRNU_FILE, DSNU_FILE = "prnu.npy", "dsnu.npy"
"""Maps that Pyxel reads."""


@dataclass(frozen=True)
class Shot:
    """What is in front of the camera: mean photons of every pixel; and how many frames of which size are taken."""

    photons: float
    time_s: float
    frames: int
    seed: int
    shape: tuple[int, int]


def ours(sheet: Datasheet, shot: Shot) -> Codes:
    """mitsuba_sensor."""
    light = np.full(shot.shape, shot.photons)
    exposure = ms.Exposure(shot.time_s, temperature_k=TEMPERATURE_K)
    return ms.expose(
        light, camera_of(sheet), exposure, frames=shot.frames, seed=shot.seed
    ).digital


def of_getframes(sheet: Datasheet, shot: Shot) -> Codes:
    """getframes: photons per second."""
    import getframes

    config = getframes.CameraConfig(
        name="of the sheet",
        sensor_type="CMOS",
        resolution=shot.shape,
        pixel_size_um=PITCH_UM,
        quantum_efficiency=sheet.qe,
        full_well_e=sheet.full_well_e,
        bit_depth=sheet.bits,
        gain_e_per_adu=1 / sheet.gain_dn_per_e,
        bias_offset_adu=sheet.black_level_dn,
        read_noise_e=sheet.read_noise_e,
        dark_current_e_per_s=sheet.dark_e_per_s,
        dark_current_ref_temp_c=CELSIUS,
        prnu=sheet.prnu,
        bias_pixel_spread_adu=sheet.dsnu_e * sheet.gain_dn_per_e,
        fixed_pattern_seed=CHIP,
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


def of_galsim(sheet: Datasheet, shot: Shot) -> Codes:
    """GalSim: an image of mean electrons, and CCDNoise. Black level and clips are its user's NumPy."""
    import galsim

    noise = galsim.CCDNoise(
        galsim.BaseDeviate(shot.seed + 1),
        gain=1 / sheet.gain_dn_per_e,
        read_noise=sheet.read_noise_e,
        sky_level=sheet.dark_e_per_s * shot.time_s * sheet.gain_dn_per_e,
    )
    found = []
    for _ in range(shot.frames):
        mean_e = np.full(shot.shape, shot.photons * sheet.qe, np.float32)
        image = galsim.ImageF(mean_e * np.float32(sheet.gain_dn_per_e))
        image.addNoise(noise)
        image += noise.sky_level + sheet.black_level_dn
        image.quantize()
        found.append(np.clip(image.array, 0, 2**sheet.bits - 1).astype(np.uint16))
    return np.stack(found)


def of_emva1288(sheet: Datasheet, shot: Shot) -> Codes:
    """The simulator of the package emva1288. It clips electrons at 0, so the black level is given as electrons."""
    from emva1288.camera import Camera
    from emva1288.camera.routines import Qe, get_radiance

    chip = np.random.default_rng(CHIP)
    wavelengths, time_ns = np.array([WAVELENGTH_NM]), shot.time_s * 1e9
    black_e = sheet.black_level_dn / sheet.gain_dn_per_e
    camera = Camera(
        pixel_area=PITCH_UM**2,
        bit_depth=sheet.bits,
        width=shot.shape[1],
        height=shot.shape[0],
        temperature=CELSIUS,
        temperature_ref=CELSIUS,
        qe=Qe(np.full((*shot.shape, 1), sheet.qe), wavelengths, shot.shape[1], shot.shape[0]),
        exposure=time_ns,
        K=sheet.gain_dn_per_e,
        K_min=sheet.gain_dn_per_e,
        K_max=sheet.gain_dn_per_e,
        dark_current_ref=sheet.dark_e_per_s,
        dark_signal_0=black_e,
        sigma2_dark_0=sheet.read_noise_e**2,
        u_esat=sheet.full_well_e + black_e,
        prnu=chip.normal(1.0, sheet.prnu, shot.shape),
        dsnu=chip.normal(0.0, sheet.dsnu_e, shot.shape),
        seed=shot.seed,
    )
    light = get_radiance(
        time_ns, np.full((*shot.shape, 1), shot.photons), PITCH_UM**2, 8, wavelengths
    )
    return np.stack([camera.grab(light) for _ in range(shot.frames)])


def of_pyxel(sheet: Datasheet, shot: Shot) -> Codes:
    """Pyxel's CMOS. PRNU and DSNU are maps from files, as it offers: its own PRNU is log-normal about 2 QE."""
    import pyxel
    from pyxel.exposure import Exposure, Readout

    np.random.seed(shot.seed)
    chip = np.random.default_rng(CHIP)
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / PRNU_FILE, chip.normal(1.0, sheet.prnu, shot.shape))
        np.save(Path(folder) / DSNU_FILE, chip.normal(0.0, sheet.dsnu_e, shot.shape))
        detector = _pyxel_detector(sheet, shot.shape)
        pipeline = _pyxel_pipeline(sheet, shot, Path(folder))
        mode = Exposure(Readout(times=[shot.time_s]))
        taken = [
            pyxel.run_mode(mode=mode, detector=detector, pipeline=pipeline)
            for _ in range(shot.frames)
        ]
    return np.stack([one["/bucket/image"].to_numpy()[0] for one in taken])


def _pyxel_detector(sheet: Datasheet, shape: tuple[int, int]) -> Any:
    """1 µV/e-. The converter truncates: an input range that begins half a code lower makes it round."""
    from pyxel.detectors import CMOS, CMOSCharacteristics, CMOSGeometry, Environment
    from pyxel.detectors.charge_to_volt_settings import ChargeToVoltSettings

    volts_per_dn = 1e-6 / sheet.gain_dn_per_e
    lowest_v = -(sheet.black_level_dn + 0.5) * volts_per_dn
    return CMOS(
        geometry=CMOSGeometry(row=shape[0], col=shape[1]),
        environment=Environment(temperature=TEMPERATURE_K),
        characteristics=CMOSCharacteristics(
            quantum_efficiency=sheet.qe,
            charge_to_volt=ChargeToVoltSettings(value=1e-6),
            full_well_capacity=sheet.full_well_e,
            adc_bit_resolution=sheet.bits,
            adc_voltage_range=(lowest_v, lowest_v + (2**sheet.bits - 1) * volts_per_dn),
        ),
    )


def _pyxel_pipeline(sheet: Datasheet, shot: Shot, folder: Path) -> Any:
    """The models in the order of the pipeline. The charge of the DSNU file is that of one exposure.

    folder : of the two maps.
    """
    from pyxel.pipelines import DetectionPipeline, ModelFunction

    def model(path: str, **arguments: Any) -> ModelFunction:
        return ModelFunction(f"pyxel.models.{path}", path.rpartition(".")[2], arguments)

    collect = ModelFunction("simulated.collect", "collect", {"photons": shot.photons})
    prnu, dsnu = (str(folder / name) for name in (PRNU_FILE, DSNU_FILE))
    return DetectionPipeline(
        photon_collection=[collect, model("photon_collection.shot_noise")],
        charge_generation=[
            model("charge_generation.simple_conversion"),
            model("charge_generation.simple_dark_current", dark_rate=sheet.dark_e_per_s),
            model("charge_generation.load_charge", filename=dsnu, time_scale=shot.time_s),
        ],
        charge_collection=[
            model("charge_collection.simple_collection"),
            model("charge_collection.fixed_pattern_noise", filename=prnu),
            model("charge_collection.simple_full_well"),
        ],
        charge_measurement=[
            model("charge_measurement.simple_measurement"),
            model(
                "charge_measurement.output_node_noise", std_deviation=sheet.read_noise_e * 1e-6
            ),
        ],
        readout_electronics=[model("readout_electronics.simple_adc")],
    )


def collect(detector: Any, photons: float) -> None:
    """A Pyxel model: the same photons in every pixel."""
    detector.photon += np.full(detector.geometry.shape, photons)


SIMULATORS: dict[str, Callable[[Datasheet, Shot], Codes]] = {
    "mitsuba_sensor": ours,
    "getframes": of_getframes,
    "emva1288": of_emva1288,
    "pyxel": of_pyxel,
    "galsim": of_galsim,
}
