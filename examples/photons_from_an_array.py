"""Expose a NumPy ramp of mean photons, without a renderer, and print the photon transfer curve of the camera.

    python examples/photons_from_an_array.py [-o PICTURE]

The temporal variance grows linearly with the mean. The slope is the overall system gain K. At saturation both end.
"""

from __future__ import annotations

import argparse

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.pages.drawing import COLOURS

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("-o", "--out", metavar="PICTURE", help="PNG file of the picture")
picture = parser.parse_args().out

camera = ms.load_camera("konnik_table1")
exposure = ms.Exposure(time_s=0.1)

ramp = np.linspace(
    0.0, 60_000.0, 512
)  # mean photons per pixel at the camera's reference wavelength
photons = np.tile(ramp, (64, 1))
frames = ms.expose(photons, camera, exposure, seed=1, serial=7, frames=32)

mean = frames.digital.mean(axis=0)
variance = frames.digital.var(
    axis=0, ddof=1
)  # over frames: temporal noise only, no fixed-pattern noise
print(f"K by theory: {frames.report['K_dn_per_e']:.4f} DN/e-")
print("mean DN   variance DN²")
for column in range(0, 512, 64):
    columns = slice(column, column + 64)
    print(f"{mean[:, columns].mean():7.1f}   {variance[:, columns].mean():7.2f}")

if picture:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.set_prop_cycle(color=COLOURS)
    axes.plot(
        mean.mean(axis=0), variance.mean(axis=0), ".", ms=4, label="512 columns of 32 frames"
    )
    black_dn, gain = camera.adc.black_level_dn or mean[:, 0].mean(), frames.report["K_dn_per_e"]
    line = np.array([black_dn, 3500.0])
    axes.plot(
        line, gain * (line - black_dn) + variance[:, 0].mean(), label="slope K, by theory"
    )
    axes.set(xlabel="mean [DN]", ylabel="temporal variance [DN²]")
    axes.legend(frameon=False)
    figure.savefig(picture, dpi=110)
