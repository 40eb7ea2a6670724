"""What moves and what is where: a fan through a global and a rolling shutter, and the ground truth of the still life.

python examples/light_pictures.py                                    # small and quick, into light_pictures/
python examples/light_pictures.py docs/images --size 256 --spp 128   # the pictures of docs/light.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.io.files import write_png
from mitsuba_sensor.io.preview import preview
from mitsuba_sensor.render.aovs import render_aovs

SCENES = Path(__file__).parent.parent / "scenes"
EXPOSURE = ms.Exposure(0.0005)
ROW_TIME_US = 40.0  # 256 rows in 10 ms, while the fan turns by a quarter


def fan(shutter: str, size: int, spp: int) -> np.ndarray:
    """The turning fan behind one shutter, as a picture for the eye."""
    camera = ms.load_camera("konnik_table1").replace(
        **{"sensor.shutter": shutter, "sensor.row_time_us": ROW_TIME_US * 256 / size, "pixel.fill_factor": 1.0}
    )
    light = ms.render(
        SCENES / "rolling_fan.xml", camera, EXPOSURE, spp=spp, wavelength_nm=550, bandwidth_nm=300,
        motion=SCENES / "rolling_fan.toml", parameters={"width": size, "height": size},
    )  # fmt: skip
    frame = ms.expose(ms.collect(light, camera, EXPOSURE), camera, EXPOSURE)
    return preview(frame.digital[0], camera, gain=3.0)


def truth(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Depth (near is bright) and normals (x, y, z as red, green, blue) of the still life."""
    found = render_aovs(
        SCENES / "still_life.xml", ms.load_camera("bayer_2mp"), parameters={"width": size, "height": size * 3 // 4}
    )
    seen = np.isfinite(found.depth_m)
    near, far = np.percentile(found.depth_m[seen], (0, 95))
    depth = np.where(seen, 1 - 0.9 * np.clip((found.depth_m - near) / (far - near), 0, 1), 0)
    normal = np.where(seen[..., None], 0.5 + 0.5 * np.nan_to_num(found.normal), 0)
    return (255 * depth).astype(np.uint8), (255 * normal).astype(np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("light_pictures"))
    parser.add_argument("--size", type=int, default=48, help="columns of each picture")
    parser.add_argument("--spp", type=int, default=16, help="light paths per pixel")
    words = parser.parse_args()
    words.folder.mkdir(parents=True, exist_ok=True)
    depth, normal = truth(words.size)
    pictures = {f"fan_{s}": fan(s, words.size, words.spp) for s in ("global", "rolling")}
    for name, picture in {**pictures, "still_life_depth": depth, "still_life_normal": normal}.items():
        write_png(words.folder / f"{name}.png", picture)
        print(words.folder / f"{name}.png")


if __name__ == "__main__":
    main()
