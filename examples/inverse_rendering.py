"""Recover the power of a lamp, an albedo and the focus of the lens from one noisy raw frame.

    python examples/inverse_rendering.py [-o PICTURE]

Fisher scoring finds the most likely values: ms.raw_log_likelihood returns the likelihood of the raw frame, and
dr.backward its derivatives with respect to lamp and albedo, through the sensor, the image and prb. For the focus, prb
has no derivative, and no integrator of Mitsuba has one at the edges of a blurred image; so the focus uses the
difference of two renders with equal random numbers.
Prints the values with 95 % intervals and the Cramér–Rao bound, and draws PICTURE.
"""

from __future__ import annotations

import argparse

import drjit as dr
import mitsuba as mi
import numpy as np

import mitsuba_sensor as ms

SCENE = """<scene version="3.0.0"><integrator type="prb"><integer name="max_depth" value="2"/></integrator>
<sensor type="camera"><float name="focal_length_mm" value="5"/><float name="f_number" value="1.4"/>
<float name="focus_distance_m" value="0.3"/><sampler type="multijitter"/>
<film type="photosensor"><string name="camera" value="konnik_table1"/><float name="wavelength_nm" value="550"/>
<float name="exposure_s" value="0.06"/><integer name="width" value="72"/><integer name="height" value="54"/></film>
</sensor>
<shape type="rectangle"><transform name="to_world"><scale value="0.03"/><rotate y="1" angle="180"/>
<translate z="0.4"/></transform><bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
<spectrum name="color0" value="0.05"/><spectrum name="color1" value="0.8"/>
<transform name="to_uv"><scale value="5"/></transform></texture></bsdf></shape>
<shape type="disk" id="disk"><transform name="to_world"><scale value="0.007"/><rotate y="1" angle="180"/>
<translate z="0.399"/></transform><bsdf type="diffuse">
<spectrum name="reflectance" value="0.5"/></bsdf>
</shape>
<emitter type="point" id="lamp"><point name="position" value="0.1, 0.1, 0"/>
<spectrum name="intensity" value="1e-5"/></emitter></scene>"""
LAMP, ALBEDO, FOCUS = (
    "lamp.intensity.value",
    "disk.bsdf.reflectance.value",
    "sensor focus_distance",
)
TRUE = {LAMP: 1e-5, ALBEDO: 0.3, FOCUS: 0.27}
START = {LAMP: 2e-5, ALBEDO: 0.6, FOCUS: 0.31}
NAMES = {LAMP: "lamp", ALBEDO: "albedo", FOCUS: "focus"}
UNITS = {LAMP: "W/sr/nm", ALBEDO: "", FOCUS: "m"}
SAMPLES, STEPS, SIMULATED = 256, 6, 8
STEP = 0.02  # relative step of a difference
LARGEST = 0.3  # largest relative change of a value in one step

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("-o", "--out", metavar="PICTURE", help="PNG file of the picture")
picture = parser.parse_args().out

mi.set_variant("llvm_ad_spectral")
scene = mi.load_string(SCENE)
sensor = scene.sensors()[0]
parameters = mi.traverse(scene)
KEYS = {name: name for name in (LAMP, ALBEDO)}
KEYS[FOCUS] = next(key for key, _ in parameters if key.endswith("focus_distance"))


def render(values: dict[str, float], seed: int, samples: int = SAMPLES) -> mi.TensorXf:
    """Return the image of the photosensor."""
    for name, value in values.items():
        parameters[KEYS[name]] = mi.Float(value)
    parameters.update()
    return mi.TensorXf(mi.render(scene, spp=samples, seed=seed))


def derivatives(values: dict[str, float], seed: int) -> np.ndarray:
    """Return the derivatives of every pixel: differences of renders with equal random numbers."""
    rows = []
    for name, value in values.items():
        step = STEP * value
        high, low = (
            np.array(render({**values, name: value + sign * step}, seed)) for sign in (1, -1)
        )
        rows.append((high - low).ravel() / (2 * step))
    return np.stack(rows)


