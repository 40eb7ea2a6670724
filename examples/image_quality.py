"""Draw the pictures of the pages about image quality: charts in front of a simulated camera.

python examples/image_quality.py                 # into image_quality/
python examples/image_quality.py docs/images     # the pictures of these pages and docs/contrast-and-flicker.md
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from scipy.ndimage import median_filter

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


def taken(
    electrons: np.ndarray, camera: ms.Camera, frames: int = 1, seed: int = 0
) -> np.ndarray:
    """Frames of so many photoelectrons, (N, H, W), without the black level."""
    light, no_light = (ms.Photons(level, detected=True) for level in (electrons, 0 * electrons))
    codes = ms.expose(light, camera, EXPOSURE, frames=frames, seed=seed).digital
    dark = ms.expose(no_light, camera, EXPOSURE, frames=16, seed=2)
    return np.asarray(codes - dark.digital.mean())


def channels(mosaic: np.ndarray) -> np.ndarray:
    """Red, green and blue of the tiles of a Bayer camera, (H, W, 3)."""
    green = (mosaic[0::2, 1::2] + mosaic[1::2, 0::2]) / 2
    return np.stack([mosaic[0::2, 0::2], green, mosaic[1::2, 1::2]], axis=2)


def draw_edge(axes: Axes) -> None:
    """Modulation behind each filter of a Bayer camera, and that of its pixel."""
    camera = ms.load_camera("bayer_2mp")
    frames = taken(200 + 3000 * sharp_edge(800, 320), camera)
    tile = (("R", "G"), ("G", "B"))
    for name, plane in ms.lab.Stack(frames, 0.01, tile=tile).of_filters().items():
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
    chart = ms.lab.colour_chart(channels(picture), [(0, 16 * k, 16, 16) for k in range(24)])
    chart.plot(axes)


def show_chart(axes: Axes, picture: np.ndarray) -> None:
    """The picture of a chart in a corner of a drawing."""
    inset = axes.inset_axes((0.03, 0.05, 0.34, 0.45))
    inset.imshow(picture, cmap="gray", interpolation="nearest")
    inset.set_axis_off()


def draw_star(axes: Axes) -> None:
    """Modulation of a star, and that of the pixel: the root mean square over all directions."""
    y, x = np.mgrid[:1600, :1600] / 8 - 100.2
    star = 0.5 + 0.3 * np.cos(72 * np.arctan2(y, x))
    light = 1000 * star.reshape(200, 8, 200, 8).mean(axis=(1, 3))
    (frame,) = taken(light, ms.load_camera("sony_imx174"))
    ms.lab.siemens_star(frame, 72, contrast=0.6).modulation.plot(axes)
    angle = np.pi * (np.arange(360) + 0.5) / 360
    frequency = np.linspace(0, 0.6, 121)
    along, across = np.sinc(
        frequency[:, None] * np.array([np.cos(angle), np.sin(angle)])[:, None]
    )
    axes.plot(
        frequency,
        np.sqrt(np.square(along * across).mean(axis=1)),
        "k--",
        label="theory: the pixel",
    )
    axes.set(xlim=(0, 0.6), ylim=(0, 1.1))
    show_chart(axes, frame[50:150, 50:150])


def dead_leaves_chart(side: int) -> np.ndarray:
    """Discs that cover each other, 4 × 4 points for a pixel."""
    rng = np.random.default_rng(1)
    leaves = np.full((4 * side, 4 * side), 0.5)
    for _ in range(800):
        y, x = rng.uniform(0, 4 * side, 2)
        radius = min(8 / rng.uniform(0.05, 1), 160.0)
        rows, columns = (slice(max(int(c - radius), 0), int(c + radius) + 2) for c in (y, x))
        part = leaves[rows, columns]
        down, right = np.indices(part.shape) + np.array([[[rows.start]], [[columns.start]]])
        part[np.hypot(down - y, right - x) < radius] = rng.uniform(0.25, 0.75)
    return leaves


def draw_leaves(axes: Axes) -> None:
    """Modulation of a texture by both methods, and of frames behind a median filter, which takes noise and texture."""
    leaves = dead_leaves_chart(256)
    light = 4000 * leaves.reshape(256, 4, 256, 4).mean(axis=(1, 3))
    frames = taken(light, ms.load_camera("sony_imx174"), 4)
    filtered = median_filter(frames, size=(1, 3, 3))
    for pictures, method, label in (
        (frames, "cross", "cross"),
        (frames, "power", "power"),
        (filtered, "cross", "cross, median filter"),
    ):
        ms.lab.dead_leaves(pictures, leaves, method=method).modulation.plot(axes, label)
    axes.set_ylim(0, 1.1)
    show_chart(axes, frames[0, :128, :128])


def draw_flat_field(axes: Axes) -> None:
    """Light that falls off towards the corners, most behind the blue filter and least behind the green ones."""
    y, x = (np.mgrid[:256, :384] + 0.5) / [[[128]], [[192]]] - 1
    falls = np.tile([[0.15, 0.13], [0.13, 0.17]], (128, 192))
    light = 10_000 / (1 + falls * (x**2 + y**2)) ** 2
    frames = taken(light, ms.load_camera("bayer_2mp"), 16)
    measured = ms.lab.flat_field(channels(frames.mean(axis=0)))
    measured.plot(axes)
    height = np.linspace(0, 1, 101)
    axes.plot(height, 100 / (1 + 0.3 * height**2) ** 2, "k--", label="theory, channel 0: red")
    print(*measured.quantities, sep="\n")


def draw_flicker(axes: Axes) -> None:
    """A lamp of pulses over 60 frames, and the level of the same pixels without it."""
    rng = np.random.default_rng(1)
    led = 4000.0 * (rng.random(60) < 0.4)
    camera = ms.load_camera("sony_imx174")
    frames = [
        taken(np.full((16, 16), 1000 + light), camera, seed=10 + number)[0]
        for number, light in enumerate(led)
    ]
    off_dn = taken(np.full((16, 16), 1000.0), camera, 16).mean()
    measured = ms.lab.flicker(np.array(frames), off=off_dn)
    measured.plot(axes)
    axes.axhline(off_dn, ls="--", color="k", lw=1, label="without the lamp")
    axes.set_ylim(0, None)
    print(*measured.quantities, sep="\n")


PICTURES = {
    "image-quality-colours": ("ColorChecker, bayer_2mp", draw_colours),
    "image-quality-steps": ("step chart, konnik_table1", draw_steps),
    "image-quality-edge": ("slanted edge, bayer_2mp", draw_edge),
    "image-quality-star": ("Siemens star, sony_imx174", draw_star),
    "image-quality-leaves": ("dead leaves, sony_imx174", draw_leaves),
    "image-quality-flat-field": ("flat field, bayer_2mp", draw_flat_field),
    "image-quality-flicker": ("pulsed lamp, sony_imx174", draw_flicker),
}


def main() -> None:
    """Draw every picture, or one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("image_quality"))
    parser.add_argument("--only", choices=PICTURES)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, (title, draw) in PICTURES.items():
        if options.only not in (None, name):
            continue
        file = options.folder / f"{name}.png"
        write_drawing(file, png(Drawing(title, draw)))
        print(file)


if __name__ == "__main__":
    main()
