"""Make a stereo sequence for visual odometry: two cameras drive through a street at night, towards a car.

    python examples/stereo_sequence.py -o out/stereo

This copies the scene night_crossing, gives it a second sensor 0.3 m to the right of the first one, makes a dataset of
frames 0.2 s apart, and writes it as KITTI and EuRoC. The picture has a row for each camera.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.exports.export import export
from mitsuba_sensor.files.png import png, write_png
from mitsuba_sensor.files.scene_copies import copy_scene
from mitsuba_sensor.output.contact_sheet import Captioned, SheetRow, contact_sheet
from mitsuba_sensor.output.preview import preview

BASELINE_M = 0.3
BRIGHTER = 3.0  # factor of the light in the picture
NAMES = "left", "right"
DATASET = """
name = "stereo"
licence = "CC0-1.0"
outputs = ["raw", "preview"]
render = {{ width = {width}, spp = {spp}, denoise = true }}
cameras = [{{ camera = "sony_a7s2" }}]
grid = {{ gain = [3200], exposure_s = [0.02] }}
[[scenes]]
name = "street"
file = "night_crossing.xml"
motion = "night_crossing.toml"
sensors = "all"
[scenes.path]
views = {views}
keys = [
    {{ time_s = 0, origin_m = [3.2, 1.4, 0], target_m = [1.1, 1.1, -9.8] }},
    {{ time_s = {end_s}, origin_m = [3.2, 1.4, -1], target_m = [1.1, 1.1, -10.8] }},
]
"""


def with_second_sensor(scene: str) -> str:
    """Return the text of a scene with a second sensor to the right of the first one."""
    found = re.search(r"<sensor.*?</sensor>", scene, re.S)
    assert found is not None
    left, right = (found[0].replace("<sensor", f'<sensor id="{name}"', 1) for name in NAMES)
    move = (
        f'<transform name="to_world">\n<translate x="{-BASELINE_M}"/>'  # x of a sensor is left
    )
    right = right.replace('<transform name="to_world">', move)
    return scene.replace(found[0], f"{left}\n    {right}")


def main() -> None:
    """Make the dataset, both exports and the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        default=Path("out/stereo"),
        help="new, for scene, dataset and exports (default out/stereo)",
    )
    parser.add_argument("--width", type=int, default=192, help="pixels (default 192)")
    parser.add_argument("--spp", type=int, default=64, help="samples of a pixel (default 64)")
    parser.add_argument(
        "--views", type=int, default=4, help="frames of each camera (default 4)"
    )
    options = parser.parse_args()

    scenes = options.out / "scene"
    copy_scene("night_crossing", scenes, force=True)
    file = scenes / "night_crossing.xml"
    file.write_text(with_second_sensor(file.read_text("utf-8")), "utf-8")
    sizes = {"width": options.width, "spp": options.spp, "views": options.views}
    text = DATASET.format(end_s=0.2 * (options.views - 1), **sizes)
    (scenes / "stereo.toml").write_text(text, "utf-8")
    make_dataset(scenes / "stereo.toml", options.out / "dataset", roots=[scenes])
    for format in ("kitti", "euroc"):
        export(options.out / "dataset", format, options.out / format)
    print((options.out / "kitti/sequences/00/calib.txt").read_text("utf-8"))

    samples = ms.Dataset(options.out / "dataset")
    rows = []
    for name in NAMES:
        pictures = [
            Captioned(
                png(preview(sample.read("raw")[0], sample.camera, BRIGHTER)),
                [f"{sample.values['time_s']:g} s", f"shown {BRIGHTER:g} x brighter"],
            )
            for sample in samples.where(sensor=name)
        ]
        rows.append(SheetRow([name], pictures))
    write_png(options.out / "stereo_sequence.png", contact_sheet(rows))


if __name__ == "__main__":
    main()