def slopes_of_likelihood(
    raw: np.ndarray, values: dict[str, float], by_focus: np.ndarray, seed: int
) -> np.ndarray:
    """Return the derivatives of the log-likelihood of a raw frame: through prb, and for the focus through the given
    derivative of the image."""
    variables = {name: mi.Float(value) for name, value in values.items()}
    dr.enable_grad(*variables.values())
    for name, variable in variables.items():
        parameters[KEYS[name]] = dr.detach(variable) if name == FOCUS else variable
    parameters.update()
    image = mi.render(scene, parameters, spp=SAMPLES, seed=seed)
    moved = variables[FOCUS] - dr.detach(variables[FOCUS])
    image = image + mi.TensorXf(mi.Float(by_focus) * moved, image.shape)
    dr.backward(dr.sum(ms.raw_log_likelihood(raw, image, sensor=sensor), axis=None))
    return np.array([dr.grad(variable).numpy()[0] for variable in variables.values()])


def score(raw: np.ndarray, image: mi.TensorXf) -> np.ndarray:
    """Return the derivative of the log-likelihood with respect to every pixel of the image."""
    variable = mi.TensorXf(image)
    dr.enable_grad(variable)
    dr.backward(dr.sum(ms.raw_log_likelihood(raw, variable, sensor=sensor), axis=None))
    return np.array(dr.grad(variable)).ravel()


def information(image: mi.TensorXf, slopes: np.ndarray) -> np.ndarray:
    """Return the Fisher information of one frame on the three values: the mean square of simulated scores."""
    square = np.zeros(slopes.shape[1])
    for number in range(SIMULATED):
        codes = np.array(ms.digital(image, sensor=sensor, expected=False, seed=100 + number))
        square += score(codes, image) ** 2 / SIMULATED
    return (slopes * square) @ slopes.T


raw = np.array(ms.digital(render(TRUE, 7, 2048), sensor=sensor, expected=False, seed=1))
values = dict(START)
for number in range(STEPS):
    slopes = derivatives(values, number)
    fisher = information(render(values, number), slopes)
    gradient = slopes_of_likelihood(raw, values, slopes[2], number)
    step = np.linalg.solve(fisher, gradient)
    share = min(1.0, *(LARGEST * np.array(list(values.values())) / np.abs(step)))
    values = dict(zip(values, np.array(list(values.values())) + share * step, strict=True))
    print(
        f"step {number + 1}: "
        + ", ".join(f"{NAMES[name]} {x:.4g}" for name, x in values.items())
    )

image, slopes = render(values, STEPS), derivatives(values, STEPS)
own = slopes * score(raw, image)  # the information in this frame
half = 1.96 * np.sqrt(np.diag(np.linalg.inv(own @ own.T)))
fisher = information(render(TRUE, STEPS + 1), derivatives(TRUE, STEPS + 1))
bound = np.sqrt(np.diag(np.linalg.inv(fisher)))

print("\n           true      found      95 % interval             Cramér–Rao σ, 1.96 σ")
lines = []
for name, found, reach, sigma in zip(values, values.values(), half, bound, strict=True):
    interval = f"{found - reach:.4g} to {found + reach:.4g}"
    row = f"{NAMES[name]:10} {TRUE[name]:<9.4g} {found:<10.4g} {interval:25}"
    print(f"{row} {sigma:.3g}, {1.96 * sigma:.3g}")
    lines.append(
        f"{NAMES[name]} {found:.4g} ± {reach:.2g} {UNITS[name]} (true: {TRUE[name]:.4g})"
    )

if picture:
    from matplotlib.figure import Figure

    expected = np.array(ms.digital(image, sensor=sensor))
    first = np.array(ms.digital(render(START, 0), sensor=sensor))
    panels = {
        "one raw frame": raw,
        "expected, where the fit began": first,
        "expected, with what was found": expected,
    }
    low, high = np.quantile(raw, (0.005, 0.995))
    figure = Figure(figsize=(10, 3.1), layout="constrained")
    for axes, (title, frame) in zip(figure.subplots(1, 3), panels.items(), strict=True):
        shown = axes.imshow(frame, cmap="gray", vmin=low, vmax=high)
        axes.set(title=title, xticks=[], yticks=[])
    figure.colorbar(shown, ax=figure.axes, label="digital number [DN]", shrink=0.8)
    figure.suptitle("95 % intervals: " + ", ".join(lines), fontsize=9)
    figure.savefig(picture, dpi=100)
