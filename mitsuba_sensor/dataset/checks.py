"""Checks of a dataset file before anything is made: samples counted, scenes parsed, growth allowed."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from ..camera.sensor_size import check_on_sensor
from ..core import Exposure, InputError
from ..core.options import complete
from ..files.memory import whole_memory_bytes
from ..output.dng import check_dng
from ..render.load.half_pupil import check_halves
from ..render.options import RenderOptions
from ..render.passes.prepared import prepare
from ..render.passes.stop_criterion import check_options
from ..render.scene.asked import AskedGroups
from ..render.scene.light_groups import LightGroup, parts_of_light
from ..render.variants import restores_variant
from .file import SAMPLES_MAX, DatasetFile
from .keys import canonical
from .make import camera_of, parsed_scene, scene_options
from .plan import DatasetPlan, Place, Task
from .sweep import ends, evenly_chosen, most_frames
from .values import check_value

CHECKED_MAX = 200
"""Lights that are checked, evenly chosen of each scene; the run checks the others."""
LOADED_MAX = 20
"""Tasks whose scenes are loaded, because only loading shows whether they can be rendered."""
LOAD_EXPOSURE = Exposure(0.01)
NOT_PIXELS = "description", "licence"
"""Fields of a dataset file that may change without another dataset."""
PIXEL_BYTES, CODE_BYTES = 24, 2
"""Memory for mean, variance and light of a pixel, and for its code in each frame."""


def check_scenes(plan: DatasetPlan) -> None:
    """Parse each scene with each of its settings, and load some. Raises InputError for a scene that cannot be rendered.

    Only a render finds e.g. a scene without light. A scene is loaded for what only Mitsuba knows: names of parameters,
    what moves, a lens. A scene that ends Mitsuba when loaded also ends a plan; other scenes are only parsed, so a run
    continues.
    """
    parsed, loaded = set[str](), set[str]()
    lights_max = max(CHECKED_MAX // len(plan.sweeps), 1)
    places = (
        Place(scene, light)
        for scene, sweep in enumerate(plan.sweeps)
        for light in evenly_chosen(range(sweep.lights), lights_max)
    )
    for task in (task for place in places for task in plan.tasks_at(place)):
        config, camera = task.config, task.lead["camera"]
        sizes = {name: np.size(x) for name, x in config["traverse"].items()}
        lens = camera["lens"] if camera["lens"].get("prescription") else None
        of_load = [sizes, config.get("motion"), lens]
        to_load = canonical([task.scene_file, *of_load])
        settings = map(config.get, ("parameters", "integrator", "scene_unit", "sensor"))
        width = config["render"]["width"]
        to_parse = canonical([to_load, *settings, width, camera["sensor"], camera["lens"]])
        if to_parse not in parsed:
            parsed.add(to_parse)
            is_loaded = any(of_load) and to_load not in loaded and len(loaded) < LOADED_MAX
            loaded |= {to_load} if is_loaded else set()
            check_scene(plan, task, is_loaded)


@restores_variant
def check_scene(plan: DatasetPlan, task: Task, is_loaded: bool) -> None:
    """Raise InputError if the scene of a task cannot be rendered, or its samples cannot be made.

    is_loaded : True to load the scene.
    """
    try:
        options = scene_options(task)
        chosen = complete(RenderOptions, options)
        check_options(chosen)
        parsed = parsed_scene(task, options)
        parsed.settings.metres(options["scene_unit"])
        camera = camera_of(task.lead)  # all cameras that share a light have this sensor size
        shape, origin = parsed.film_area(camera, options["width"])
        check_on_sensor("the film", shape, origin, camera)
        check_halves(parsed, camera)
        _check_memory(shape, most_frames(plan.file))
        if "dng" in task.lead["outputs"]:
            check_dng(camera, shape)
        asked = cast(AskedGroups | None, chosen["light_groups"])
        _check_lights(plan, parts_of_light(parsed, asked, camera))
        if is_loaded:
            still: RenderOptions = {**options, "noise_ratio": None, "max_spp": None, "spp": 1}
            prepare(parsed, camera, LOAD_EXPOSURE, **still)
    except InputError as error:
        raise InputError(f"scene {task.scene!r} of the dataset: {error}") from None


def _check_lights(plan: DatasetPlan, groups: Sequence[LightGroup]) -> None:
    """Raise InputError for varied light of an unknown group.  groups : of the scene."""
    names = [group.name for group in groups if group.half_pupil is None]
    for field_name in plan.file.varied:
        kind, _, group = field_name.partition(".")
        if kind == "lights" and group not in names:
            groups_are = f"the light groups of the scene are {', '.join(names)}"
            if not names:
                groups_are = 'light_groups is not in [render]; give light_groups = "auto" there'
            raise InputError(f"{field_name} varies, but {groups_are}.")


def _check_memory(shape: tuple[int, int], frames: int) -> None:
    """Raise InputError for images that exceed the memory of this machine."""
    rows, columns = shape
    needed, there = rows * columns * (PIXEL_BYTES + frames * CODE_BYTES), whole_memory_bytes()
    if needed > there:
        raise InputError(
            f"a sample has {columns} × {rows} pixels and frames is {frames}: {needed / 1e9:.3g} GB, but this machine "
            f"has {there / 1e9:.3g} GB of memory; take a smaller width or fewer frames, and vary repetition for more "
            "samples of the same settings."
        )


@dataclass
class Counts:
    """Counts of a dataset.

    by_scene : lights and samples of each scene.  by_split : samples of each split.  left_out : combinations that no
    split has.
    """

    tasks: int = 0
    samples: int = 0
    by_scene: dict[str, list[int]] = field(default_factory=dict)
    by_split: dict[str, int] = field(default_factory=dict)
    left_out: int = 0

    def notes(self) -> list[str]:
        """Return a sentence on combinations that are left out."""
        if not self.left_out:
            return []
        return [
            f"Splits leave out {self.left_out} of {self.samples + self.left_out} combinations: serial varies, and a "
            "combination is made only if its scene and its serial number are in the same split. To make every "
            "combination, remove serial and set chips in [splits]."
        ]


def checked_counts(
    plan: DatasetPlan, each: Callable[[Task], object] = lambda task: None
) -> Counts:
    """Count all samples. Raises InputError for impossible values and for two equal samples.

    each : called with every task.
    """
    random = plan.file.random
    for name, distribution in random.values.items() if random else ():
        for value in ends(distribution, random.draws if random else 1):
            check_value(name, value)
    if (combinations := plan.combinations) > SAMPLES_MAX:
        raise InputError(
            f"the dataset has {combinations} samples; it can have at most {SAMPLES_MAX}: make several datasets, or "
            "draw values at random instead of every combination."
        )
    counts, keys, last_light = Counts(), array("Q"), ""
    for task in plan.tasks():
        of_scene = counts.by_scene.setdefault(task.scene, [0, 0])
        of_scene[0] += task.light_key != last_light
        of_scene[1] += len(task.samples)
        last_light = task.light_key
        each(task)
        counts.tasks += 1
        counts.samples += len(task.samples)
        for sample in task.samples:
            keys.append(int(sample.key[:16], 16))
            counts.by_split[sample.split] = counts.by_split.get(sample.split, 0) + 1
    counts.left_out = combinations - counts.samples
    ordered = np.sort(np.frombuffer(keys, np.uint64)) if keys else np.zeros(0, np.uint64)
    if (same := ordered[1:][ordered[1:] == ordered[:-1]]).size:
        _refuse_equal(plan, f"{same[0]:016x}")
    return counts


def _refuse_equal(plan: DatasetPlan, key: str) -> None:
    """Raise InputError with the places in the dataset file of two samples whose keys start with this text."""

    def places() -> Iterator[dict[str, int]]:
        for task in plan.tasks():
            sweep = plan.sweeps[task.place.scene]
            for sample in task.samples:
                if sample.key.startswith(key):
                    row, camera, exposure, serial = sample.entry
                    numbers = {"scenes": task.place.scene, "cameras": camera, "list": row}
                    numbers |= sweep.entries(task.place.light, exposure)
                    yield numbers | {"grid.serial": serial}

    samples = places()
    first, second = next(samples), next(samples)
    differ = [
        f"{name}.{first[name]} and {name}.{second[name]}"
        for name in first
        if first[name] != second.get(name, first[name])
    ]
    raise InputError(
        f"two samples are the same: {', '.join(differ)}; remove one, give views another time_s, or vary repetition for "
        "another sample of the same settings."
    )


def growth_refused(old: DatasetFile, new: DatasetFile) -> str:
    """Return the changes of a dataset file that a dataset cannot take; an empty text without any.

    A dataset can gain scenes, cameras, rows, grid values and draws.
    """
    changed = []
    for name in DatasetFile.model_fields:
        before, now = getattr(old, name), getattr(new, name)
        grows = name in NOT_PIXELS
        if name in ("scenes", "cameras", "list"):
            grows = bool(before) and all(x in now for x in before)
        elif name == "grid" and before.keys() == now.keys():
            grows = all({*map(repr, before[x])} <= {*map(repr, now[x])} for x in before)
        elif name == "random" and before and now:
            grows = before.values == now.values and before.draws <= now.draws
        if before != now and not grows:
            changed.append(f"[{name}]" if name in ("render", "splits") else name)
    return ", ".join(changed)
