"""Which plugins there are: files of Mitsuba, those that Python registers, and our own; and of which kind each is."""

from __future__ import annotations

from pathlib import Path

from ...core import nearest
from ..variants import MitsubaObject, mitsuba

OWN_PLUGINS = ("camera", "photosensor", "raw_frame")
SHARED = ("__init__", "common")  # modules of the folder of gradient integrators that are none


def plugin_names() -> list[str]:
    """Names of the plugins of Mitsuba and of our own."""
    native = (file.stem for file in (_own_folder() / "plugins").iterdir())
    return sorted({*OWN_PLUGINS, *native, *gradient_integrators()})


def gradient_integrators() -> list[str]:
    """Names of the integrators that compute gradients, each a module of Mitsuba's in Python. Scalar variants do not
    register them."""
    modules = (file.stem for file in (_own_folder() / "python" / "ad" / "integrators").glob("*.py"))
    return sorted(name for name in modules if name not in SHARED)


def remedy_for_unknown(kind: str) -> str:
    """What to write instead of a type that no plugin of this variant has, from the full stop or semicolon on."""
    if kind in gradient_integrators():
        return "; it computes gradients and needs an llvm or cuda variant: 'path' gives the same image."
    return f".{nearest(kind, plugin_names())}"


def _own_folder() -> Path:
    return Path(str(mitsuba().__file__)).parent


def type_of_plugin(props: MitsubaObject) -> MitsubaObject:
    """The ObjectType of a plugin that Python registered, which only an object of it can tell; None if no plugin has
    this name, ObjectType.Unknown where it cannot be built without the elements inside it.

    props : of a node of a scene without foreign code.
    """
    mi = mitsuba()
    nested = mi.Properties.Type.ResolvedReference
    own = {name: props[name] for name in props if props.type(name) != nested}
    kind = props.plugin_name()
    try:
        plugin = mi.load_dict({"type": kind, **own})
    except RuntimeError as error:
        return None if f'Plugin "{kind}" not found' in str(error) else mi.ObjectType.Unknown
    for kind_of_node in mi.ObjectType:
        if isinstance(plugin, getattr(mi, kind_of_node.name, ())):
            return kind_of_node
    return mi.ObjectType.Unknown
