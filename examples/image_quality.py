"""Draw the pictures of docs/image-quality.md and docs/colour-and-geometry.md: charts in front of a simulated camera.

python examples/image_quality.py                 # into image_quality/
python examples/image_quality.py docs/images     # the pictures of docs/image-quality.md
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

import mitsuba_sensor as ms
from mitsuba_sensor.files.appearing import write_drawing
from mitsuba_sensor.optics import spectra
from mitsuba_sensor.pages.drawing import png
from mitsuba_sensor.pages.page import Drawing

SLOPE = math.tan(math.radians(5))
EXPOSURE = ms.Exposure(0.01)


def sharp_edge(rows: int, columns: int) -> np.ndarray:
    """The share of each pixel that is right of an edge."""
    y, x = np.mgrid[: 16 * rows, : 16 * columns] / 16
    right = x - columns / 2 > SLOPE * (y - rows / 2)
    return np.asarray(right.reshape(rows, 16, columns, 16).mean(axis=(1, 3)))


def taken(electrons: np.ndarray, camera: ms.Camera) -> np.ndarray:
    """A frame of so many photoelectrons, without the black level."""
    frame = ms.expose(ms.Photons(electrons, detected=True), camera, EXPOSURE).digital[0]
    dark = ms.expose(
        ms.Photons(0 * electrons, detected=True), camera, EXPOSURE, frames=16, seed=2
    )
    return np.asarray(frame - dark.digital.mean())


def draw_edge(axes: Axes) -> None:
    """Modulation behind each filter of a Bayer camera, and that of its pixel."""
    camera = ms.load_camera("bayer_2mp")
    frame = taken(200 + 3000 * sharp_edge(800, 320), camera)
    tile = (("R", "G"), ("G", "B"))
    for name, plane in ms.lab.Stack(frame[None], 0.01, tile=tile).of_filters().items():
        edge = ms.lab.slanted_edge(plane.mean, sample_px=2)
        edge.modulation.plot(
            axes, f"{name}: {edge.modulation.at(0.25).value:.3f} at 0.25 cy/px"
        )
    frequency = np.linspace(0, 0.5, 101)
    angle = math.atan(SLOPE)
    pixel = np.sinc(frequency * math.cos(angle)) * np.sinc(frequency * math.sin(angle))
    axes.plot(frequency, pixel, "k--", label="theory: the pixel")


def draw_steps(axes: Axes) -> None:
    """Signal-to-noise ratio of a step chart."""
    camera = ms.load_camera("konnik_table1")
    steps = np.concatenate([[0.0], np.geomspace(0.002, 0.9, 15)])
    electrons = np.repeat(camera.pixel.full_well_e * steps, 40)[None] * np.ones((40, 1))
    light = ms.Photons(electrons, detected=True)
    codes = ms.expose(light, camera, EXPOSURE, frames=8).digital
    regions = [(0, 40 * number, 40, 40) for number in range(steps.size)]
    stack = ms.lab.Stack(codes, EXPOSURE.time_s, bits=camera.adc.bits)
    dark = ms.Photons(0 * electrons, detected=True)
    black_dn = ms.expose(dark, camera, EXPOSURE, frames=8, seed=2).digital.mean(axis=0)
    ms.lab.step_chart(stack, regions, 0.2 * steps, black_dn=black_dn).plot_snr(axes)


def draw_colours(axes: Axes) -> None:
    """A ColorChecker as the Bayer camera has it through the matrix that fits best."""
    nm = np.arange(400.0, 701.0, 10.0)
    light = spectra.color_checker(nm) * spectra.d65(nm) * nm
    photons = 40_000 * light / light.sum(axis=1).max()
    scene = np.repeat(photons, 32, axis=0)[None] * np.ones((32, 1, 1))
    camera = ms.load_camera("bayer_2mp")
    frames = ms.expose(ms.Photons(scene, wavelengths_nm=nm), camera, EXPOSURE, frames=4)
    no_light = ms.Photons(0 * scene, wavelengths_nm=nm)
    dark = ms.expose(no_light, camera, EXPOSURE, frames=16, seed=2)
    picture = frames.digital.mean(axis=0) - dark.digital.mean()
    green = (picture[0::2, 1::2] + picture[1::2, 0::2]) / 2
    planes = np.stack([picture[0::2, 0::2], green, picture[1::2, 1::2]], axis=2)
    chart = ms.lab.colour_chart(planes, [(0, 16 * k, 16, 16) for k in range(24)])
    chart.plot(axes)


PICTURES = {
    "image-quality-colours": ("ColorChecker, bayer_2mp", draw_colours),
    "image-quality-steps": ("step chart, konnik_table1", draw_steps),
    "image-quality-edge": ("slanted edge, bayer_2mp", draw_edge),
}


def main() -> None:
    """Draw every picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("image_quality"))
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, (title, draw) in PICTURES.items():
        file = options.folder / f"{name}.png"
        write_drawing(file, png(Drawing(title, draw)))
        print(file)


if __name__ == "__main__":
    main()
