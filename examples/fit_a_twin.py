"""Fit a twin to frames of a camera, and take the same frames with the twin.

    python examples/fit_a_twin.py [-o PICTURE]

The fit turns bias, dark and flat frames of one sensor unit into camera tables and measured maps. This prints true and
fitted values side by side, and draws a bias frame of each and histograms of their dark frames.
"""

from __future__ import annotations

import argparse

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.camera.camera_file import camera_from
from mitsuba_sensor.pages.drawing import COLOURS
from mitsuba_sensor.stages.gains import gain_dn_per_e

ROWS, COLUMNS, QE, LONG_S = 240, 320, 0.6, 20.0
WELL_E = 20_000.0
CHANGES = {
    "sensor.rows": ROWS,
    "sensor.columns": COLUMNS,
    "quantum_efficiency.value": QE,
    "quantum_efficiency.wavelengths_nm": [400, 700],
    "quantum_efficiency.tile": None,
    "pixel.full_well_e": WELL_E,
    "pixel.prnu": 0.01,
    "pixel.dsnu_e": 4.0,
    "dark_current.rate_e_per_s": 20.0,
    "dark_current.cv": 0.3,
    "source_follower.read_noise_e": 6.0,
    "source_follower.read_noise_cv": 0.2,
    "readout.row_noise_e": 3.0,
    "readout.dsnu_col": 2e-4,
    "readout.dsnu_row": 1e-4,
    "adc.black_level_dn": 64.0,
}
parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("-o", "--out", metavar="PICTURE", help="PNG file of the picture")
picture = parser.parse_args().out
camera = ms.load_camera("bayer_2mp").replace(**CHANGES)


def stack(photons: float, time_s: float, frames: int, seed: int) -> ms.lab.Stack:
    """Return frames under uniform illumination."""
    taken = ms.expose(photons, camera, ms.Exposure(time_s), frames=frames, seed=seed)
    name = f"{'flat' if photons else 'dark'}_{time_s:g}s"
    return ms.lab.Stack(
        taken.digital, time_s, photons, 298.15, bits=camera.adc.bits, source=name
    )


levels = (0.02, 0.06, 0.12, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2)
darks = [
    stack(0.0, time_s, 32, seed) for seed, time_s in enumerate((0.0, 0.01, LONG_S), start=1)
]
flats = [
    stack(x * WELL_E / QE, 0.01, 32 if x == 0.5 else 4, 10 + k) for k, x in enumerate(levels)
]
twin = ms.lab.fit(ms.lab.Bench((darks[0],), tuple(darks[1:]), tuple(flats)))
made = camera_from(twin.tables(), "twin")

found = twin.figures()
put_in = {
    "K": gain_dn_per_e(camera),
    "σ_read": camera.source_follower.read_noise_e,
    "σ_row": camera.readout.row_noise_e,
    "PRNU_pixel": camera.pixel.prnu,
    "µ_I": camera.dark_current.rate_e_per_s,
    "D_N": camera.dark_current.cv,
}
rows = [(name, value, found[name].quantity) for name, value in put_in.items()]
for name, value, q in rows:
    print(
        f"{name:10} put in {value:8.4g}   came back {q.value:8.4g} ({q.low:.4g} to {q.high:.4g}) {q.unit}"
    )

frames = ms.expose(0.0, made, ms.Exposure(LONG_S), maps=twin.maps, frames=32, seed=99)
real = stack(0.0, LONG_S, 32, 98).frames

if picture:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    low, high = np.quantile(darks[0].frames, (0.01, 0.99))
    short = ms.expose(0.0, made, ms.Exposure(0.0), maps=twin.maps, seed=100)
    for axes, frame, title in (
        (left, darks[0].frames[0], "camera"),
        (middle, short.digital[0], "twin"),
    ):
        shown = axes.imshow(
            frame[:120, :160], cmap="gray", vmin=low, vmax=high, interpolation="nearest"
        )
        axes.set(title=f"bias frame of the {title}", xlabel="column", ylabel="row")
        axes.title.set_size(10)
    figure.colorbar(shown, ax=middle, label="code [DN]")
    edges = np.arange(real.min(), np.quantile(real, 0.9999)) - 0.5
    for values, style, name, colour in (
        (real, "-", "camera", COLOURS[0]),
        (frames.digital, "--", "twin", COLOURS[1]),
    ):
        fraction = np.histogram(values, edges)[0] / values.size
        right.plot(edges[:-1] + 0.5, fraction, style, label=name, color=colour)
    right.set(
        xlabel="code [DN]",
        ylabel="fraction of the pixel values",
        yscale="log",
        title=f"histogram of dark frames of {LONG_S:g} s",
    )
    right.title.set_size(10)
    right.legend(frameon=False)
    figure.savefig(picture, dpi=110)
