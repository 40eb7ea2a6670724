"""Expose one render with several exposure times and print signal, noise and clipping.

    python examples/exposure_sweep.py [-o FOLDER]

With FOLDER it also writes a raw TIFF of each exposure into this folder, and exposures.png with all of them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import png, write_png
from mitsuba_sensor.files.tiff import write_tiff
from mitsuba_sensor.output.contact_sheet import Captioned, SheetRow, contact_sheet
from mitsuba_sensor.output.preview import preview

SCENE = Path(__file__).resolve().parent.parent / "scenes" / "cornell_box.xml"

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument(
    "-o", "--out", type=Path, help="for a raw TIFF of each exposure, and exposures.png"
)
folder = parser.parse_args().out

camera = ms.load_camera("konnik_table1")
irradiance = ms.render(SCENE, camera, ms.Exposure(0.1), spp=64, width=256)
shown = []

print("exposure s   mean DN   σ DN (theory, noise only)   saturated pixels")
for time_s in (0.001, 0.01, 0.1, 1.0):
    exposure = ms.Exposure(time_s)
    frames = ms.expose(ms.collect(irradiance, camera, exposure), camera, exposure)
    last, counts = frames.report["stages"][-1], frames.report["counts"]
    print(
        f"{time_s:10g} {last['mean_frame']:9.1f} {last['sigma_expected']:11.2f} {counts['clipped_full_well']:29d}"
    )
    shown.append(Captioned(png(preview(frames.digital[0], camera)), [f"{time_s:g} s"]))
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        write_tiff(folder / f"exposure_{time_s:g}s.tiff", frames.digital)
if folder:
    write_png(folder / "exposures.png", contact_sheet([SheetRow(["exposure time"], shown)]))
