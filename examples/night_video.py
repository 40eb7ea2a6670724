"""Lamps of the night crossing one by one and relit, bands of flicker, and a video with automatic exposure.

    python examples/night_video.py [-o FOLDER]

One render keeps the light of each group of lamps apart; the second picture needs no other one. In the video the car
comes, with a render for every frame. All are written to FOLDER, by default out/night; it takes a minute on two cores.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png

SCENE = "night_crossing"
GROUPS = {
    "sky": ["sky", "moon"],
    "lamps": "lamp_*",
    "windows": "window_*",
    "signals": "signal_*",
    "headlights": "headlight_*",
}
EVENING = {"sky": 6, "lamps": 0.3, "windows": 4, "signals": 2}
"""Levels of another hour: more light of the sky and the windows, and lamps that are dimmed."""
ROLLING = {"sensor.shutter": "rolling", "sensor.row_time_us": 60.0}
SPP, WIDTH, VIDEO_SPP, VIDEO_WIDTH, FRAMES, FPS = 48, 240, 16, 96, 6, 10


def pictures(folder: Path) -> None:
    """The groups and a mix of them, and the bands: two PNG files."""
    light = ms.render(SCENE, light_groups=GROUPS, spp=SPP, width=WIDTH, progress=False)
    dark = dict.fromkeys(GROUPS, 0.0)
    alone = [{**dark, name: 1.0} for name in GROUPS]
    shown = [ms.expose(light.with_lights(one)).preview() for one in (*alone, EVENING)]
    rows = [np.concatenate(shown[first : first + 3], axis=1) for first in (0, 3)]
    write_png(folder / "night_lights.png", np.concatenate(rows))
    assert light.rendered_for is not None and light.rendered_for.camera is not None
    camera = light.rendered_for.camera.replace(**ROLLING)
    bands = [
        ms.expose(light.with_lights(lamps=lamps), camera, ms.Exposure(1 / 1000)).preview(
            gain=8.0
        )
        for lamps in ("5", "5 pwm(300, 0.2)")
    ]
    write_png(folder / "night_bands.png", np.concatenate(bands, axis=1))


def video(folder: Path) -> None:
    """The car comes, and the exposure goes to its target: frames.webp and the files of the frames."""
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
    """Write the two pictures, and the video in a folder of its own."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("out/night"))
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    pictures(folder)
    video(folder / "video")


if __name__ == "__main__":
    main()
