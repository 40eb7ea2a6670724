"""Settings of a camera on the sheet: gain and temperature, and the frames that it takes there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Exposure, InputError, Photons
from ...core.types import Float64Array
from ...expose import expose
from ...lab.frames.stack import Stack
from ..virtual_bench import FLAT_S, middle_of_sensor, mosaic


class Setting(NamedTuple):
    """One column of the sheet.

    camera : at its gain setting.  gain : name of that, empty where the camera has one only.
    temperature_k : of the sensor [K].  serial, seed : of the chip and of all temporal noise.
    """

    camera: Camera
    gain: str
    temperature_k: float
    serial: int
    seed: int

    @property
    def exposure(self) -> Exposure:
        """Exposure of the pictures of charts; the light varies."""
        return Exposure(FLAT_S, self.temperature_k)


class Bands(NamedTuple):
    """Centres and widths of spectral bands [nm], (B,)."""

    wavelengths_nm: Float64Array
    bandwidths_nm: Float64Array


def gain_names(camera: Camera, asked: Sequence[str]) -> list[str]:
    """The gain settings that are asked for, "all" for each of the camera; one empty name where none is asked for.

    Raises InputError for a setting that the camera does not have.
    """
    if list(asked) == ["all"]:
        asked = [one.label for one in camera.gains]
        if not asked:
            raise InputError(f"{camera.name} has no gain settings; leave --gains out.")
    for name in asked:
        camera.at_gain(name)
    if len(set(asked)) < len(asked):
        raise InputError(f"--gains names a setting twice: {', '.join(asked)}; name it once.")
    return list(asked) or [""]


def settings_of(
    camera: Camera, gains: Sequence[str], kelvins: Sequence[float], chip: tuple[int, int]
) -> list[Setting]:
    """Every gain at every temperature.  chip : serial number, and seed of the temporal noise. Raises InputError."""
    serial, seed = chip
    settings = []
    for gain in gain_names(camera, gains):
        at_gain = camera.at_gain(gain or None)
        settings += [Setting(at_gain, gain, kelvin, serial, seed) for kelvin in kelvins]
    return settings


def take(setting: Setting, light: Float64Array, bands: Bands, frames: int, kind: str) -> Stack:
    """Frames of mean photons per pixel (H, W, B) in the middle of the sensor, as a stack.

    kind : what is taken; stacks of different kinds have different temporal noise.
    """
    camera, shape = setting.camera, light.shape[:2]
    photons = Photons(
        light,
        bands.wavelengths_nm,
        bandwidths_nm=bands.bandwidths_nm,
        origin=middle_of_sensor(camera, shape),
    )
    taken = expose(
        photons,
        camera,
        setting.exposure,
        frames=frames,
        serial=setting.serial,
        seed=_seed(setting.seed, kind),
    )
    return Stack(
        taken.digital,
        setting.exposure.time_s,
        None if light.any() else 0.0,
        setting.temperature_k,
        setting.gain,
        bits=camera.adc.bits,
        tile=mosaic(camera),
        source=kind,
    )


def _seed(seed: int, kind: str) -> int:
    """A seed of its own for every kind of stack."""
    return int(np.random.SeedSequence([seed, *kind.encode()]).generate_state(1)[0])


def chart_shape(camera: Camera, rows: int, columns: int) -> tuple[int, int]:
    """Pixels of a chart that has so many rows and columns behind each place of the colour mosaic; at most the sensor.

    Whole tiles of the mosaic.
    """
    tile_rows, tile_columns = len(camera.tile), len(camera.tile[0])
    return (
        min(rows, camera.sensor.rows // tile_rows) * tile_rows,
        min(columns, camera.sensor.columns // tile_columns) * tile_columns,
    )


def levels_of_filters(camera: Camera, light: Float64Array, bands: Bands) -> Float64Array:
    """Photoelectrons behind each colour filter of mean photons (…, B), (…, F)."""
    efficiency = camera.qe(bands.wavelengths_nm, bands.bandwidths_nm)
    return np.asarray(light @ np.asarray(efficiency).T)
