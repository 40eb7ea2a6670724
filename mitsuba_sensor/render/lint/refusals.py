"""Rejects scenes that cannot be rendered into spectral bands, and proposes what to do instead."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

from ...core import InputError, nearest
from ...files.raw_files import require_plausible_picture
from ..scene.loaded_scene import IMAGING, why_no_image
from ..scene.parsed_scene import POLARISING, ParsedScene
from ..scene.scene_settings import FILM
from ..variants import MitsubaObject, is_polarized, mitsuba
from .finding import Finding, lines_of
from .spectra import Range

PICTURES = ("bitmap", "envmap")  # plugins that read an image file
SOURCES = ("filename", "bitmap", "data")  # a bitmap without any of them ends the process
MESH_ATTRIBUTE = "mesh_attribute"  # texture
ATTRIBUTES_TAKEN = re.compile(r'MeshAttribute\[\s*name = "([^"]*)"')
"""A pattern in Mitsuba's description of a material."""
INTEGRATORS = {
    "depth": "does not compute radiance",
    "volprim_rf_basic": "renders RGB radiance fields without spectra",
    "ptracer": "starts its paths at the emitters and cannot write spectral bands",
}
"""Integrators that cannot be used, and the reason."""


def refuse_unsuitable(scene: ParsedScene) -> None:
    """Raise InputError for a sensor, integrator, material or emitter that cannot be rendered into spectral bands."""
    variant = mitsuba().variant()
    is_followed = scene.ignore_polarization or is_polarized()
    others = [
        name
        for name, (_, node) in zip(
            scene.sensors(), scene.children(scene.root, "Sensor"), strict=True
        )
        if node.props.plugin_name() in IMAGING
    ]
    for node in (scene.sensor(), *scene.nodes("Integrator", "BSDF", "Emitter")):
        kind, why = node.props.plugin_name(), ""
        if node == scene.sensor() and kind not in IMAGING:
            another = (
                f", or use another sensor of the scene: sensor={others[0]!r}" if others else ""
            )
            why = why_no_image(kind) + another
        elif kind in INTEGRATORS:
            new = "volpath" if scene.nodes("Medium") else "path"
            why = f"{kind!r} {INTEGRATORS[kind]}; use integrator={new!r}"
        elif kind in POLARISING and not is_followed:
            why = (
                f"{kind!r} acts on polarised light; use a polarised variant, e.g. "
                "variant='llvm_ad_spectral_polarized', or ignore_polarization=True for unpolarised light"
            )
        elif kind == "timed_sunsky" and not variant.startswith("scalar"):
            # Dr.Jit fails to trace it, and every later render of the process.
            why = f"{kind!r} of Mitsuba 3.9.1 fails in {variant}; use variant='scalar_spectral'"
        if why:
            raise InputError(f"scene {scene.name!r}, {scene.where(node)}: {why}.")


def refuse_missing_files(scene: ParsedScene) -> None:
    """Raise InputError that names all missing meshes, textures and tables."""
    missing = dict[str, str]()
    for node in scene.state.nodes:
        name, kind = node.props.get("filename", None), node.props.plugin_name()
        if kind == "bitmap" and not any(source in node.props for source in SOURCES):
            missing.setdefault("a bitmap without a filename", scene.where(node))
        if not isinstance(name, str):
            continue
        file = Path(str(scene.resolver.resolve(name)))
        if not os.path.isfile(file):
            missing.setdefault(name, scene.where(node))
        elif kind in PICTURES:
            require_plausible_picture(file)
    if missing:
        named = ", ".join(f"{name} ({line})" for name, line in missing.items())
        files = f"{len(missing)} files" if len(missing) > 1 else "a file"
        where = "look in the folder of the scene, or name another with <path value=…/>"
        raise InputError(f"scene {scene.name!r} lacks {files}: {named}; {where}.")


def refuse_missing_attributes(scene: ParsedScene, world: MitsubaObject) -> None:
    """Raise InputError for a shape without an attribute that its material or light takes: scalar variants fail on it,
    and compiled variants render it black."""
    takers = [
        node for node in scene.nodes("Texture") if node.props.plugin_name() == MESH_ATTRIBUTE
    ]
    if not takers and scene.loaded is None:
        return
    owners = (entry[2] for entry in mitsuba().traverse(world).properties.values())
    meshes = {id(owner): owner for owner in owners if isinstance(owner, mitsuba().Mesh)}
    for number, shape in enumerate([*world.shapes(), *meshes.values()]):  # and meshes in groups
        for name in ATTRIBUTES_TAKEN.findall(f"{shape.bsdf()} {shape.emitter()}"):
            if shape.has_attribute(name):
                continue
            places = [node for node in takers if node.props.get("name", None) == name]
            where = f", {lines_of(scene, places)}" if places else ""
            keys = [
                key
                for key, _ in mitsuba().traverse(shape)
                if key.startswith(("vertex_", "face_"))
            ]
            own = [key for key in keys if shape.has_attribute(key)]
            has = f"it has {', '.join(own) or 'none'}.{nearest(name, own)}"
            what = f"shape {shape.id() or number!r} has no attribute {name!r}, which its material takes"
            raise InputError(f"scene {scene.name!r}{where}: {what}; {has}")


def refuse_black(band_nm: Range, lost: int, findings: Iterable[Finding]) -> NoReturn:
    """Raise InputError for a black image, with the probable cause.  lost : number of NaN values of single passes."""
    what = f"the scene is black from {band_nm[0]:g} to {band_nm[1]:g} nm"
    remedy = "give it an emitter that lights what the sensor sees, with a spectrum there"
    if lost:
        what = f"{what}: {lost} values of its light were NaN and all others are 0"
        remedy = "check textures and environment maps for NaN, and eta and k of metals for their ends"
    serious = [f"{x.what} ({x.where})" for x in findings if x.is_serious]
    if serious:
        remedy = f"perhaps because {', or because '.join(serious)}; otherwise {remedy}"
    raise InputError(f"{what}; {remedy}.")


def refuse_misspelt(scene: ParsedScene) -> None:
    """Raise InputError for unknown types and parameters of film, filter and sampler, which Mitsuba never reads because
    they are replaced. Old formats may have unknown parameters."""
    mi, versions = (
        mitsuba(),
        [str(version) for version in scene.state.versions],
    )  # of a dict: none
    for node in scene.nodes("Film", "Sampler", "ReconstructionFilter"):
        kind, props = node.props.plugin_name(), node.props
        if kind == FILM or (versions and versions[node.file_index] < "3"):
            continue
        nested = [name for name, _ in scene.children(props)]
        own = {name: props[name] for name in props if name not in nested}
        channel = {"channel": {"type": "d65"}} if kind == "specfilm" else {}  # it needs one
        with scene.mitsuba_errors(f"({scene.where(node)}) "):
            mi.load_dict({"type": kind, **own, **channel})
