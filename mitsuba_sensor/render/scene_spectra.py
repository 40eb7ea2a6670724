"""The spectra of a parsed scene, and the wavelength range where each can be above zero."""

from __future__ import annotations

import math

from .variants import MitsubaObject, mitsuba

Range = tuple[float, float]
EVERYWHERE: Range = (-math.inf, math.inf)
MITSUBA_NM: Range = (360.0, 830.0)
LIMITED = ("d65", "blackbody")  # spectra that end with Mitsuba's range
SKIES = ("envmap", "sunsky", "timed_sunsky")
STRENGTHS = ("radiance", "irradiance", "intensity")  # of emitters; a float there is a factor on D65 (#1579)
TOLERANCE_NM = 1e-3


class SceneSpectra:
    """Spectra of the emitters and materials of a scene.

    lights : (node, range) of every emitter.  materials : (node, name, range) of every property of a material.
    colours : nodes whose reflectance is an rgb colour or image, or whose radiance is an image; outside Mitsuba's range
        they are extrapolated.
    float_lights : nodes of emitters whose strength is one number.
    """

    def __init__(self, state: MitsubaObject) -> None:
        self._mi, self._nodes = mitsuba(), list(state.nodes)
        kinds = self._mi.ObjectType
        emitters = [n for n in self._nodes if n.type == kinds.Emitter]
        surfaces = [n for n in self._nodes if n.type in (kinds.BSDF, kinds.Medium)]
        self.lights = [(n, self._of_light(n.props)) for n in emitters]
        self.float_lights = [n for n in emitters if any(isinstance(v, float) for v in _strengths(n.props))]
        self.materials = [(n, name, self._of_value(v, light=False)) for n in surfaces for name, v in n.props.items()]
        self.colours = [n for n in surfaces if any(self._is_colour(v) for _, v in n.props.items())]
        self.colours += [n for n in emitters if any(self._is_colour(v) for v in _strengths(n.props) if not _is_rgb(v))]

    def incomplete(self, low_nm: float, high_nm: float) -> dict[tuple[str, float, float], list[MitsubaObject]]:
        """The nodes of spectra that do not extend from ``low_nm`` to ``high_nm``, by name and by their own range."""
        named = [(n, "light", r) for n, r in self.lights] + [(n, f"{name!r}", r) for n, name, r in self.materials]
        groups: dict[tuple[str, float, float], list[MitsubaObject]] = {}
        for node, name, (low, high) in named:
            if low > low_nm + TOLERANCE_NM or high < high_nm - TOLERANCE_NM:
                groups.setdefault((name, low, high), []).append(node)
        return groups

    def has_light(self, low_nm: float, high_nm: float) -> bool:
        """Whether any emitter of the scene can be above zero in the band."""
        return any(r[0] < high_nm and r[1] > low_nm for _, r in self.lights)

    def _of_light(self, props: MitsubaObject) -> Range:
        if props.plugin_name() in SKIES or any(isinstance(v, float) or _is_rgb(v) for v in _strengths(props)):
            return MITSUBA_NM  # rgb is multiplied by D65; rgb inside a texture is not, and unlimited
        ranges = [self._of_value(value, light=True) for _, value in props.items()]
        return min(ranges, key=lambda r: r[1] - r[0], default=EVERYWHERE)

    def _of_value(self, value: MitsubaObject, light: bool) -> Range:
        """Where a property can be above zero; everywhere if it is no spectrum or unlimited."""
        mi = self._mi
        if isinstance(value, mi.Properties.ResolvedReference):
            node = self._nodes[value.index()]
            return self._of_texture(node.props, light) if node.type == mi.ObjectType.Texture else EVERYWHERE
        if hasattr(value, "is_uniform") and not value.is_uniform():  # the parser's spectrum, not the variant's
            return _ends(value.wavelengths)
        return EVERYWHERE

    def _of_texture(self, props: MitsubaObject, light: bool) -> Range:
        kind, names = props.plugin_name(), list(props.keys())
        if kind == "irregular":
            nodes = props["wavelengths"] if "wavelengths" in names else ""
            return _ends([float(number) for number in str(nodes).replace(",", " ").split()])
        if {"wavelength_min", "wavelength_max"} <= set(names):
            return float(props["wavelength_min"]), float(props["wavelength_max"])
        inner = [self._of_value(value, light) for _, value in props.items()]
        if light and kind in LIMITED:
            inner.append(MITSUBA_NM)
        return (max(r[0] for r in inner), min(r[1] for r in inner)) if inner else EVERYWHERE

    def _is_colour(self, value: MitsubaObject) -> bool:
        """Whether a property of a material is an rgb colour or image, or a texture that contains one."""
        if _is_rgb(value):
            return True
        props = self._texture(value)
        if props is None:
            return False
        is_image = props.plugin_name() == "bitmap" and not props.get("raw")  # raw: roughness, normals and the like
        return is_image or any(self._is_colour(inner) for _, inner in props.items())

    def _texture(self, value: MitsubaObject) -> MitsubaObject:
        mi = self._mi
        if not isinstance(value, mi.Properties.ResolvedReference):
            return None
        node = self._nodes[value.index()]
        return node.props if node.type == mi.ObjectType.Texture else None


def _strengths(props: MitsubaObject) -> list[MitsubaObject]:
    return [props[name] for name in STRENGTHS if name in props]


def _is_rgb(value: MitsubaObject) -> bool:
    return "Color3" in type(value).__name__


def _ends(wavelengths_nm: list[float]) -> Range:
    return (float(min(wavelengths_nm)), float(max(wavelengths_nm))) if len(wavelengths_nm) else EVERYWHERE
