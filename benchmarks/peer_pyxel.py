"""Simulate a camera with Pyxel (ESA): photons from an array, shot noise, QE, dark current, full well, ADC.

Stages that the two packages define differently are not used: in Pyxel the dark-current FPN is one number for the whole
frame, and PRNU doubles the signal. The dark current is a Poisson count with the mean of our camera. The ADC of Pyxel
truncates; an input range that starts half a code lower makes it round.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyxel
from cases import reference_qe
from numpy.typing import NDArray
from pyxel.detectors import CMOS, CMOSCharacteristics, CMOSGeometry, Environment
from pyxel.detectors.charge_to_volt_settings import ChargeToVoltSettings
from pyxel.exposure import Exposure, Readout
from pyxel.pipelines import DetectionPipeline, ModelFunction

import mitsuba_sensor as ms
from mitsuba_sensor.stages.effects.dark_current import dark_current_model
from mitsuba_sensor.stages.effects.source_follower_noise import SourceFollowerNoise
from mitsuba_sensor.stages.gains import adc_gain_dn_per_v, volts_per_electron

VERSION = pyxel.__version__


def frames(
    photons: NDArray[np.float64], camera: ms.Camera, exposure: ms.Exposure
) -> Iterator[NDArray[Any]]:
    """Endless frames (H, W) uint16, one call of ``run_mode`` each; detector and pipeline are built once."""
    np.random.seed(2)
    mode = Exposure(Readout(times=[exposure.time_s]))
    detector, pipeline = (
        detector_of(camera, photons.shape, exposure),
        pipeline_of(camera, photons, exposure),
    )
    while True:
        yield pyxel.run_mode(mode=mode, detector=detector, pipeline=pipeline)[
            "/bucket/image"
        ].to_numpy()[0]


def detector_of(camera: ms.Camera, shape: tuple[int, ...], exposure: ms.Exposure) -> CMOS:
    """The detector parameters of Pyxel."""
    bits, dn_per_v = camera.adc.bits, adc_gain_dn_per_v(camera)
    lowest_v = -(camera.black_level_dn + 0.5) / dn_per_v
    return CMOS(
        geometry=CMOSGeometry(row=shape[0], col=shape[1]),
        environment=Environment(temperature=exposure.temperature_k),
        characteristics=CMOSCharacteristics(
            quantum_efficiency=reference_qe(camera),
            charge_to_volt=ChargeToVoltSettings(value=volts_per_electron(camera)),
            full_well_capacity=camera.pixel.full_well_e,
            adc_bit_resolution=bits,
            adc_voltage_range=(lowest_v, lowest_v + (2**bits - 1) / dn_per_v),
        ),
    )


def pipeline_of(
    camera: ms.Camera, photons: NDArray[np.float64], exposure: ms.Exposure
) -> DetectionPipeline:
    """The models in the order of the pipeline."""
    dark_e_per_s = dark_current_model(camera).rate_e_per_s(exposure.temperature_k)
    read_noise_v = (
        SourceFollowerNoise.from_camera(camera).sigma_v
        * camera.source_follower.gain
        * camera.readout.cds_gain
    )
    return DetectionPipeline(
        photon_collection=[
            model("peer_pyxel.collect", photons=photons),
            model("pyxel.models.photon_collection.shot_noise"),
        ],
        charge_generation=[
            model("pyxel.models.charge_generation.simple_conversion"),
            model("pyxel.models.charge_generation.simple_dark_current", dark_rate=dark_e_per_s),
        ],
        charge_collection=[
            model("pyxel.models.charge_collection.simple_collection"),
            model("pyxel.models.charge_collection.simple_full_well"),
        ],
        charge_measurement=[
            model("pyxel.models.charge_measurement.simple_measurement"),
            model(
                "pyxel.models.charge_measurement.output_node_noise", std_deviation=read_noise_v
            ),
        ],
        readout_electronics=[model("pyxel.models.readout_electronics.simple_adc")],
    )


def model(function: str, **arguments: Any) -> ModelFunction:
    """A Pyxel model with the name of its function."""
    return ModelFunction(function, function.rpartition(".")[2], arguments)


def collect(detector: CMOS, photons: NDArray[np.float64]) -> None:
    """A Pyxel model that adds photons from an array; Pyxel's own reads a file."""
    detector.photon += photons
