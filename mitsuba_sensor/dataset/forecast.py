"""What a dataset will take, from a short render of each scene: renders, samples, bytes, seconds."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

from .keys import Facts
from .planned import DatasetPlan, PlannedView
from .store import Store

SHORT_SPP = 32
MOST_SCENES = 8  # that are measured; the others are taken for their mean
START_S = 4.0  # until the processes of a run have loaded Mitsuba and their first scene
GAIN = 1.25  # of two processes over one: while one writes, the other one renders


@dataclass
class Counts:
    """How many there are.  by_scene : views and samples of each scene.  by_split : samples of each split."""

    views: int = 0
    samples: int = 0
    by_scene: dict[str, list[int]] = field(default_factory=dict)
    by_split: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Cost:
    """Of one scene: seconds of a render, seconds of a sample, bytes of the files of a view and of a sample."""

    render_s: float
    sample_s: float
    view_bytes: int
    sample_bytes: int


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
    """All views and samples counted, and every one of them checked. Raises InputError."""
    found = Counts()
    for view in plan.views():
        of_scene = found.by_scene.setdefault(view.scene, [0, 0])
        found.views, of_scene[0] = found.views + 1, of_scene[0] + 1
        found.samples, of_scene[1] = found.samples + len(view.samples), of_scene[1] + len(view.samples)
        for sample in view.samples:
            found.by_split[sample.split] = found.by_split.get(sample.split, 0) + 1
    return found


def forecast(
    plan: DatasetPlan, workers: int, now: Callable[[int, int, str], object] = lambda done, total, what: None
) -> Forecast:
    """Measure a short render of the first view of each scene, at most of eight. Raises InputError.

    workers : processes of the run.  now : told what is measured.
    """
    counts, costs = counts_of(plan), dict[str, Cost]()
    first = dict(_first_views(plan))
    for number, (scene, view) in enumerate(list(first.items())[:MOST_SCENES]):
        now(number, min(len(first), MOST_SCENES), f"a short render of {scene}")
        costs[scene] = cost_of(view)
    mean = _mean(list(costs.values()))
    seconds, size = 0.0, 0.0
    for scene, (views, samples) in counts.by_scene.items():
        cost = costs.get(scene, mean)
        seconds += views * cost.render_s + samples * cost.sample_s
        size += views * cost.view_bytes + samples * cost.sample_bytes
    spread = 1.0 if workers < 2 or counts.views < 2 else GAIN
    return Forecast(counts, START_S + seconds / spread, round(size), costs)


def cost_of(view: PlannedView) -> Cost:
    """Measured on this machine: a short render, and two samples of it, of which the first one compiles."""
    from .make import Rendered

    spp = view.config["render"]["spp"]
    short = replace(view, config={**view.config, "render": {**view.config["render"], "spp": min(spp or 1, SHORT_SPP)}})
    asked = short if spp else view  # a noise ratio decides itself how long it takes
    if spp:
        Rendered.of(asked)  # compiles
    started = time.monotonic()
    rendered = Rendered.of(asked)
    render_s, statistics = time.monotonic() - started, rendered.light.statistics
    if spp:
        render_s += rendered.seconds_per_sample * (spp - statistics.samples_per_pixel)
    took = list[float]()
    with tempfile.TemporaryDirectory() as folder:
        view_bytes, sample = 0, view.samples[0]
        if view.outputs:
            started = time.monotonic()
            view_bytes = _bytes(Store(Path(folder)).commit("views", view.key, rendered.write).files)
            render_s += time.monotonic() - started
        for number in range(3):  # the first one compiles
            started = time.monotonic()
            record = Store(Path(folder) / str(number)).commit("samples", sample.key, partial(rendered.expose, sample))
            took.append(time.monotonic() - started)
    return Cost(render_s, min(took), view_bytes, _bytes(record.files))


def _bytes(files: Mapping[str, tuple[int, str]]) -> int:
    return sum(size for size, _ in files.values())


def _first_views(plan: DatasetPlan) -> Iterator[tuple[str, PlannedView]]:
    seen = set[str]()
    for view in plan.views():
        if view.scene not in seen and len(seen) < MOST_SCENES:
            seen.add(view.scene)
            yield view.scene, view


def _mean(costs: list[Cost]) -> Cost:
    names = "render_s", "sample_s", "view_bytes", "sample_bytes"
    return Cost(*(sum(getattr(one, name) for one in costs) / len(costs) for name in names))
