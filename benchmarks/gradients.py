"""Measure the time of a frame with gradients, compared with the next frame of an open stream, and their errors.

    python benchmarks/gradients.py [--mpx 1 4] [--electrons 1000] [--turns 9] [--sigma-dn 0.1 1 …] [--json]

plain           a frame of the full chain from the compiled backend, uint16 in NumPy
ten_parameters  a frame, and the gradient of a squared error with respect to ten camera parameters
all_photons     a frame, and the gradient of a squared error with respect to the photons of every pixel
both            all of these together

Times are medians of turns; ``times_plain`` is the median of the ratios to the plain frame of the same turn.

--sigma-dn measures errors instead, at each of these read noises: the mean over --frames Mpx of the derivative
of the code and of (code − mean)², as a ratio to the derivative of the mean and of the variance, which expected_codes.py
enumerates; the first one, by the photons, also as a ratio to differences of frames with equal random bits.

--scene measures a render and its backward pass by prb instead, of --side² pixels and --spp samples, with the
derivatives by an albedo and a lamp: the squared error of Mitsuba's image alone, that of the digital numbers
(ms.digital, expected and sampled), and the likelihood of a raw frame (ms.raw_log_likelihood). ``times_mitsuba`` is the
median of the ratios.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Callable
from typing import Any

import numpy as np
from cases import EXPOSURE, full_chain, photon_map, reference_qe, shape_of
from expected_codes import bare_camera, mean_and_variance, slopes, value_of
from frame_sources import next_frame
from numpy.typing import NDArray
from timing import alternate, ratio

import mitsuba_sensor as ms
from mitsuba_sensor import differentiable
from mitsuba_sensor.core.versions import machine

TEN = (
    "readout.sense_gain_uv_per_e",
    "pixel.prnu",
    "pixel.full_well_e",
    "dark_current.fom_na_per_cm2",
    "dark_current.cv",
    "source_follower.white_nv_per_rthz",
    "source_follower.vv_nonlinearity",
    "readout.dsnu_col",
    "adc.gamma",
    "exposure.temperature_k",
)
TASKS = {"ten_parameters": TEN, "all_photons": ("photons",), "both": ("photons", *TEN)}


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mpx", type=float, nargs="+", default=[1, 4], help="million pixels")
    parser.add_argument("--electrons", type=float, default=1000, help="mean photoelectrons")
    parser.add_argument("--turns", type=int, default=9, help="measured turns (default 9)")
    parser.add_argument(
        "--sigma-dn",
        type=float,
        nargs="+",
        help="read noises [DN] at which errors are measured",
    )
    parser.add_argument(
        "--frames", type=int, default=4, help="frames of a megapixel for the errors (default 4)"
    )
    parser.add_argument(
        "--scene", action="store_true", help="time a render and its backward pass"
    )
    parser.add_argument("--side", type=int, default=256, help="of its image in pixels")
    parser.add_argument("--spp", type=int, default=64, help="its samples per pixel")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.sigma_dn:
        show_errors(
            [found for sigma in options.sigma_dn for found in errors(sigma, options.frames)],
            options.json,
        )
        return
    if options.scene:
        show_scene(scene_times(options.side, options.spp, options.turns), options.json)
        return
    rows = [row(mpx, options.electrons, options.turns) for mpx in options.mpx]
    if options.json:
        print(json.dumps({**machine(), "turns": options.turns, "rows": rows}))
        return
    for found in rows:
        print(f"{found['mpx']:g} Mpx, {found['electrons']:g} e-, {options.turns} turns")
        for name, task in found["tasks"].items():
            print(
                f"  {name:15} {task['seconds'] * 1e3:8.1f} ms   {task['times_plain']:5.2f} × plain"
            )


CASES: dict[str, tuple[float, dict[str, float]]] = {
    "few electrons, code centre": (3.0, {"adc__black_level_dn": 64.0}),
    "code edge": (40.0, {"adc__black_level_dn": 16.5}),
    "lower clip": (4.0, {"adc__black_level_dn": 0.3}),
    "upper clip, 8 bit": (1940.0, {"adc__black_level_dn": 16.0, "adc__bits": 8}),
    "full well, 1000 e-": (1020.0, {"adc__black_level_dn": 16.0, "pixel__full_well_e": 1000.0}),
    "3 DN/e-": (5.0, {"adc__black_level_dn": 9.3, "dn_per_e": 3.0}),
}
"""Mean photoelectrons, and what else the camera has."""

NAMES = (
    "photons",
    "readout.sense_gain_uv_per_e",
    "source_follower.read_noise_e",
    "adc.black_level_dn",
    "pixel.full_well_e",
)
SIDE = 1024
DIFFERENCE = 0.1
"""Half the difference of two levels of light, in σ of the shot noise."""

SMALL = 0.02
"""Derivatives by ln(parameter) below so many DN or DN² are not compared: they are 0 but for the tails of the noise."""


def errors(sigma_dn: float, frames: int) -> list[dict[str, Any]]:
    """Ratios of every case and parameter, with their standard errors."""
    rows = []
    for case, (electrons, fields) in CASES.items():
        camera = bare_camera(sigma_dn, **fields)
        mean = mean_and_variance(camera, electrons)[0]
        found = sampled(camera, electrons, mean, frames)
        for name in NAMES:
            ratios: dict[str, Any] = {"sigma_dn": sigma_dn, "case": case, "parameter": name}
            for what, exact, samples in zip(
                ("mean", "variance"), slopes(camera, electrons, name), found[name], strict=True
            ):
                if abs(exact) > SMALL:
                    ratios[what] = [samples[0] / exact, abs(samples[1] / exact)]
            if name == "photons":
                moved, error = differences(camera, electrons, frames)
                ratios["frames"] = [found[name][0][0] / moved, abs(error / moved)]
            rows.append(ratios)
    return rows


def sampled(
    camera: ms.Camera, electrons: float, mean: float, frames: int
) -> dict[str, list[tuple[float, float]]]:
    """Name → mean over the pixels, and its standard error, of dcode and of 2·(code − mean)·dcode, by ln(parameter)."""
    photons = np.full((SIDE, SIDE), electrons / reference_qe(camera))
    stream = differentiable(photons, camera, EXPOSURE, NAMES)
    moved: dict[str, list[list[NDArray[Any]]]] = {name: [[], []] for name in NAMES}
    for index in range(frames):
        frame = stream.frame(index)
        frame.store()
        for name in NAMES:
            scale = photons[0, 0] if name == "photons" else value_of(name, camera)
            slope = frame.forward(name).astype(float) * scale
            for kept, values in zip(
                moved[name], (slope, 2 * (frame.codes - mean) * slope), strict=True
            ):
                kept.append(np.array([values.mean(), values.var() / values.size]))
    averages = {name: [np.mean(kept, axis=0) for kept in both] for name, both in moved.items()}
    return {
        name: [(float(a), float(np.sqrt(v / frames))) for a, v in both]
        for name, both in averages.items()
    }


def differences(camera: ms.Camera, electrons: float, frames: int) -> tuple[float, float]:
    """d mean/d ln(photons) and its standard error, from pairs of frames with equal random bits."""
    step, ends = DIFFERENCE / np.sqrt(electrons), []
    for factor in (1 + step, 1 - step):
        photons = np.full((SIDE, SIDE), electrons / reference_qe(camera) * factor)
        ends.append(
            ms.expose(photons, camera, EXPOSURE, frames=frames, engine="drjit").digital.astype(
                float
            )
        )
    moved = (ends[0] - ends[1]) / (2 * step)
    return float(moved.mean()), float(moved.std() / np.sqrt(moved.size))


def show_errors(rows: list[dict[str, Any]], as_json: bool) -> None:
    """Print the ratios."""
    if as_json:
        print(json.dumps({**machine(), "rows": rows}))
        return
    for found in rows:
        shown = [
            f"{what} {x[0]:.4f} ± {x[1]:.4f}"
            for what, x in found.items()
            if isinstance(x, list)
        ]
        label = f"{found['sigma_dn']:5g} DN  {found['case']:27} {found['parameter']:29}"
        print(label, "   ".join(shown) or "(no derivative)")


SCENE = """<scene version="3.0.0"><integrator type="prb"><integer name="max_depth" value="4"/></integrator>
<sensor type="camera"><float name="focal_length_mm" value="1"/><film type="photosensor">
<string name="camera" value="bayer_2mp"/><string name="spectral" value="{spectral}"/>
<float name="exposure_s" value="0.005"/><integer name="width" value="{side}"/><integer name="height" value="{side}"/>
</film></sensor>
<shape type="sphere" id="ball"><point name="center" value="0, 0, 4"/><bsdf type="diffuse">
<spectrum name="reflectance" value="0.5"/></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><scale value="5"/><rotate y="1" angle="180"/><translate z="6"/>
</transform><bsdf type="diffuse"><spectrum name="reflectance" value="0.4"/></bsdf></shape>
<emitter type="constant" id="sky"><spectrum name="radiance" value="2e-4"/></emitter></scene>"""
LEAVES = "ball.bsdf.reflectance.value", "sky.radiance.value"


def scene_times(side: int, spp: int, turns: int) -> dict[str, Any]:
    """Seconds of every task, and their ratio to plain Mitsuba's."""
    found = {}
    for spectral in ("channels", "auto"):
        seconds = alternate(scene_tasks(side, spp, spectral), turns)
        found[spectral] = {
            name: {
                "seconds": statistics.median(those),
                "times_mitsuba": ratio(those, seconds["mitsuba"]),
            }
            for name, those in seconds.items()
        }
    return {"side": side, "spp": spp, "films": found}


