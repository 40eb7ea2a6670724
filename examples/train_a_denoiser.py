"""Train a small network to denoise raw frames, and test it on scenes and sensor units that it has not seen.

    pip install '.[training]'
    python examples/train_a_denoiser.py

This makes the dataset of examples/denoiser_pairs.toml in denoiser_pairs/dataset/, trains on its split "train", and
prints the PSNR of its split "test" for the noisy frames, a Gaussian filter, total variation, BM3D and the network.
denoised.png shows the results. Total variation needs scikit-image and BM3D needs bm3d; without these packages the
filters are omitted.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from scipy.ndimage import gaussian_filter

import mitsuba_sensor as ms
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.read import Sample
from mitsuba_sensor.files.png import png, write_png
from mitsuba_sensor.output.contact_sheet import Captioned, SheetRow, contact_sheet
from mitsuba_sensor.output.preview import preview

PAIRS = Path(__file__).with_name("denoiser_pairs.toml")
CHANNELS = 4
"""Pixels of a tile of the colour mosaic, each an image of half the size."""
WIDTHS = 24, 32, 48
"""Channels of the network at full, half and quarter size."""
SIDE, BATCH = 32, 16
"""Side of a training patch [pixels of a channel], and patches of a step."""
HIGHEST_RATE = 2e-3
GAUSSIAN_PX = 0.5, 0.7, 1.0, 1.4, 2.0
VARIATION_WEIGHTS = 0.3, 0.5, 0.8, 1.2, 1.8
"""Strengths of the filters; the best strength on the training pairs is used."""
Filter = Callable[[np.ndarray], np.ndarray]
Parameters = dict[str, Any]


@dataclass(frozen=True)
class Pair:
    """Two frames in photoelectrons, shape (H, W, 4).

    read_noise_e : of the camera.  peak_e : photoelectrons of white with the exposure compensation.
    """

    sample: Sample
    noisy_e: np.ndarray
    clean_e: np.ndarray
    read_noise_e: float
    peak_e: float

    def stabilized(self, electrons: np.ndarray) -> np.ndarray:
        """Return Anscombe's transform for shot and read noise, after which the noise has a variance of about 1."""
        return 2 * np.sqrt(np.maximum(electrons + 3 / 8 + self.read_noise_e**2, 0))

    def electrons(self, stabilized: np.ndarray, offset: float = 3 / 8) -> np.ndarray:
        """Return the inverse.  offset : 1/8 for a mean of noisy values, whose square is larger by their variance."""
        return (stabilized / 2) ** 2 - offset - self.read_noise_e**2

    @property
    def peak(self) -> float:
        """White after the transform."""
        return float(self.stabilized(np.array(self.peak_e)))

    def psnr_db(self, electrons: np.ndarray) -> float:
        """Return the peak signal-to-noise ratio relative to the clean frame; the peak is white."""
        difference = np.clip(electrons / self.peak_e, 0, 1) - np.clip(
            self.clean_e / self.peak_e, 0, 1
        )
        return float(-10 * np.log10(np.mean(difference**2)))


def pairs_of(samples: ms.Dataset) -> list[Pair]:
    """Return the pairs of a dataset."""
    pairs = []
    for sample in samples:
        facts = sample.facts
        image, gain_dn_per_e = facts["image"], facts["system_gain_dn_per_e"]
        black_dn, stops = image["black_level_dn"], sample.values["exposure_ev"]
        noise_e = ms.load_camera(facts["config"]["camera"]).emva1288().temporal_dark_noise_e
        noisy_e = (sample.read("raw")[0] - black_dn) / gain_dn_per_e
        clean_e = (sample.read("clean") - black_dn) / gain_dn_per_e
        white_e = (image["white_level_dn"] - black_dn) / gain_dn_per_e
        pairs.append(
            Pair(sample, tiles_of(noisy_e), tiles_of(clean_e), noise_e, white_e * 2.0**stops)
        )
    return pairs


