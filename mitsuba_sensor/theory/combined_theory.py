"""Theory of frames: by the law of a pixel, by samples of the chain, or of combined read-outs.

Of combined read-outs the linear code of a pixel without fixed-pattern noise follows from the law of each read-out in
closed form (combined_codes.py); what the fixed patterns add is measured by samples of the chain.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from ..core import Frame
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.readouts import light_of_readout
from ..stages.combined_readouts import CombinedReadouts, combined_of
from ..stages.stage import Chain, without_law
from .combined_codes import CodeMoments, combined_codes
from .frame_theory import FrameTheory
from .measured_theory import MeasuredTheory
from .pixel_moments import PixelMoments, check_clean_is_known, pixel_moments
from .pixel_swing import Codes
from .response import Response, behind_stages_at


def theory_of(stages: Chain, light: Detected, frame: Frame) -> FrameTheory:
    """The theory of a chain, measured where a stage has no law.

    light, frame : of the window, and its exposure, place and measured maps.
    """
    if combined_of(stages) is not None:
        return CombinedTheory(stages, light, frame)
    if without_law(stages):
        return MeasuredTheory(stages, light, frame)
    return FrameTheory(stages, light, frame)


def moments_of_pixels(stages: Chain, light: Detected, frame: Frame) -> PixelMoments:
    """Mean and temporal variance of the codes of a window, for the maps of its serial. Raises InputError where they are
    not known: see :func:`theory.pixel_moments.pixel_moments`."""
    combined = combined_of(stages)
    if combined is None:
        return pixel_moments(stages, light, frame)
    codes = list[CodeMoments]()
    for readout in combined.readouts:
        own = light_of_readout(readout, light, frame)
        mean, temporal = pixel_moments(readout.stages, own, readout.frame_of(frame))
        codes.append(
            CodeMoments(np.ravel(mean).astype(float), np.ravel(temporal).astype(float))
        )
    shape = frame.window.shape
    found = (
        x.reshape(shape).astype(np.float32) for x in combined_codes(combined, codes, frame)
    )
    return PixelMoments(*found)


def check_moments_are_known(stages: Chain) -> None:
    """Raise InputError for a chain, or a read-out of it, whose clean frame is not known."""
    combined = combined_of(stages)
    if combined is None:
        check_clean_is_known(stages)
        return
    for readout in combined.readouts:
        check_clean_is_known(readout.stages)


def codes_by_light(
    combined: CombinedReadouts, frame: Frame, light_e: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the linear code of a pixel without fixed-pattern noise, by its mean photoelectrons in the
    reference exposure, (L,) each [DN, DN²]."""
    codes = list[CodeMoments]()
    for readout in combined.readouts:
        stages, own = readout.stages, readout.frame_of(frame)
        last = len(stages) - 1
        found = behind_stages_at(stages, own, readout.light_ratio * light_e, [last])
        codes.append(CodeMoments(*found[last]))
    return combined_codes(combined, codes, frame)


class CombinedTheory(MeasuredTheory):
    """Theory of one light on combined read-outs."""

    @property
    def _combined(self) -> CombinedReadouts:
        combined = combined_of(self.stages)
        assert combined is not None
        return combined

    @cached_property
    def _responses(self) -> list[Callable[[Float64Array], CodeMoments]]:
        """Of each read-out: mean and variance of its code by the mean photoelectrons of the reference exposure."""
        darkest, brightest = self.levels.light_e[[0, -1]]
        found = list[Callable[[Float64Array], CodeMoments]]()
        for readout in self._combined.readouts:
            ratio, last = readout.light_ratio, len(readout.stages) - 1
            own = readout.frame_of(self.frame)
            response = Response.of(
                readout.stages, own, float(darkest * ratio), float(brightest * ratio)
            )

            def codes(
                light_e: Float64Array,
                response: Response = response,
                ratio: float = ratio,
                last: int = last,
            ) -> CodeMoments:
                level_e = ratio * light_e
                return CodeMoments(
                    response.mean(last, level_e), response.temporal(last, level_e)
                )

            found.append(codes)
        return found

    def _plain(self, number: int, light_e: Float64Array) -> Codes:
        if number == 0:
            return light_e, np.zeros(light_e.shape)
        codes = [response(light_e) for response in self._responses]
        return combined_codes(self._combined, codes, self.frame)
