"""Measure a simulated camera as a laboratory does, print its figures, and draw its photon transfer curve.

python examples/measure_a_camera.py                                            # konnik_table1, into the current folder
python examples/measure_a_camera.py bayer_2mp --serial 7 -o curve.png
python examples/measure_a_camera.py --size 1024 -o docs/images/lab-photon-transfer.png  # the picture of docs/lab.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.bench.virtual_bench import Setup, virtual_bench
from mitsuba_sensor.files.appearing import write_drawing
from mitsuba_sensor.pages.drawing import png
from mitsuba_sensor.pages.page import Drawing

CURVE = "Photon transfer, linear"


def main() -> None:
    """Parse the options, measure, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("camera", nargs="?", default="konnik_table1")
    parser.add_argument("--serial", type=int, default=1)
    parser.add_argument(
        "--size", type=int, default=192, help="rows and columns that are measured"
    )
    parser.add_argument(
        "-o", "--out", metavar="PICTURE", type=Path, default=Path("photon_transfer.png")
    )
    options = parser.parse_args()
    camera = ms.load_camera(options.camera)
    camera = camera.replace(**{"sensor.rows": options.size, "sensor.columns": options.size})
    bench = virtual_bench(camera, Setup(serial=options.serial))
    for measured in ms.lab.measure_bench(bench):
        print(f"filter {measured.filter_name}" if measured.filter_name else "all pixels")
        for figure in measured.figures.values():
            print(f"    {figure}")
    write_drawing(
        options.out,
        png(Drawing(f"{options.camera}: photon transfer", measured.drawings[CURVE])),
    )


if __name__ == "__main__":
    main()