def scene_tasks(side: int, spp: int, spectral: str) -> dict[str, Callable[[], object]]:
    """A render and the gradient of a loss of its image, or of what the camera makes of it."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_spectral")
    scene = mi.load_string(SCENE.format(side=side, spectral=spectral))
    parameters, seeds = mi.traverse(scene), iter(range(2**31))
    sensor = scene.sensors()[0]
    first = mi.TensorXf(mi.render(scene, spp=spp))
    raw = np.array(ms.digital(first, sensor=sensor, expected=False))
    target = mi.TensorXf(raw.astype(np.float32))

    def task_of(loss: Callable[[Any], Any]) -> Callable[[], object]:
        def task() -> object:
            for name in LEAVES:
                parameters[name] = mi.Float(dr.detach(parameters[name]))
                dr.enable_grad(parameters[name])
            parameters.update()
            image = mi.render(scene, parameters, spp=spp, seed=next(seeds))
            dr.backward(dr.mean(loss(image), axis=None))
            return [dr.grad(parameters[name]).numpy() for name in LEAVES]

        return task

    return {
        "mitsuba": task_of(lambda image: (image - first) ** 2),
        "expected": task_of(lambda image: (ms.digital(image, sensor=sensor) - target) ** 2),
        "sampled": task_of(
            lambda image: (ms.digital(image, sensor=sensor, expected=False) - target) ** 2
        ),
        "likelihood": task_of(lambda image: -ms.raw_log_likelihood(raw, image, sensor=sensor)),
    }


def show_scene(found: dict[str, Any], as_json: bool) -> None:
    """Print the times."""
    if as_json:
        print(json.dumps({**machine(), **found}))
        return
    for spectral, tasks in found["films"].items():
        print(f"{found['side']}² pixels, {found['spp']} samples, spectral {spectral}")
        for name, task in tasks.items():
            ms_each, times = task["seconds"] * 1e3, task["times_mitsuba"]
            print(f"  {name:12} {ms_each:8.1f} ms   {times:5.2f} × Mitsuba alone")


def row(mpx: float, electrons: float, turns: int) -> dict[str, Any]:
    """Times of all tasks for one size."""
    camera = full_chain()
    photons = photon_map(camera, electrons, "ramp", shape_of(mpx))
    tasks: dict[str, Callable[[], object]] = {"plain": next_frame("drjit", photons, camera)}
    tasks |= {name: gradient(photons, parameters) for name, parameters in TASKS.items()}
    seconds = alternate(tasks, turns)
    found = {
        name: {
            "seconds": statistics.median(those),
            "times_plain": ratio(those, seconds["plain"]),
        }
        for name, those in seconds.items()
    }
    return {"mpx": mpx, "electrons": electrons, "tasks": found}


def gradient(photons: NDArray[Any], parameters: tuple[str, ...]) -> Callable[[], object]:
    """A task: the next frame, and the gradient of its squared distance from 100 DN."""
    frames = differentiable(photons, full_chain(), EXPOSURE, parameters)
    numbers = iter(range(2**31))

    def task() -> object:
        frame = frames.frame(next(numbers))
        error = frame.digital - 100.0
        return frame.backward(error * error)

    return task


if __name__ == "__main__":
    main()
