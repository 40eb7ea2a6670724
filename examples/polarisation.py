"""Make the pictures of docs/optics-and-pixels.md: balls on a polished table, seen by a polarisation camera.

python examples/polarisation.py                                      # small, into polarisation/
python examples/polarisation.py -o docs/images --width 384 --spp 32    # the pictures of docs/optics-and-pixels.md
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.polarization import Polarization, hues, polarization
from mitsuba_sensor.output.preview import preview

SCENE = Path(__file__).parent.parent / "scenes" / "polarisation.xml"
EXPOSURE = ms.Exposure(0.004)
FRAMES = 8


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


def with_bar(path: Path, picture: np.ndarray, label: str, colours: Any, largest: float) -> None:
    """Write a picture with a colour bar from 0 to ``largest``.  colours : colour map."""
    figure = Figure(figsize=(5.6, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.imshow(picture, cmap=colours, vmin=0, vmax=largest, interpolation="nearest")
    axes.set_axis_off()
    scale = ScalarMappable(Normalize(0, largest), colours)
    figure.colorbar(scale, ax=axes, label=label, ticks=np.linspace(0, largest, 5))
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("polarisation"))
    parser.add_argument("--width", type=int, default=96, help="columns of the frames")
    parser.add_argument("--spp", type=int, default=32, help="light paths per pixel")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    frames = frames_of(options.width, options.spp)
    result = measured(frames)
    out = options.out
    write_png(out / "polarisation_frame.png", preview(frames.digital[0], frames.camera))
    degree = np.clip(np.nan_to_num(result.dolp_without_bias), 0.0, 1.0)
    with_bar(
        out / "polarisation_dolp.png", degree, "degree of linear polarisation", "gray", 1.0
    )
    wheel, label = (
        ListedColormap(hues(np.arange(180.0))),
        "angle of linear polarisation [degree]",
    )
    with_bar(out / "polarisation_aolp.png", result.colours(), label, wheel, 180.0)
    print(*result.quantities, sep="\n")


if __name__ == "__main__":
    main()
