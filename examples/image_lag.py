"""Make the picture of image lag in docs/stages.md: the ghost of a bright bar that moves.

python examples/image_lag.py                # into image_lag/
python examples/image_lag.py docs/images    # the picture of docs/stages.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png

HEIGHT, WIDTH, BAR_PX, STEP_PX = 160, 256, 48, 24
DARK_E, BRIGHT_E, LAG, BRIGHTER = 60.0, 8000.0, 0.05, 10.0
EXPOSURE = ms.Exposure(0.01)


def light(number: int) -> ms.Photons:
    """Photoelectrons of a frame: a bar that moves to the right by a part of its width."""
    mean = np.full((HEIGHT, WIDTH), DARK_E)
    begin = 40 + number * STEP_PX
    mean[20:-20, begin : begin + BAR_PX] = BRIGHT_E
    return ms.Photons(mean, detected=True)


def picture(camera: ms.Camera, photons: ms.Photons, brighter: float = 1.0) -> np.ndarray:
    """Frame 3 in grey, from the black level to the bar, as a screen shows it."""
    frames = ms.expose(photons, camera, EXPOSURE, first_frame=3)
    white_dn = BRIGHT_E * camera.system_gain_dn_per_e / brighter
    share = np.clip((frames.digital[0] - camera.adc.black_level_dn) / white_dn, 0, 1)
    return np.uint8(np.round(255 * share ** (1 / 2.2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("image_lag"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    plain = ms.load_camera("sony_imx174").replace(**{"adc.black_level_dn": 64.0})
    lagging = plain.replace(**{"quantum_efficiency.image_lag": LAG})
    seen = light(3).changed(by_readout={"before": light(2)})
    pictures = [
        picture(plain, light(3)),
        picture(lagging, seen),
        picture(lagging, seen, BRIGHTER),
    ]
    border = np.full((HEIGHT, 6), 255, np.uint8)
    row = np.hstack([pictures[0], border, pictures[1], border, pictures[2]])
    path = folder / "image_lag.png"
    write_png(path, row)
    print(f"{path}: without lag, with lag, and that brighter")


if __name__ == "__main__":
    main()
