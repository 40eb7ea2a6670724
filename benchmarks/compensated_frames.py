"""Measure time and variance of frames with compensated render noise, compared with a low-noise render.

    python benchmarks/compensated_frames.py [--size 32] [--frames 200] [--exposure-s 0.02] [--turns 3]
                                           [--quick] [--json]

The scene is the Cornell box with the camera konnik_table1, about 1000 electrons per pixel, so that shot noise
dominates. First, the time of a frame with its own render is compared with the time of one render with noise ratio 0.01.
The two run alternately; times are wall clock and processor seconds of all threads. The first run of each, which
compiles kernels and finds the size of the passes, is not counted.

Then the electrons of many frames are recorded, each with its own render. For a Poisson distribution the temporal
variance of every pixel is equal to its mean. Pixels within six σ of the full well are excluded, because clipping
changes the variance. The results are the mean of variance/mean over the pixels with its standard error; the same
without the noisiest 1 % of the pixels (by their renders, not by the result); the share of pixels within the χ² limits
(two-sided 5 %); the third central moment over the mean, 1 for a Poisson distribution, weighted by 1/mean; samples per
frame; the share of pixels whose render has more variance than their shot noise; and the correlation of neighbouring
pixels after normalisation of each pixel over frames. ``samples_per_frame`` are those of most pixels; ``noisy_pixels``
says how many have more, and what that makes in all.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats
from timing import lines, ratio

import mitsuba_sensor as ms
from mitsuba_sensor.core.versions import machine
from mitsuba_sensor.render_frames import RenderedFrame

SCENE = Path(__file__).resolve().parent.parent / "scenes" / "cornell_box.xml"
CAMERA = ms.load_camera("konnik_table1")
RATIO = 0.01
CLIP_SIGMAS = 6.0
TRIMMED = 0.01


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--size", type=int, default=32, help="width and height in pixels (default 32)"
    )
    parser.add_argument(
        "--frames", type=int, default=200, help="frames for the statistics (default 200)"
    )
    parser.add_argument(
        "--exposure-s",
        type=float,
        default=0.02,
        help="exposure time (default 0.02: about 1000 e-)",
    )
    parser.add_argument("--turns", type=int, default=3, help="measured turns (default 3)")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a small, dark picture, few frames: a check of the script",
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.quick:
        options.size, options.frames, options.exposure_s, options.turns = 8, 4, 3e-5, 1
    exposure = ms.Exposure(options.exposure_s)
    results: dict[str, Any] = machine()
    if options.turns:
        results["time"] = timed(exposure, options)
    if options.frames > 1:
        results["frames"] = measured(exposure, options)
    print(json.dumps(results) if options.json else "\n".join(lines(results)))


def compensated_frames(
    exposure: ms.Exposure, size: int, frames: int
) -> Iterator[RenderedFrame]:
    """Frames with compensated render noise that keep their electrons."""
    parameters = {"width": size, "height": size}
    return ms.render_frames(
        SCENE, CAMERA, exposure, frames=frames, keep=("electrons",), parameters=parameters
    )


def timed(exposure: ms.Exposure, options: argparse.Namespace) -> dict[str, Any]:
    """Times of a frame and of a render with noise ratio 0.01, after a first run that compiles."""
    frames = compensated_frames(exposure, options.size, options.turns + 1)
    parameters = {"width": options.size, "height": options.size}
    tasks = {
        "frame": lambda seed: next(frames).light,
        "render": lambda seed: ms.render(
            SCENE,
            CAMERA,
            exposure,
            seed=seed,
            noise_ratio=RATIO,
            spectral="channels",
            parameters=parameters,
        ),
    }
    wall: dict[str, list[float]] = {name: [] for name in tasks}
    processor: dict[str, list[float]] = {name: [] for name in tasks}
    samples: dict[str, list[int]] = {name: [] for name in tasks}
    for turn in range(options.turns + 1):
        for name, task in tasks.items():
            start, started = time.perf_counter(), time.process_time()
            light = task(turn)
            if turn:
                wall[name].append(time.perf_counter() - start)
                processor[name].append(time.process_time() - started)
                samples[name].append(light.statistics.samples_per_pixel)
    return {
        **{f"{name}_s": statistics.median(those) for name, those in wall.items()},
        **{f"{name}_spp": statistics.median(those) for name, those in samples.items()},
        "times_faster": ratio(wall["render"], wall["frame"]),
        "times_fewer_processor_s": ratio(processor["render"], processor["frame"]),
    }


def measured(exposure: ms.Exposure, options: argparse.Namespace) -> dict[str, Any]:
    """Statistics of the electrons over frames, compared with the Poisson distribution."""
    electrons, noise, uncompensated, above, samples = [], [], [], [], []
    notes = set[str]()
    for frame in compensated_frames(exposure, options.size, options.frames):
        electrons.append(frame.frames.electrons[0])
        noise.append(frame.photons.variance_e2)
        uncompensated.append(frame.uncompensated)
        above.append(frame.above_shot_noise)
        samples.append(frame.light.statistics.samples_per_pixel)
        notes.update(note for note in frame.light.statistics.notes if "the noisiest" in note)
    counts = np.array(electrons)
    mean, variance = counts.mean(axis=0), counts.var(axis=0, ddof=1)
    free = (mean > 0) & (mean + CLIP_SIGMAS * np.sqrt(mean) < CAMERA.pixel.full_well_e)
    share, render = variance[free] / mean[free], (np.mean(noise, axis=0)[free] / mean[free])
    quiet = render <= np.quantile(render, 1 - TRIMMED)
    degrees = len(counts) - 1
    third = stats.kstat(
        counts[:, free], 3, axis=0
    )  # of a Poisson count its variance is about 6 mean³/frames
    chance = stats.chi2.cdf(share * degrees, degrees)
    normal = np.where(free, (counts - mean) / np.sqrt(np.maximum(variance, 1e-9)), 0.0)
    pairs = (free[:, 1:] & free[:, :-1]).sum() * len(counts)
    return {
        "pixels": int(free.sum()),
        "clipped": int((~free).sum()),
        "frames": len(counts),
        "mean_electrons": float(mean[free].mean()),
        "median_render_variance_over_mean": float(np.median(render)),
        "variance_over_mean": float(share.mean()),
        "standard_error": float(np.sqrt(2 / degrees / share.size)),
        "without_noisiest_1_percent": float(share[quiet].mean()),
        "median_variance_over_mean": float(
            np.median(share) * degrees / stats.chi2.median(degrees)
        ),
        "largest": float(share.max()),
        "third_moment_over_mean": float(
            (third / mean[free] ** 2).sum() / (1 / mean[free]).sum()
        ),
        "third_moment_standard_error": float(np.sqrt(6 / len(counts) / (1 / mean[free]).sum())),
        "third_moment_without_noisiest": float(
            (third / mean[free] ** 2)[quiet].sum() / (1 / mean[free])[quiet].sum()
        ),
        "samples_per_frame": float(np.mean(samples)),
        "noisy_pixels": "; ".join(sorted(notes)),
        "above_shot_noise": float(np.mean(above)),
        "share_within_chance": float(((chance > 0.025) & (chance < 0.975)).mean()),
        "uncompensated": float(np.mean(uncompensated)),
        "neighbour_correlation": float((normal[:, :, 1:] * normal[:, :, :-1]).sum() / pairs),
        "correlation_by_chance": float(pairs**-0.5),
    }


if __name__ == "__main__":
    main()
