"""What every chart has: its scene, its frames, its instrument; and what instruments begin with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Exposure, InputError, Photons
from ...core.types import Float64Array
from ...expose import expose
from ...files.texts import Facts
from ...lab.frames.bench import Bench
from ...lab.frames.stack import Stack
from ...lab.quantity import Quantity
from ..virtual_bench import FLAT_S, middle_of_sensor, mosaic
from .light import Bands, ChartLight, ChartScene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Lights = Sequence[ChartLight]
Draw = Callable[["Axes"], object]


class Setting(NamedTuple):
    """One column of the sheet.

    camera : at its gain setting.  gain : its name, empty if the camera has one only.
    temperature_k : of the sensor [K].  serial, seed : of the chip and of all temporal noise.
    """

    camera: Camera
    gain: str
    temperature_k: float
    serial: int
    seed: int

    @property
    def exposure(self) -> Exposure:
        """Exposure of the pictures of charts; the light varies."""
        return Exposure(FLAT_S, self.temperature_k)


@dataclass(frozen=True, eq=False)
class Taken:
    """Frames of a chart.

    bench : scenes are pictures of the chart, darks and flats are as the instrument asks.
    facts : about the chart, as in ``chart.toml`` beside the frames of a real camera.
    ideal : the pictures of the scene without noise, (N, H, W), in DN or in proportion; None without a closed form.
    chips : the same of single chips, which differ from the camera's file.
    """

    bench: Bench
    facts: Facts = field(default_factory=dict)
    ideal: Float64Array | None = None
    chips: Sequence[Float64Array] = ()


@dataclass(frozen=True, eq=False)
class Measured:
    """What an instrument found behind one colour filter: figures, drawings by title, sentences of what it refused."""

    filter_name: str
    figures: Sequence[Quantity]
    drawings: Mapping[str, Draw] = field(default_factory=dict)
    refused: Sequence[str] = ()


class Chart(NamedTuple):
    """A chart of the sheet.

    name : of the folder of its frames; those of a real camera are in folders whose names begin with ``kind``.
    scenes : what is rendered.  frames : of a setting in the light of these scenes.  instrument : what it finds.
    closed_form : whether its theory is in closed_forms.py.  filters : that a camera must have.
    drawn : whether theory is drawn as what the instrument finds in the picture without noise.
    """

    name: str
    kind: str
    title: str
    scenes: Callable[[Camera], list[ChartScene]]
    frames: Callable[[Setting, Lights], Taken]
    instrument: Callable[[Taken], list[Measured]]
    closed_form: bool = False
    filters: int = 1
    drawn: bool = True


def take(setting: Setting, light: Float64Array, bands: Bands, frames: int, kind: str) -> Stack:
    """Frames of mean photons per pixel (H, W, B) in the middle of the sensor, as a stack.

    kind : stacks of different kinds have different temporal noise.
    """
    camera, shape = setting.camera, light.shape[:2]
    origin = middle_of_sensor(camera, shape)
    photons = Photons(
        light, bands.wavelengths_nm, bandwidths_nm=bands.bandwidths_nm, origin=origin
    )
    seed = int(np.random.SeedSequence([setting.seed, *kind.encode()]).generate_state(1)[0])
    taken = expose(
        photons, camera, setting.exposure, frames=frames, serial=setting.serial, seed=seed
    )
    return Stack(
        taken.digital,
        setting.exposure.time_s,
        None if light.any() else 0.0,
        setting.temperature_k,
        setting.gain,
        bits=camera.adc.bits,
        tile=mosaic(camera),
        source=kind,
    )


def bench_of(
    setting: Setting,
    photons: Float64Array,
    bands: Bands,
    name: str,
    counts: tuple[int, int],
    flat: tuple[Float64Array, int] | None = None,
) -> Bench:
    """Pictures of a chart, dark frames, and flat fields.  counts : of pictures and of dark frames."""
    scene = take(setting, photons, bands, counts[0], name)
    dark = take(setting, 0 * photons, bands, counts[1], f"{name} dark")
    flats: tuple[Stack, ...] = ()
    if flat is not None:
        even = np.broadcast_to(flat[0], photons.shape)
        flats = (take(setting, even, bands, flat[1], f"{name} flat"),)
    return Bench((), (dark,), flats, (scene,))


def chart_shape(camera: Camera, rows: int, columns: int) -> tuple[int, int]:
    """Pixels of a chart with so many rows and columns behind each place of the mosaic, at most those of the sensor."""
    tile = len(camera.tile), len(camera.tile[0])
    return (
        min(rows, camera.sensor.rows // tile[0]) * tile[0],
        min(columns, camera.sensor.columns // tile[1]) * tile[1],
    )


def one_ideal(picture: Float64Array | None) -> Float64Array | None:
    """A picture without noise as frames, (1, H, W)."""
    return None if picture is None else picture[None]


# What every instrument begins with


def frames_and_black(stacks: Sequence[Stack], bench: Bench) -> tuple[Stack, Float64Array]:
    """The first of these stacks, and the mean of the dark frames (H, W). Raises InputError if they do not suit."""
    if not stacks or not bench.darks:
        raise InputError(
            f"the folder has {len(stacks)} stacks of the chart and {len(bench.darks)} of dark frames; take both, with "
            "names that begin with scene and dark."
        )
    frames, dark = stacks[0], bench.darks[0]
    if frames.shape != dark.shape:
        raise InputError(
            f"{frames.source} has {frames.shape[0]} × {frames.shape[1]} pixels and {dark.source} {dark.shape[0]} × "
            f"{dark.shape[1]}; take dark frames of the same size."
        )
    return frames, dark.mean


def without_black(stacks: Sequence[Stack], bench: Bench) -> Float64Array:
    """Mean of the first of these stacks minus that of the dark frames."""
    frames, black = frames_and_black(stacks, bench)
    return np.asarray(frames.mean - black)


def step_of(bench: Bench) -> tuple[int, int]:
    """Distance of the pixels behind one place of the mosaic, down and across."""
    tile = next(iter((*bench.scenes, *bench.stacks))).tile or (("",),)
    return len(tile), len(tile[0])


def each_filter(
    taken: Taken,
    measure: Callable[[Bench, tuple[int, int]], tuple[Sequence[Quantity], dict[str, Draw]]],
) -> list[Measured]:
    """What an instrument finds behind each place of the mosaic, or its refusal.

    measure : figures and drawings, from the frames behind one place and the place.
    """
    places = np.ndindex(step_of(taken.bench))
    found = []
    for (name, bench), place in zip(taken.bench.of_filters().items(), places, strict=True):
        try:
            found.append(Measured(name, *measure(bench, place)))
        except InputError as error:
            found.append(Measured(name, (), refused=(str(error),)))
    return found


def planes_of_filters(bench: Bench) -> dict[str, Float64Array]:
    """The picture behind each colour filter, the mean of its places in the mosaic."""
    planes: dict[str, list[Float64Array]] = {}
    for name, part in bench.of_filters().items():
        own = planes.setdefault(name.partition(" (")[0], [])
        own.append(without_black(part.scenes, part))
    return {name: np.asarray(np.mean(own, axis=0)) for name, own in planes.items()}
