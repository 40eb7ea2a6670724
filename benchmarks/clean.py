"""Clean frames against the averages of 2000 frames of 16 × 24 pixels: distance in standard errors, ratio of variances.

python benchmarks/clean.py [--cost]

--cost : instead, processor seconds per 2 megapixels from darkness to daylight.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.stages.gains import gain_dn_per_e

SHAPE, FRAMES, EXPOSURE = (16, 24), 2000, ms.Exposure(0.1)
QUIET = {
    "source_follower.white_nv_per_rthz": None,
    "source_follower.read_noise_e": 0.8,
    "readout.reset": "true_cds",
    "adc.black_level_dn": 20,
}
CURVED = {
    "source_follower.vv_nonlinearity": 1.05,
    "adc.gamma": 1.04,
    "readout.ve_nonlinearity": 1.0,
}
RTS = {
    "dark_current.rts_fraction": 0.3,
    "dark_current.rts_amplitude_e_per_s": 3000.0,
    "dark_current.rts_switching": 1.0,
    "dark_current.rts_duty": 0.3,
}
HOT = [{"weight": 0.2, "family": "uniform", "low": 1000.0, "high": 90000.0, "unit": "e_per_s"}]
CHANGED: dict[str, dict[str, object]] = {
    "0.1 DN of noise": QUIET,
    "RTS pixels": RTS,
    "RTN pixels": {
        "source_follower.rtn_pixel_fraction": 0.3,
        "source_follower.rtn_pixel_amplitude_e": 60.0,
    },
    "read noise of its own in every pixel": {"source_follower.read_noise_cv": 0.5},
    "gains of columns": {"readout.prnu_col": 0.03, "pixel.dsnu_e": 8.0},
    "curves": CURVED,
    "curves, 0.1 DN of noise": {**QUIET, **CURVED},
    "unequal steps": {"adc.dnl_lsb": {str(k): 0.7 - 1.4 * (k % 2) for k in range(10, 3000)}},
    "hot pixels": {"dark_current.cv": 0.5, "dark_current.components": HOT},
    "black level 0": {"adc.black_level_dn": 0},
}
COSTED = ("bayer_2mp", "moravian_c1_5000", "sony_imx174", "konnik_table1", "sony_a7s2")
LEVELS = (0.1, 1.0, 5.0, 20.0, 100.0, 1000.0, 10000.0)
CAMERAS = ("konnik_table1", "bayer_2mp", "rgbir_2mp", "eev_44_82")


def cases() -> Iterator[tuple[str, ms.Camera]]:
    """Cameras by name."""
    yield from ((name, ms.load_camera(name)) for name in CAMERAS)
    table1 = ms.load_camera("konnik_table1")
    yield from ((name, table1.replace(**changes)) for name, changes in CHANGED.items())


def compare(camera: ms.Camera, photons: np.ndarray) -> tuple[float, float, float, float]:
    """Largest and rms distance of the pixels' averages [standard errors], variance over theory, CPU seconds."""
    start = time.process_time()
    found = ms.expose(photons, camera, EXPOSURE)
    clean, variance = found.clean.astype(float), found.temporal_variance.astype(float)
    seconds = time.process_time() - start
    off, square = np.zeros(clean.shape), np.zeros(clean.shape)
    for frame in ms.stream(photons, camera, EXPOSURE, frames=FRAMES):
        off += (frame - clean) / FRAMES
        square += (frame - clean) ** 2 / FRAMES
    moving = variance > 0.01
    z = off[moving] / np.sqrt(variance[moving] / FRAMES)
    if not z.size:
        return 0.0, 0.0, 1.0, seconds
    ratio = float(np.sum((square - off**2)[moving]) / np.sum(variance[moving]))
    return float(np.abs(z).max()), float(np.sqrt(np.mean(z**2))), ratio, seconds


def print_cost() -> None:
    """Print processor seconds per 2 Mpx, from a window of 300 × 800 pixels whose light varies by a factor of two."""
    print(f"| mean photons | {' | '.join(COSTED)} |\n{'|---' * (len(COSTED) + 1)}|")
    for photons in LEVELS:
        light = photons * np.random.default_rng(1).lognormal(0.0, 0.7, (300, 800))
        cells = []
        for name in COSTED:
            frames = ms.expose(light, ms.load_camera(name), EXPOSURE)
            start = time.process_time()
            _ = frames.pixel_moments
            cells.append(f"{(time.process_time() - start) * 2e6 / light.size:.1f}")
        print(f"| {photons:g} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print a table: dark, half and full."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cost", action="store_true", help="processor seconds instead")
    if parser.parse_args().cost:
        print_cost()
        return
    print(
        "| camera | light | largest z | rms z | variance over theory | CPU s |\n|---|---|---|---|---|---|"
    )
    for name, camera in cases():
        one = ms.expose(np.ones(SHAPE), camera, ms.Exposure(0.0)).detected.mean_e.max()
        top = min(camera.pixel.full_well_e, (2**camera.adc.bits - 1) / gain_dn_per_e(camera))
        for light, share in (
            ("dark", 0.0),
            ("100 e-", 100 / top),
            ("half", 0.5),
            ("at the clip", 0.995),
        ):
            largest, rms, ratio, seconds = compare(camera, np.full(SHAPE, share * top / one))
            print(
                f"| {name} | {light} | {largest:.2f} | {rms:.3f} | {ratio:.4f} | {seconds:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
