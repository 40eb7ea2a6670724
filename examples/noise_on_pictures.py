"""Add the noise of a camera to an existing picture, as for augmenting training data.

    python examples/noise_on_pictures.py [-o PICTURE]

One camera takes an 8-bit picture, assumed to be noise-free, at three brightness levels, and develops it again. It
prints the relative noise by theory next to the noise of 32 images, and draws the original and the three results.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import png, write_png
from mitsuba_sensor.output.contact_sheet import Captioned, SheetRow, contact_sheet

SOURCE = Path(__file__).parent.parent / "docs" / "images" / "first_frame_clean.png"
ROWS, COLUMNS = slice(100, 260), slice(120, 360)
ELECTRONS = (2000.0, 200.0, 20.0)  # for white

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument(
    "-o",
    "--out",
    type=Path,
    metavar="PICTURE",
    default=Path("noise_on_pictures.png"),
    help="PNG file of the picture",
)
picture = parser.parse_args().out

clean = np.asarray(Image.open(SOURCE).convert("RGB"))[ROWS, COLUMNS]
shown = [Captioned(png(clean), ["original"])]
for white_e in ELECTRONS:
    noise = ms.SensorNoise(
        "raspberry_pi_hq", white_e=white_e, values="srgb", output="developed", serial=7
    )
    raw = ms.SensorNoise("raspberry_pi_hq", white_e=white_e, values="srgb", serial=7)
    noisy = noise(clean, sample=1)
    frames = np.stack([raw(clean, sample).image for sample in range(32)]).astype(float)
    sigma_dn = np.sqrt(float(noisy.variance_dn2.mean()))
    measured_dn = np.sqrt(frames.var(axis=0, ddof=1).mean())
    print(
        f"white of {white_e:6g} e-: temporal noise {sigma_dn:.2f} DN by theory, {measured_dn:.2f} DN in 32 frames"
    )
    shown.append(Captioned(png(noisy.image), [f"white of {white_e:g} e-"]))

write_png(picture, contact_sheet([SheetRow([], shown)]))
print(f"wrote {picture}")
