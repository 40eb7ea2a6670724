"""Draw the overview of the sheet of a camera: a frame of each chart, and what is measured in it.

python examples/sheet_picture.py                 # into sheet/
python examples/sheet_picture.py docs/images     # the picture of docs/sheet.md
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.bench.sheet.charts import CHARTS
from mitsuba_sensor.bench.sheet.page import sheet_study
from mitsuba_sensor.bench.sheet.setting import settings_of
from mitsuba_sensor.bench.sheet.sheet import simulated_sheet
from mitsuba_sensor.files.appearing import write_drawing
from mitsuba_sensor.pages.drawing import png


def main() -> None:
    """Make the sheet and draw its first picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("sheet"))
    parser.add_argument("--camera", default="bayer_2mp")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore", ms.SensorWarning)
    camera = ms.load_camera(options.camera)
    settings = settings_of(camera, [], [298.15], (1, 1))
    parts = simulated_sheet(camera, settings, CHARTS, lambda done, total, now: print(now))
    file = options.folder / "sheet.png"
    write_drawing(file, png(sheet_study(camera.name, parts).pictures[0]))
    print(file)


if __name__ == "__main__":
    main()
