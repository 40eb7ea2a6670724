"""Compute mean and variance of the codes of one pixel by enumeration of its counts, for a camera without fixed pattern.

A linear camera, count n of Poisson(λ), full well, normal read noise, ADC: the chance of every code follows from Φ.
"""

from __future__ import annotations

import numpy as np
from scipy import special, stats

import mitsuba_sensor as ms
from mitsuba_sensor.stages.effects.source_follower_noise import SourceFollowerNoise
from mitsuba_sensor.stages.gains import gain_dn_per_e, sense_gain_v_per_e

STEP = 1e-5


def bare_camera(sigma_dn: float, dn_per_e: float = 0.125, **fields: float) -> ms.Camera:
    """Table 1 with shot noise, full well, read noise of so many DN and the ADC.  fields : adc__bits for adc.bits."""
    table1 = ms.load_camera("konnik_table1")
    highest = 2 ** int(fields.get("adc__bits", table1.adc.bits))
    changes = {
        "source_follower.white_nv_per_rthz": None,
        "source_follower.corner_hz": 0.0,
        "source_follower.read_noise_e": sigma_dn / dn_per_e,
        "dark_current.fom_na_per_cm2": 0.0,
        "pixel.prnu": 0.0,
        "readout.dsnu_col": 0.0,
        "readout.sense_gain_uv_per_e": 5.0,
        "adc.full_scale_v": 5e-6 * highest / dn_per_e,
    }
    return table1.replace(
        **changes, **{name.replace("__", "."): value for name, value in fields.items()}
    )


def mean_and_variance(camera: ms.Camera, electrons: float) -> tuple[float, float]:
    """E[code] and Var[code] at so many mean photoelectrons."""
    gain = gain_dn_per_e(camera)
    sigma = SourceFollowerNoise.from_camera(camera).sigma_v / sense_gain_v_per_e(camera) * gain
    reach = 12 * np.sqrt(electrons) + 30
    counts = np.arange(max(int(electrons - reach), 0), electrons + reach)
    ideal = camera.black_level_dn + gain * np.minimum(counts, camera.pixel.full_well_e)
    ends = np.array([ideal[0] - 9 * sigma, ideal[-1] + 9 * sigma + 2])
    first, last = np.clip(ends.astype(int), 1, 2**camera.adc.bits)
    codes = np.arange(first, last)
    above = stats.poisson.pmf(counts, electrons) @ special.ndtr(
        (ideal[:, None] - codes + 0.5) / sigma
    )
    mean = float(above.sum()) + first - 1  # every count reaches the codes below the first
    return mean, float(above @ (2.0 * codes - 1)) + (first - 1) ** 2 - mean**2


def slopes(camera: ms.Camera, electrons: float, name: str) -> tuple[float, float]:
    """d mean/d ln and d variance/d ln of the photons or of a field of the camera, by central differences."""
    ends = []
    for factor in (1 + STEP, 1 - STEP):
        if name == "photons":
            ends.append(mean_and_variance(camera, electrons * factor))
        else:
            ends.append(
                mean_and_variance(
                    camera.replace(**{name: value_of(name, camera) * factor}), electrons
                )
            )
    return (ends[0][0] - ends[1][0]) / (2 * STEP), (ends[0][1] - ends[1][1]) / (2 * STEP)


def value_of(name: str, camera: ms.Camera) -> float:
    """The value of a field."""
    found: object = camera
    for part in name.split("."):
        found = getattr(found, part)
    assert isinstance(found, float)
    return found
