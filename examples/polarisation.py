"""Make the pictures of docs/optics-and-pixels.md: balls on a polished table, seen by a polarisation camera.

python examples/polarisation.py                                      # small, into polarisation/
python examples/polarisation.py -o docs/images --width 240 --spp 128    # the pictures of docs/optics-and-pixels.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.polarization import Polarization, hues, polarization
from mitsuba_sensor.output.preview import preview

SCENE = Path(__file__).parent.parent / "scenes" / "polarisation.xml"
EXPOSURE = ms.Exposure(0.004)
FRAMES = 8
STRIP_ROWS = 4  # colours below the picture of the angle


def frames_of(width: int, spp: int) -> ms.Frames:
    """Return frames of the scene after the polarisers of the camera."""
    light = ms.render(SCENE, "sony_imx250mzr", EXPOSURE, width=width, spp=spp)
    return ms.expose(light, frames=FRAMES)


def measured(frames: ms.Frames) -> Polarization:
    """Return degree and angle of polarisation of every tile of four pixels."""
    camera = frames.camera
    assert camera.sensor.polarizers is not None
    stack = Stack(frames.digital, EXPOSURE.time_s, bits=camera.adc.bits)
    dark = ms.expose(np.zeros(stack.shape), camera, EXPOSURE, frames=FRAMES, seed=2)
    black_dn = dark.digital.mean(axis=0)
    full_dn = camera.system_gain_dn_per_e * camera.pixel.full_well_e
    return polarization(
        stack,
        camera.sensor.polarizers,
        black_dn=black_dn,
        extinction_ratio=400,
        saturation_dn=float(black_dn.mean()) + 0.95 * full_dn,
    )


def with_angles(picture: np.ndarray) -> np.ndarray:
    """Return the picture above a strip with the colours of 0° to 180°, from left to right."""
    columns = picture.shape[1]
    angles = np.linspace(0.0, 180.0, columns, endpoint=False)
    strip = np.repeat(hues(angles)[None], STRIP_ROWS, axis=0)
    gap = np.zeros((1, columns, 3))
    colours = np.concatenate([gap, strip])
    return np.concatenate([picture, (255 * colours + 0.5).astype(np.uint8)])


def grey(values: np.ndarray) -> np.ndarray:
    """Return an 8-bit picture, shape (H, W, 3), of values from 0 to 1."""
    levels = np.clip(np.nan_to_num(values), 0.0, 1.0)
    return np.repeat((255 * levels + 0.5).astype(np.uint8)[..., None], 3, axis=-1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("polarisation"))
    parser.add_argument("--width", type=int, default=96, help="columns of the frames")
    parser.add_argument("--spp", type=int, default=32, help="light paths per pixel")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    frames = frames_of(options.width, options.spp)
    result = measured(frames)
    colours = (255 * result.colours() + 0.5).astype(np.uint8)
    pictures = {
        "frame": preview(frames.digital[0], frames.camera),
        "dolp": grey(result.dolp_without_bias),
        "aolp": with_angles(colours),
    }
    for name, picture in pictures.items():
        times = 1 if name == "frame" else 2  # a tile is two pixels wide
        file = options.out / f"polarisation_{name}.png"
        write_png(file, np.repeat(np.repeat(picture, times, axis=0), times, axis=1))
        print(file)
    print(*result.quantities, sep="\n")


if __name__ == "__main__":
    main()
