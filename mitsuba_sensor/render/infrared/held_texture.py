"""A texture that has the value of another one up to 700 nm, and beyond that value or a measured spectrum.

Mitsuba's own textures cannot be combined so. In compiled variants it costs nothing that can be measured; in scalar
ones, which call Python for every ray, a scene of nothing but such textures takes four times as long.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from ...core import Array
from ...core.llvm import drjit
from ..variants import MitsubaObject, mitsuba
from .materials import HELD_FROM_NM

PLUGIN = "held_beyond_700_nm"
PARTS = ("texture", "beyond")  # what is nested in it: beyond is a spectrum, or missing
PASSED_ON = (
    "eval_1",
    "eval_1_grad",
    "eval_3",
    "is_spatially_varying",
    "max",
    "mean",
    "parameters_changed",
    "pdf_position",
    "pdf_spectrum",
    "resolution",
    "sample_position",
    "sample_spectrum",
    "spectral_resolution",
    "traverse",
    "wavelength_range",
)
"""Methods of a texture that are those of the one inside, whose parameters keep their names in mi.traverse."""


def register_held_texture() -> None:
    """Make the plugin known in the variant that is set."""
    _register(mitsuba().variant())


@cache
def _register(variant: str) -> None:
    """Mitsuba has another base class in every variant."""
    mi, dr = mitsuba(), drjit()
    assert mi.variant() == variant

    class HeldTexture(mi.Texture):  # type: ignore[misc, name-defined]
        """props : with the nested ``texture`` and, if need be, the spectrum ``beyond``."""

        def __init__(self, props: MitsubaObject) -> None:
            super().__init__(props)
            inner, beyond = PARTS
            self.inner = props[inner]
            self.beyond = props.get(beyond, None)

        def eval(self, si: MitsubaObject, active: Array = True) -> Array:
            """Values at the wavelengths of an interaction."""
            wavelengths_nm = type(si.wavelengths)(si.wavelengths)
            si.wavelengths = dr.minimum(wavelengths_nm, HELD_FROM_NM)
            values = self.inner.eval(si, active)
            si.wavelengths = wavelengths_nm
            if self.beyond is None:
                return values
            measured = self.beyond.eval(si, active)
            return dr.select(wavelengths_nm > HELD_FROM_NM, measured, values)

        def to_string(self) -> str:
            """For people."""
            return f"HeldTexture[{self.inner}]"

    for name in PASSED_ON:
        setattr(HeldTexture, name, _passed_on(name))
    mi.register_texture(PLUGIN, HeldTexture)


def _passed_on(name: str) -> Callable[..., object]:
    def method(self: MitsubaObject, *arguments: object) -> object:
        return getattr(self.inner, name)(*arguments)

    return method