def tiles_of(mosaic: np.ndarray) -> np.ndarray:
    """Return the channels of a mosaic: shape (H, W) → (H / 2, W / 2, 4)."""
    rows, columns = (length // 2 * 2 for length in mosaic.shape)
    even = mosaic[:rows, :columns]
    parts = [even[row::2, column::2] for row in (0, 1) for column in (0, 1)]
    return np.stack(parts, axis=-1).astype(np.float32)


def mosaic_of(tiles: np.ndarray) -> np.ndarray:
    """Return the mosaic of channels."""
    rows, columns, _ = tiles.shape
    mosaic = np.empty((2 * rows, 2 * columns), tiles.dtype)
    for channel in range(CHANNELS):
        mosaic[channel // 2 :: 2, channel % 2 :: 2] = tiles[..., channel]
    return mosaic


def input_of(pair: Pair) -> np.ndarray:
    """Return the input of the network: the transformed noisy frame and the noise, both relative to white."""
    noise = np.full((*pair.noisy_e.shape[:2], 1), 1 / pair.peak)
    return np.concatenate([pair.stabilized(pair.noisy_e) / pair.peak, noise], -1).astype(
        np.float32
    )


def new_parameters(seed: int) -> Parameters:
    """Return He's initial weights, and biases, of all layers."""
    full, half, quarter = WIDTHS
    layers = {
        "first": (CHANNELS + 1, full),
        "second": (full, full),
        "to_half": (full, half),
        "half": (half, half),
        "to_quarter": (half, quarter),
        "quarter": (quarter, quarter),
        "from_quarter": (quarter + half, half),
        "from_half": (half + full, full),
        "last": (full, CHANNELS),
    }
    parameters: Parameters = {}
    for key, (name, (inputs, outputs)) in zip(
        jax.random.split(jax.random.key(seed), len(layers)), layers.items(), strict=True
    ):
        scale = np.sqrt(2 / (9 * inputs))
        if name == "last":
            scale = 0.0  # the network begins with the noisy frame
        weights = scale * jax.random.normal(key, (3, 3, inputs, outputs))
        parameters[name] = weights, jnp.zeros(outputs)
    return parameters


def convolved(
    parameters: Parameters, name: str, image: jax.Array, stride: int = 1
) -> jax.Array:
    """Return a 3 × 3 convolution."""
    weights, bias = parameters[name]
    strides, kinds = (stride, stride), ("NHWC", "HWIO", "NHWC")
    padding = ((1, 1), (1, 1))
    return bias + jax.lax.conv_general_dilated(
        image, weights, strides, padding, dimension_numbers=kinds
    )


def network(parameters: Parameters, image: jax.Array) -> jax.Array:
    """Return the noise in frames, shape (N, H, W, 5), in standard deviations: a small U-net."""

    def layer(name: str, inputs: jax.Array, stride: int = 1) -> jax.Array:
        return jax.nn.relu(convolved(parameters, name, inputs, stride))

    full = layer("second", layer("first", image))
    half = layer("half", layer("to_half", full, 2))
    quarter = layer("quarter", layer("to_quarter", half, 2))
    half = layer("from_quarter", jnp.concatenate([enlarged(quarter), half], -1))
    full = layer("from_half", jnp.concatenate([enlarged(half), full], -1))
    return convolved(parameters, "last", full)


def enlarged(image: jax.Array) -> jax.Array:
    """Return an image with twice as many rows and columns."""
    return image.repeat(2, axis=1).repeat(2, axis=2)


def loss(parameters: Parameters, image: jax.Array, noise: jax.Array) -> jax.Array:
    """Return the mean square of the remaining noise, in standard deviations."""
    return jnp.mean((network(parameters, image) - noise) ** 2)


def patches(pairs: Sequence[Pair], seed: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield endless batches of inputs and their noise, randomly mirrored and transposed."""
    rng = np.random.default_rng(seed)
    inputs = [input_of(pair) for pair in pairs]
    noises = [pair.stabilized(pair.noisy_e) - pair.stabilized(pair.clean_e) for pair in pairs]
    smallest = min(min(image.shape[:2]) for image in inputs)
    side = min(SIDE, smallest // 4 * 4)
    while True:
        batch = []
        for number in rng.integers(len(pairs), size=BATCH):
            image = np.concatenate([inputs[number], noises[number]], -1)
            top, left = (int(rng.integers(length - side + 1)) for length in image.shape[:2])
            patch = image[top : top + side, left : left + side]
            batch.append(mirrored(patch, int(rng.integers(8))))
        stack = np.stack(batch)
        yield stack[..., : CHANNELS + 1], stack[..., CHANNELS + 1 :]


def mirrored(patch: np.ndarray, way: int) -> np.ndarray:
    """Return a square in one of its eight orientations."""
    if way & 1:
        patch = patch[::-1]
    if way & 2:
        patch = patch[:, ::-1]
    if way & 4:
        patch = patch.transpose(1, 0, 2)
    return patch


def train(pairs: Sequence[Pair], steps: int, seed: int) -> Parameters:
    """Train a network with Adam, whose rate falls to zero."""
    optimizer = optax.adam(optax.cosine_decay_schedule(HIGHEST_RATE, steps))
    parameters = new_parameters(seed)
    state = optimizer.init(parameters)

    @jax.jit
    def step(parameters: Parameters, state: Any, image: Any, noise: Any) -> Any:
        value, gradient = jax.value_and_grad(loss)(parameters, image, noise)
        change, state = optimizer.update(gradient, state)
        return optax.apply_updates(parameters, change), state, value

    began, losses = time.monotonic(), list[float]()
    for number, (image, noise) in zip(range(1, steps + 1), patches(pairs, seed), strict=False):
        parameters, state, value = step(parameters, state, image, noise)
        losses.append(value)
        if number % max(steps // 8, 1) == 0:
            mean = float(np.mean(losses))
            took_s = time.monotonic() - began
            print(
                f"step {number} of {steps}: {mean:.3f} of the noise variance remains, {took_s:.0f} s"
            )
            losses.clear()
    return parameters


def denoised_by_network(parameters: Parameters, pair: Pair) -> np.ndarray:
    """Return the photoelectrons that the network leaves."""
    image = input_of(pair)
    rows, columns = image.shape[:2]
    padded = np.pad(image, ((0, -rows % 4), (0, -columns % 4), (0, 0)), mode="reflect")
    noise = np.asarray(jax.jit(network)(parameters, padded[None]))[0, :rows, :columns]
    return pair.electrons(pair.stabilized(pair.noisy_e) - noise)


def denoised_by_filter(smooth: Filter, pair: Pair) -> np.ndarray:
    """Return the photoelectrons after filtering each transformed channel, whose noise is the same everywhere."""
    channels = np.moveaxis(pair.stabilized(pair.noisy_e), -1, 0)
    filtered = np.stack([smooth(channel) for channel in channels], axis=-1)
    return pair.electrons(filtered, offset=1 / 8)


def filters(pairs: Sequence[Pair]) -> dict[str, Filter]:
    """Return name → installed filter, with the best strength for these pairs."""
    installed = {
        "Gaussian": best([partial(gaussian_filter, sigma=x) for x in GAUSSIAN_PX], pairs)
    }
    try:
        from skimage.restoration import denoise_tv_chambolle
    except ImportError:
        print("no total variation: scikit-image is not installed")
    else:
        tries = [partial(denoise_tv_chambolle, weight=x) for x in VARIATION_WEIGHTS]
        installed["total variation"] = best(tries, pairs)
    try:
        from bm3d import bm3d
    except ImportError:
        print("no BM3D: the package bm3d is not installed")
    else:
        installed["BM3D"] = partial(bm3d, sigma_psd=1.0)
    return installed


def best(tries: Sequence[Filter], pairs: Sequence[Pair]) -> Filter:
    """Return the filter with the highest mean PSNR."""

    def mean_db(smooth: Filter) -> float:
        return float(
            np.mean([pair.psnr_db(denoised_by_filter(smooth, pair)) for pair in pairs])
        )

    return max(tries, key=mean_db)


@dataclass(frozen=True)
class Denoised:
    """Results for a pair.  electrons : name of the method → photoelectrons, shape (H, W, 4)."""

    pair: Pair
    electrons: dict[str, np.ndarray]

    @property
    def title(self) -> list[str]:
        """Scene, camera and exposure compensation."""
        values = self.pair.sample.values
        return [values["scene"], values["camera"], f"{values['exposure_ev']} EV"]

    @property
    def psnr_db(self) -> dict[str, float]:
        """PSNR of each method [dB]."""
        return {name: self.pair.psnr_db(x) for name, x in self.electrons.items()}


def table_of(results: Sequence[Denoised]) -> str:
    """Return a line for each pair, and the means."""
    names = [*results[0].electrons]
    lines = ["".join(f"{name:>17}" for name in ("", *names))]
    lines[0] = f"{'scene, camera, stops':42}" + lines[0][17:]
    for result in results:
        numbers = "".join(f"{x:17.1f}" for x in result.psnr_db.values())
        lines.append(f"{', '.join(result.title):42}{numbers}")
    means = [np.mean([result.psnr_db[name] for result in results]) for name in names]
    return "\n".join([*lines, f"{'mean':42}" + "".join(f"{x:17.1f}" for x in means)])


def picture(results: Sequence[Denoised]) -> np.ndarray:
    """Return a row for each pair: noisy, denoised by each method, and clean."""
    rows = []
    for result in results:
        pair, cells = result.pair, list[Captioned]()
        for name, electrons in result.electrons.items():
            caption = f"{name}, {pair.psnr_db(electrons):.1f} dB"
            cells.append(Captioned(png(developed(pair, electrons)), [caption]))
        cells.append(Captioned(png(developed(pair, pair.clean_e)), ["clean"]))
        rows.append(SheetRow(result.title, cells))
    return contact_sheet(rows)


def developed(pair: Pair, electrons: np.ndarray) -> np.ndarray:
    """Return the colours of a frame, as bright as without exposure compensation."""
    facts = pair.sample.facts
    digital = facts["image"]["black_level_dn"] + facts["system_gain_dn_per_e"] * electrons
    camera = ms.load_camera(facts["config"]["camera"])
    return preview(mosaic_of(digital), camera, gain=2.0 ** -pair.sample.values["exposure_ev"])


def main() -> None:
    """Parse the options, make the dataset, train, compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--out", type=Path, default=Path("denoiser_pairs"))
    parser.add_argument("--dataset", type=Path, default=PAIRS, help="dataset file (.toml)")
    parser.add_argument("--steps", type=int, default=1500, help="training steps (default 1500)")
    parser.add_argument(
        "--seed", type=int, default=1, help="seed of everything random (default 1)"
    )
    parser.add_argument("--json", action="store_true", help="also print the table as JSON")
    options = parser.parse_args()

    folder = options.out / "dataset"
    make_dataset(options.dataset, folder)
    training = pairs_of(ms.Dataset(folder, split="train"))
    held_out = pairs_of(ms.Dataset(folder, split="test"))
    parameters = train(training, options.steps, options.seed)
    methods: dict[str, Filter] = {"noisy": lambda pair: pair.noisy_e}
    for name, smooth in filters(training).items():
        methods[name] = partial(denoised_by_filter, smooth)
    methods["network"] = partial(denoised_by_network, parameters)
    results = []
    for pair in held_out:
        results.append(Denoised(pair, {name: method(pair) for name, method in methods.items()}))
    print("\nPSNR [dB] for scenes and sensor units that training has not seen")
    print(table_of(results))
    if options.json:
        rows = [{"pair": result.title, "psnr_db": result.psnr_db} for result in results]
        print(json.dumps(rows))
    shown = [result for result in results if result.pair.sample.values["exposure_ev"] == -5]
    write_png(options.out / "denoised.png", picture(shown))


if __name__ == "__main__":
    main()
