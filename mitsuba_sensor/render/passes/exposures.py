"""Renders of a scene that moves for a camera whose read-outs are exposed one after the other: one for each exposure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ...camera.exposure_times import later_exposures
from ..light.irradiance import Irradiance
from ..motion.moving_scene import MovingScene
from .passes import hashed_seed
from .renderer import Criterion
from .stop_criterion import Progress, StopCriterion

if TYPE_CHECKING:
    from .prepared import PreparedRender


def render_exposures(
    whole: PreparedRender,
    seed: int,
    stop: StopCriterion,
    progress: Progress | None,
    started: float | None,
    criterion: Criterion | None,
) -> Irradiance:
    """The light of the first exposure of a frame, which knows that of the later ones; each has as many samples.

    started : when it began, on the monotonic clock [s].
    """
    first, later = replace(whole, one_exposure=True), dict[str, Irradiance]()
    assert isinstance(whole.scene, MovingScene)
    light = first.render(seed, stop, progress, started=started, criterion=criterion)
    asked = later_exposures(whole.camera, whole.exposure, whole.begin_s)
    for number, (name, (exposure, begin_s)) in enumerate(asked.items()):
        subframes = whole.scene.asked_subframes
        one = first.moved_to(whole.motion, begin_s, exposure, subframes)
        later[name] = one.render(hashed_seed(seed, -4, number), stop, progress)
        one.renderer.release()
    return replace(light, later=later)
