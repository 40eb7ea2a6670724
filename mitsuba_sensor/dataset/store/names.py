"""Names of the folders of samples and views: scene/pose/settings, by the settings of the sample alone.

What else varies in the dataset changes no name. What no setting says is in the hashes of the files: scene, camera and
options of the render. So an edited dataset file may make other samples of the same settings; their folders get a piece
of the key at the end (store.py).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache

PARTS = 3
"""Folders of a name."""
PIECE = 12
"""Digits of a key, at the end of a name that needs them."""
LONGEST = 120
"""Characters of the settings in a name; file systems have 255 for a folder, with all that is added."""
FIRST, LAST = (
    ("sensor", "exposure_s", "exposure_ev"),
    ("frames", "repetition", "draw", "serial"),
)
"""Settings that stand before and behind all others, which are in alphabetical order."""
NEUTRAL = {"exposure_ev": 0, "frames": 1, "repetition": 0}
"""Settings that are left out where they have the value of a sample for which nothing is said."""
NOT_SETTINGS = ("scene", "camera", "view", "time_s", "pose")
MOST_TEXTS = 10_000
"""Of settings, whose form in a name is known: the same few stand in all names of a dataset."""
_PART = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.,=+-]{0,199}")
_UNSAFE = re.compile(r"[^A-Za-z0-9_.+-]|\.$")
_FIRST_UNSAFE = re.compile(r"^[.+-]")


def is_name_of_entry(name: object) -> bool:
    """Whether a sample or view may be called so: three folders, none hidden."""
    if not isinstance(name, str):
        return False
    parts = name.split("/")
    return len(parts) == PARTS and all(map(is_part, parts))


def is_part(name: str) -> bool:
    """Whether a scene, a pose or the folder of an entry may be called so."""
    return _PART.fullmatch(name) is not None


def name_of_sample(values: Mapping[str, object], camera: str, draw: int, key: str) -> str:
    """``scene/view_0003/camera,exposure_s=0.01,serial=1``: the name of a sample.

    values : all that the dataset says of it.  camera : its entry.  draw : number of the random draw, −1 for none.
    A piece of the key is at the end where the settings are too long, or hold what is no name of a folder.
    """
    settings = {name: x for name, x in values.items() if name not in NOT_SETTINGS}
    if draw >= 0:
        settings["draw"] = draw
    whole = camera.removesuffix(".toml")
    safe = _FIRST_UNSAFE.sub("_", _UNSAFE.sub("_", whole))
    for name in sorted(settings, key=_place):
        if settings[name] != NEUTRAL.get(name):
            text = text_of_setting(settings[name])
            whole += f",{name}={text}"
            safe += f",{_without_unsafe(name)}={_without_unsafe(text)}"
    if safe != whole or len(safe) > LONGEST:
        safe = with_piece(safe[:LONGEST], key)
    return f"{_pose_of(values)}/{safe}"


@lru_cache(MOST_TEXTS)
def _without_unsafe(text: str) -> str:
    """A name or a value of a setting, as a folder may have it."""
    return _UNSAFE.sub("_", text)


def name_of_view(values: Mapping[str, object], key: str) -> str:
    """``scene/view_0003/KEY``: the name of a light.  values : of any of its samples."""
    return f"{_pose_of(values)}/{key}"


def with_piece(name: str, key: str) -> str:
    """The name with a piece of the key at its end."""
    return f"{name},{key[:PIECE]}"


def text_of_setting(value: object) -> str:
    """A value as it stands in a name: equal numbers have equal texts."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "_".join(map(text_of_setting, value))
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return str(value)


def _pose_of(values: Mapping[str, object]) -> str:
    """Scene and pose; that of the scene file has number 0."""
    return f"{values['scene']}/view_{values.get('view', 0):04d}"


def _place(name: str) -> tuple[int, int, str]:
    """Where a setting stands in a name, for sorting."""
    if name in FIRST:
        return 0, FIRST.index(name), ""
    if name in LAST:
        return 2, LAST.index(name), ""
    return 1, 0, name
