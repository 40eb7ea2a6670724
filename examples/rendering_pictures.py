"""Make the pictures of docs/rendering.md: shutters, denoised and raw light, poses, colours, AOVs.

python examples/rendering_pictures.py                                    # small, into rendering_pictures/
python examples/rendering_pictures.py docs/images --size 256 --spp 128   # the pictures of docs/rendering.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview
from mitsuba_sensor.render.motion.aovs import render_aovs

SCENES = Path(__file__).parent.parent / "scenes"
EXPOSURE = ms.Exposure(0.0005)
LOOK_AT = "0.05,0.04,0.09 0,0.01,0"
ROUGHER_GOLD = {"gold.alpha.value": 0.3}
ROW_TIME_US = 40.0  # 256 rows in 10 ms, while the fan turns by a quarter


def fan(shutter: str, size: int, spp: int) -> np.ndarray:
    """A preview of the turning fan with one kind of shutter."""
    camera = ms.load_camera("konnik_table1").replace(
        **{
            "sensor.shutter": shutter,
            "sensor.row_time_us": ROW_TIME_US * 256 / size,
            "pixel.fill_factor": 1.0,
        }
    )
    irradiance = ms.render(
        SCENES / "rolling_fan.xml", camera, EXPOSURE, spp=spp, wavelength_nm=550, bandwidth_nm=300,
        motion=SCENES / "rolling_fan.toml", parameters={"width": size, "height": size},
    )  # fmt: skip
    frame = ms.expose(ms.collect(irradiance, camera, EXPOSURE), camera, EXPOSURE)
    return preview(frame.digital[0], camera, gain=3.0)


def box(denoise: bool, size: int, spp: int) -> np.ndarray:
    """A preview of a raw frame of the Cornell box, of denoised light or of the render itself."""
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
    irradiance = ms.render(
        SCENES / "cornell_box.xml", camera, exposure, spp=spp, denoise=denoise,
        parameters={"width": size, "height": size},
    )  # fmt: skip
    frame = ms.expose(ms.collect(irradiance, camera, exposure), camera, exposure)
    return preview(frame.digital[0], camera)


def color_checker(size: int, spp: int) -> np.ndarray:
    """frame.png of a ColorChecker in the Bayer camera."""
    camera, exposure = ms.load_camera("bayer_2mp"), ms.Exposure(0.1)
    window = {"width": size * 3 // 2, "height": size}
    irradiance = ms.render(
        SCENES / "color_checker.xml", camera, exposure, spp=spp, parameters=window
    )
    frame = ms.expose(ms.collect(irradiance, camera, exposure), camera, exposure)
    known = irradiance.rendered_for
    return preview(
        frame.digital[0], camera, illuminant=None if known is None else known.illuminant
    )


def still_life(
    look_at: str | None, traverse: dict[str, float], size: int, spp: int
) -> np.ndarray:
    """A preview of the still life from a pose, the file's own if there is none, with values of its parameters."""
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
    irradiance = ms.render(
        SCENES / "still_life.xml", camera, exposure, spp=spp, look_at=look_at, traverse=traverse,
        parameters={"width": size * 3 // 2, "height": size},
    )  # fmt: skip
    frame = ms.expose(ms.collect(irradiance, camera, exposure), camera, exposure)
    return preview(frame.digital[0], camera)


def aovs(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Depth (near is bright) and normals (x, y, z as red, green, blue) of the still life."""
    aov = render_aovs(
        SCENES / "still_life.xml",
        ms.load_camera("bayer_2mp"),
        parameters={"width": size, "height": size * 3 // 4},
    )
    hit = np.isfinite(aov.depth_m)
    near, far = np.percentile(aov.depth_m[hit], (0, 95))
    depth = np.where(hit, 1 - 0.9 * np.clip((aov.depth_m - near) / (far - near), 0, 1), 0)
    normal = np.where(hit[..., None], 0.5 + 0.5 * np.nan_to_num(aov.normal), 0)
    return (255 * depth).astype(np.uint8), (255 * normal).astype(np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("rendering_pictures"))
    parser.add_argument("--size", type=int, default=48, help="width of each picture in pixels")
    parser.add_argument("--spp", type=int, default=16, help="light paths per pixel")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    depth, normal = aovs(options.size)
    pictures = {f"fan_{s}": fan(s, options.size, options.spp) for s in ("global", "rolling")}
    boxes = {"cornell_render": False, "cornell_denoised": True}
    pictures |= {
        name: box(denoise, options.size, options.spp) for name, denoise in boxes.items()
    }
    pictures["still_life"] = still_life(None, {}, options.size, options.spp)
    pictures["still_life_look_at"] = still_life(
        LOOK_AT, ROUGHER_GOLD, options.size, options.spp
    )
    pictures["color_checker"] = color_checker(options.size, options.spp)
    for name, picture in {
        **pictures,
        "still_life_depth": depth,
        "still_life_normal": normal,
    }.items():
        write_png(options.folder / f"{name}.png", picture)
        print(options.folder / f"{name}.png")


if __name__ == "__main__":
    main()
