"""Make pictures of the night crossing: single lamps, other lamp levels, flicker bands, and an auto-exposure video.

    python examples/night_video.py [-o FOLDER]

One render keeps the light of each lamp group separate, so the second picture needs no further render. In the video a
car approaches; every frame has its own render. Files go to FOLDER (default: out/night). This takes a minute on two
cores.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import png, write_png
from mitsuba_sensor.output.contact_sheet import Captioned, SheetRow, contact_sheet

SCENE = "night_crossing"
GROUPS = {
    "sky": ["sky", "moon"],
    "lamps": "lamp_*",
    "windows": "window_*",
    "signals": "signal_*",
    "headlights": "headlight_*",
}
EVENING = {"sky": 6, "lamps": 0.3, "windows": 4, "signals": 2}
"""Levels of another hour: more light from the sky and the windows, and dimmed lamps."""
ROLLING = {"sensor.shutter": "rolling", "sensor.row_time_us": 60.0}
SPP, WIDTH, VIDEO_SPP, VIDEO_WIDTH, FRAMES, FPS = 48, 240, 16, 96, 6, 10


def pictures(folder: Path) -> None:
    """Write two PNG files: the groups and a mix of them, and the flicker bands."""
    light = ms.render(SCENE, light_groups=GROUPS, spp=SPP, width=WIDTH, progress=False)
    dark = dict.fromkeys(GROUPS, 0.0)
    levels = {f"{name} only": {**dark, name: 1.0} for name in GROUPS}
    levels["all, earlier in the evening"] = EVENING
    shown = [
        Captioned(png(ms.expose(light.with_lights(one)).preview()), [name])
        for name, one in levels.items()
    ]
    rows = [SheetRow([], shown[first : first + 3]) for first in (0, 3)]
    write_png(folder / "night_lights.png", contact_sheet(rows))
    assert light.rendered_for is not None and light.rendered_for.camera is not None
    camera = light.rendered_for.camera.replace(**ROLLING)
    bands = []
    for lamps, name in (("5", "steady lamps"), ("5 pwm(300, 0.2)", "lamps pulsed at 300 Hz")):
        frames = ms.expose(light.with_lights(lamps=lamps), camera, ms.Exposure(1 / 1000))
        bands.append(Captioned(png(frames.preview(gain=8.0)), [name]))
    write_png(folder / "night_bands.png", contact_sheet([SheetRow([], bands)]))


def video(folder: Path) -> None:
    """Write frames.webp and the files of the frames: the car approaches, and the exposure reaches its target."""
    options: dict[str, Any] = {"motion": SCENE, "width": VIDEO_WIDTH, "spp": VIDEO_SPP}
    control = ms.AutoExposure(target=0.1, damping=0.6, delay=1)
    captured = ms.capture(
        SCENE,
        exposure=ms.Exposure(0.002),
        frames=FRAMES,
        fps=FPS,
        auto_exposure=control,
        progress=False,
        **options,
    )
    captured.save(folder)
    for one in captured.timed:
        print(f"{one.start_s:.2f} s: {one.frames.first.exposure.time_s:.5f} s")


def main() -> None:
    """Write the two pictures, and the video in a separate folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("out/night"))
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    pictures(folder)
    video(folder / "video")


if __name__ == "__main__":
    main()
