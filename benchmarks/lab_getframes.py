"""K and dark noise by ms.lab in the frames of another simulator's cameras, the presets of getframes.

    pip install '.[peers]' && python benchmarks/lab_getframes.py [--side 160] [--json]

Every preset of a CCD or CMOS sensor without electron multiplication; 16 bias frames, 25 levels of 2 frames. Compared:
K, and σ_d with the rms over the pixels of the read noise that was put in, whose spread is log-normal about its mean
and whose noisy pixels have a multiple of it.
"""

from __future__ import annotations

import argparse
import json
import math
from typing import Any

import numpy as np

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.emva_linear import emva_linear

LIMIT_PERCENT = 2.0
EXPOSURE_S = 1e-4
LEVELS = np.concatenate([np.linspace(0.02, 0.9, 20), np.linspace(0.95, 1.1, 5)])
KINDS = ("CCD", "CMOS", "SCMOS")


def read_noise_e(config: Any) -> float:
    """Root mean square over the pixels [e-]."""
    noisy, factor = config.read_noise_rts_fraction, config.read_noise_rts_factor
    spread = math.exp(config.read_noise_nonuniformity**2)
    return float(config.read_noise_e * math.sqrt(spread * (1 - noisy + noisy * factor**2)))


def compared(side: int) -> list[dict[str, Any]]:
    """One row per preset."""
    from getframes import Camera, available_presets, load_preset

    rows = []
    for name in available_presets():
        config = load_preset(name)
        if str(config.sensor_type.value) not in KINDS or config.em_gain != 1:
            continue
        camera = Camera(config, seed=1).with_config(resolution=(side, side))
        bits, black = config.bit_depth, config.bias_offset_adu
        top = min(config.full_well_e, (2**bits - 1 - black) * config.gain_e_per_adu)
        rate = top / config.quantum_efficiency / EXPOSURE_S

        def frames(photons_per_s: float, count: int, seed: int, camera: Any = camera) -> Any:
            light = np.full((side, side), photons_per_s)
            made = [camera.expose(light, EXPOSURE_S, seed=seed + k) for k in range(count)]
            return np.array([np.asarray(one.data) for one in made])

        dark = Stack(frames(0.0, 16, 1), EXPOSURE_S, 0.0, bits=bits)
        flats = [
            Stack(frames(level * rate, 2, 100 * (k + 1)), EXPOSURE_S, level * rate * EXPOSURE_S, bits=bits)
            for k, level in enumerate(LEVELS)
        ]
        found = emva_linear([dark], flats)
        gain, noise, put_in_e = found["K"], found["σ_d"], read_noise_e(config)
        rows.append({
            "preset": name,
            "K_percent": 100 * (gain.value * config.gain_e_per_adu - 1),
            "sigma_d_percent": 100 * (noise.value / put_in_e - 1),
            "K_dn_per_e": 1 / config.gain_e_per_adu,
            "sigma_d_dn": put_in_e / config.gain_e_per_adu,
            "note": noise.note or gain.note,
        })  # fmt: skip
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=160, help="rows, and as many columns")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found = compared(asked.side)
    if asked.json:
        print(json.dumps(found))
    else:
        print(f"{'preset':28} K [DN/e-]  σ_d [DN]   K off [%]  σ_d off [%]  (limit {LIMIT_PERCENT:g})")
        for one in found:
            known = f"{one['K_dn_per_e']:9.3f} {one['sigma_d_dn']:9.3f}"
            print(f"{one['preset']:28} {known} {one['K_percent']:11.2f} {one['sigma_d_percent']:12.2f}  {one['note']}")
