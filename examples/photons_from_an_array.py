"""Frames without a renderer: mean photons per pixel may come from anywhere, here from a NumPy ramp.

    python examples/photons_from_an_array.py

Prints the photon-transfer curve of the camera: the variance over frames grows with the mean, and the slope is the
system gain K, until the full well cuts both.
"""

from __future__ import annotations

import numpy as np

import mitsuba_sensor as ms

camera = ms.load_camera("konnik_table1")
exposure = ms.Exposure(time_s=0.1)

ramp = np.linspace(0.0, 60_000.0, 512)  # mean photons per pixel at the camera's reference wavelength
photons = np.tile(ramp, (64, 1))
frames = ms.expose(photons, camera, exposure, seed=1, serial=7, frames=32)

mean = frames.digital.mean(axis=0)
variance = frames.digital.var(axis=0, ddof=1)  # over frames: fixed patterns drop out
print(f"K by theory: {frames.report['K_dn_per_e']:.4f} DN/e-")
print("mean DN   variance DN²")
for column in range(0, 512, 64):
    columns = slice(column, column + 64)
    print(f"{mean[:, columns].mean():7.1f}   {variance[:, columns].mean():7.2f}")
