"""The spectra of a parsed scene, and the wavelengths where each can be above zero."""

from __future__ import annotations

import math
from typing import Any

Range = tuple[float, float]
EVERYWHERE: Range = (-math.inf, math.inf)
MITSUBA_NM: Range = (360.0, 830.0)
LIMITED = ("d65", "blackbody")  # spectra that stop with Mitsuba's range
SKIES = ("envmap", "sunsky", "timed_sunsky")
STRENGTHS = ("radiance", "irradiance", "intensity")  # of lights; a float there is so much D65 (#1579)
TOLERANCE_NM = 1e-3


class Spectra:
    """What the lights and the surfaces of a scene are made of.

    colours : nodes whose reflectance is an rgb colour or picture, or whose light is a picture: what they are outside
        Mitsuba's range is made up.
    float_lights : nodes of lights whose strength is one number.
    """

    def __init__(self, mi: Any, state: Any) -> None:
        self._mi, self._nodes = mi, list(state.nodes)
        kinds = mi.ObjectType
        emitters = [n for n in self._nodes if n.type == kinds.Emitter]
        surfaces = [n for n in self._nodes if n.type in (kinds.BSDF, kinds.Medium)]
        self.lights = [(n, self._of_light(n.props)) for n in emitters]
        self.float_lights = [n for n in emitters if any(isinstance(v, float) for v in _strengths(n.props))]
        self.matter = [(n, name, self._of_value(v, light=False)) for n in surfaces for name, v in n.props.items()]
        self.colours = [n for n in surfaces if any(self._is_colour(v) for _, v in n.props.items())]
        self.colours += [n for n in emitters if any(self._is_colour(v) for v in _strengths(n.props) if not _is_rgb(v))]

    def short(self, low_nm: float, high_nm: float) -> dict[tuple[str, float, float], list[Any]]:
        """The nodes of spectra that do not reach from ``low_nm`` to ``high_nm``, by name and by their own range."""
        named = [(n, "light", r) for n, r in self.lights] + [(n, f"{name!r}", r) for n, name, r in self.matter]
        groups: dict[tuple[str, float, float], list[Any]] = {}
        for node, name, (low, high) in named:
            if low > low_nm + TOLERANCE_NM or high < high_nm - TOLERANCE_NM:
                groups.setdefault((name, low, high), []).append(node)
        return groups

    def lit(self, low_nm: float, high_nm: float) -> bool:
        """False if no light of the scene can reach the band."""
        return any(r[0] < high_nm and r[1] > low_nm for _, r in self.lights)

    def _of_light(self, props: Any) -> Range:
        if props.plugin_name() in SKIES or any(isinstance(v, float) or _is_rgb(v) for v in _strengths(props)):
            return MITSUBA_NM  # an rgb light is multiplied by D65; one inside a texture is not, and has no end
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

    def _is_colour(self, value: Any) -> bool:
        """Whether a property of a surface is an rgb colour or picture, or a texture made of such."""
        if _is_rgb(value):
            return True
        props = self._texture(value)
        if props is None:
            return False
        return self._is_picture(value) or any(self._is_colour(inner) for _, inner in props.items())

    def _is_picture(self, value: Any) -> bool:
        """Whether a property is a texture from an rgb picture; a raw one holds roughness, normals and the like."""
        props = self._texture(value)
        return props is not None and props.plugin_name() == "bitmap" and not props.get("raw")

    def _texture(self, value: Any) -> Any:
        mi = self._mi
        if not isinstance(value, mi.Properties.ResolvedReference):
            return None
        node = self._nodes[value.index()]
        return node.props if node.type == mi.ObjectType.Texture else None


def _strengths(props: Any) -> list[Any]:
    return [props[name] for name in STRENGTHS if name in props]


def _is_rgb(value: Any) -> bool:
    return "Color3" in type(value).__name__


def _ends(wavelengths_nm: list[float]) -> Range:
    return (float(min(wavelengths_nm)), float(max(wavelengths_nm))) if len(wavelengths_nm) else EVERYWHERE
