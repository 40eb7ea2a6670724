"""What a dataset will take, from a short render of each scene: renders, samples, bytes, seconds."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from statistics import fmean

from ...core import InputError
from ...render.variants import restores_variant
from ..plan.planned import DatasetPlan, PlannedView
from ..store.keys import Facts
from ..store.record import Record
from ..store.store import Store
from .places import FolderPlace
from .scene_checks import check_scenes

SHORT_SPP = 32
MOST_SCENES = 8  # that are measured; the others are taken for their mean
MOST_SAMPLES = 4  # of a view that are measured
RATIO_EXPONENT = 0.75  # of samples, by which the noise ratio of denoised light falls
START_S = 5.0  # until the processes of a run have loaded Mitsuba and compiled their first scene
GAIN, CONTENTION = (
    1.5,
    1.1,
)  # two processes make samples faster, and renders, which use all cores, more slowly


@dataclass
class Counts:
    """How many there are.  by_scene : views and samples of each scene.  by_split : samples of each split."""

    views: int = 0
    samples: int = 0
    by_scene: dict[str, list[int]] = field(default_factory=dict)
    by_split: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Cost:
    """Of one scene: seconds of a render, seconds of a sample, bytes of the files of a view and of a sample; and the
    noise ratio of a render with all its samples, in the median pixel."""

    render_s: float
    sample_s: float
    view_bytes: int
    sample_bytes: int
    noise_ratio: float


@dataclass(frozen=True)
class Forecast:
    """What a dataset will take.  seconds, bytes : of everything.  scenes : the cost of each scene that was measured."""

    counts: Counts
    seconds: float
    bytes: int
    scenes: dict[str, Cost]

    def to_dict(self) -> Facts:
        """Plain values, ready for JSON."""
        return asdict(self)


def counts_of(plan: DatasetPlan) -> Counts:
    """All views and samples counted, and what they are made of checked. Raises InputError."""
    found = Counts()
    for scene in plan.scenes:
        of_scene = found.by_scene.setdefault(scene.sweep.entry.name, [0, 0])
        for dealt in plan.splits.dealt(scene.sweep):
            for shared in scene.shared:
                chips = sum(
                    len(plan.splits.serials(dealt.split, scene.sweep.rows[row], camera))
                    for row, camera in shared.pairs
                    if row in dealt.rows
                )
                samples = dealt.samples * chips
                of_scene[0] += dealt.lights * (samples > 0)
                of_scene[1] += samples
                found.by_split[dealt.split] = found.by_split.get(dealt.split, 0) + samples
    found.views, found.samples = (
        sum(column) for column in zip(*found.by_scene.values(), strict=True)
    )
    check_scenes(plan)
    return found


@restores_variant
def forecast(
    plan: DatasetPlan,
    workers: int,
    now: Callable[[int, int, str], object] = lambda done, total, what: None,
) -> Forecast:
    """Measure a short render of the middle view of each scene, at most of eight. Raises InputError.

    workers : processes of the run.  now : told what is measured.
    """
    counts, costs = counts_of(plan), dict[str, Cost]()
    measured = dict(_middle_views(plan))
    for number, (scene, view) in enumerate(measured.items()):
        now(number, len(measured), f"a short render of {scene}")
        try:
            costs[scene] = cost_of(view)
        except InputError as error:
            raise InputError(f"scene {scene!r} of the dataset: {error}") from None
    mean = _mean(list(costs.values()))
    gain, contention = (1.0, 1.0) if workers < 2 or counts.views < 2 else (GAIN, CONTENTION)
    seconds, size = START_S, 0.0
    for scene, (views, samples) in counts.by_scene.items():
        cost = costs.get(scene, mean)
        seconds += views * cost.render_s * contention + samples * cost.sample_s / gain
        size += views * cost.view_bytes + samples * cost.sample_bytes
    return Forecast(counts, seconds, round(size), costs)


def cost_of(view: PlannedView) -> Cost:
    """Measured on this machine: a short render, or a whole one where the time of exposure decides it, and some samples,
    of which the first one compiles."""
    from .make import Rendered
    from .view_render import is_timed

    spp = view.config["render"]["spp"]
    short = replace(
        view,
        config={
            **view.config,
            "render": {**view.config["render"], "spp": min(spp or 1, SHORT_SPP)},
        },
    )
    if spp:
        Rendered.of(short)  # compiles
    whole = not spp or is_timed(view)
    started = time.monotonic()
    rendered = Rendered.of(view if whole else short)
    render_s, statistics = time.monotonic() - started, rendered.light.statistics
    noise_ratio = statistics.noise_ratio_median
    if not whole:
        render_s += rendered.seconds_per_sample * (spp - statistics.samples_per_pixel)
        noise_ratio *= (statistics.samples_per_pixel / spp) ** RATIO_EXPONENT
    took, view_bytes, sizes = list[float](), 0, list[int]()
    with tempfile.TemporaryDirectory() as folder:
        if view.outputs:
            started = time.monotonic()
            place = FolderPlace(Store(Path(folder)), view)
            view_bytes = _bytes(place.add_view(rendered.files_of_view))
            render_s += time.monotonic() - started
        step = max(len(view.samples) // MOST_SAMPLES, 1)
        for number, sample in enumerate(
            (view.samples[0], *view.samples[::step][:MOST_SAMPLES])
        ):
            started = time.monotonic()
            place = FolderPlace(Store(Path(folder) / str(number)), view)
            record = place.add(sample, partial(rendered.files_of, sample))
            took.append(time.monotonic() - started)
            sizes.append(_bytes(record))
    return Cost(render_s, fmean(took[1:]), view_bytes, round(fmean(sizes[1:])), noise_ratio)


def _bytes(record: Record) -> int:
    return sum(size for size, _ in record.files.values())


def _middle_views(plan: DatasetPlan) -> Iterator[tuple[str, PlannedView]]:
    """The middle view of each of the first scenes, with all or the first of its samples."""
    for scene in plan.scenes[:MOST_SCENES]:
        views = scene.sweep.lights * len(scene.shared)
        light, shared = divmod(views // 2, len(scene.shared))
        first = scene.first + light * scene.numbers_of_light + scene.shared[shared].start
        view = next(plan.views(first, scene.end), None) or next(
            plan.views(scene.first, scene.end), None
        )
        if view is not None:
            yield scene.sweep.entry.name, view


def _mean(costs: list[Cost]) -> Cost:
    names = [each.name for each in fields(Cost)]
    return Cost(*(sum(getattr(one, name) for one in costs) / len(costs) for name in names))
