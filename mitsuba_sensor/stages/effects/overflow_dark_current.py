"""Dark current of a lateral overflow integration capacitor (LOFIC), which adds to the charge read with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ...core import Electrons, Frame
from ..dark_components import reference_temperature_k
from ..dark_current_models import DarkCurrentModel, Doubling, Measured
from ..datasheet import FileTable, NotNegative, optional
from ..stage import Datasheet, Stage
from ..usual_range import Usual


class OverflowDarkCurrentFields(FileTable):
    """Dark current of the overflow capacitor."""

    overflow_rate_e_per_s: Annotated[NotNegative, Usual(0.01, 1e6)] = optional(
        "dark current of the overflow capacitor of a LOFIC pixel, at the temperature of "
        "rate_e_per_s or 300 K [e-/s]",
        50.0,
        0.0,
        title="LOFIC, lateral overflow integration capacitor",
    )


@dataclass(frozen=True)
class OverflowDarkCurrent(Stage):
    """Adds Poisson(t·D_C(T)) electrons of the overflow capacitor to the charge that is read with it.

    model : D_C(T) in e-/s.
    """

    model: DarkCurrentModel
    domain = "electrons"
    table = "dark_current"
    fields = OverflowDarkCurrentFields
    terms = "dark current of the overflow capacitor"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> OverflowDarkCurrent | None:
        """Return None without such dark current; its temperature dependence is that of the photodiode's rate."""
        dark, at_k = camera.dark_current, reference_temperature_k(camera)
        if not dark.overflow_rate_e_per_s:
            return None
        if dark.doubling_k is None:
            return cls(Measured(dark.overflow_rate_e_per_s, at_k))
        return cls(Doubling(dark.overflow_rate_e_per_s, at_k, dark.doubling_k))

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return the electrons with those of the capacitor added."""
        count = frame.poisson("overflow_dark", frame.number(self.mean_e(frame)))
        return electrons.changed(
            lambda total: total + count, lambda light, dark: (light, dark + count)
        )

    def mean_e(self, frame: Frame) -> float:
        """Return the mean electrons of the capacitor in this exposure."""
        return frame.exposure.time_s * self.model.rate_e_per_s(frame.exposure.temperature_k)
