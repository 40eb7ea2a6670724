"""Say, before anything is rendered, which spectra of a scene are black where the camera still sees.

Outside 360 to 830 nm Mitsuba's own light is zero unless told otherwise (d65, rgb and float emitters, environment maps,
sun and sky, blackbody); a table is zero outside its nodes. Nothing warns of either.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

Range = tuple[float, float]
EVERYWHERE: Range = (-math.inf, math.inf)
MITSUBA_NM: Range = (360.0, 830.0)
LIMITED = ("d65", "blackbody", "srgb")  # spectra that stop with Mitsuba's range
SKIES = ("envmap", "sunsky", "timed_sunsky")


class Spectra:
    """The spectra of a parsed scene, and the wavelengths where each can be above zero."""

    def __init__(self, mi: Any, state: Any) -> None:
        self._mi, self._nodes = mi, list(state.nodes)
        kinds = mi.ObjectType
        self.lights = [self._of_light(n.props) for n in self._nodes if n.type == kinds.Emitter]
        self.matter = [
            (name, self._of_value(value, light=False))
            for node in self._nodes
            if node.type in (kinds.BSDF, kinds.Medium)
            for name, value in node.props.items()
        ]

    def dark(self, low_nm: float, high_nm: float) -> list[str]:
        """Notes about spectra that do not reach from ``low_nm`` to ``high_nm``."""
        named = [("light", r) for r in self.lights] + [(f"{name!r}", r) for name, r in self.matter]
        short = Counter((name, r) for name, r in named if r[0] > low_nm + 1e-3 or r[1] < high_nm - 1e-3)
        return [
            f"{name} in {count} place{'s' * (count > 1)} is black outside {r[0]:g} to {r[1]:g} nm; "
            f"the bands go from {low_nm:g} to {high_nm:g} nm"
            for (name, r), count in short.items()
        ]

    def lit(self, low_nm: float, high_nm: float) -> bool:
        """False if no light of the scene can reach the band."""
        return any(r[0] < high_nm and r[1] > low_nm for r in self.lights)

    def _of_light(self, props: Any) -> Range:
        if props.plugin_name() in SKIES:
            return MITSUBA_NM
        ranges = [self._of_value(value, light=True) for _, value in props.items()]
        return min(ranges, key=lambda r: r[1] - r[0], default=EVERYWHERE)

    def _of_value(self, value: Any, light: bool) -> Range:
        """Where a property can be above zero; everywhere if it is no spectrum or has no end."""
        mi = self._mi
        if isinstance(value, mi.Properties.ResolvedReference):
            node = self._nodes[value.index()]
            return self._of_texture(node.props, light) if node.type == mi.ObjectType.Texture else EVERYWHERE
        if hasattr(value, "is_uniform") and not value.is_uniform():  # the parser's spectrum, not the variant's
            return _ends(value.wavelengths)
        if light and type(value).__name__.startswith("Color3"):
            return MITSUBA_NM
        return EVERYWHERE

    def _of_texture(self, props: Any, light: bool) -> Range:
        kind, names = props.plugin_name(), list(props.keys())
        if kind == "irregular":
            nodes = props["wavelengths"] if "wavelengths" in names else ""
            return _ends([float(word) for word in str(nodes).replace(",", " ").split()])
        if {"wavelength_min", "wavelength_max"} <= set(names):
            return float(props["wavelength_min"]), float(props["wavelength_max"])
        inner = [self._of_value(value, light) for _, value in props.items()]
        if light and kind in LIMITED:
            inner.append(MITSUBA_NM)
        return (max(r[0] for r in inner), min(r[1] for r in inner)) if inner else EVERYWHERE


def _ends(wavelengths_nm: list[float]) -> Range:
    return (float(min(wavelengths_nm)), float(max(wavelengths_nm))) if len(wavelengths_nm) else EVERYWHERE
