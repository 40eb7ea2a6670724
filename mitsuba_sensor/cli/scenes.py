"""The commands below scenes: the scenes that ship with the package."""

from __future__ import annotations

import typer

from ..core.id_groups import as_options, groups_of_ids
from . import arguments
from .app import app, show, show_remarks
from .help import Command, Group

scenes = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="The scenes that ship with the package, for `render NAME` and wherever a command takes a scene.",
)
app.add_typer(scenes, name="scenes")


@scenes.command("list", cls=Command)
def list_command(as_json: arguments.Json = False) -> None:
    """The scenes that ship with the package."""
    from ..files.shipped_scenes import list_scenes, scene_description

    show(
        [{"name": name, "description": scene_description(name)} for name in list_scenes()],
        as_json,
    )


@scenes.command("show", cls=Command, epilog="Example: mitsuba-sensor scenes show still_life")
def show_scene(name: arguments.SceneName, as_json: arguments.Json = False) -> None:
    """What can be set in one scene by `-D NAME=VALUE`, its sensors, its emitters, and where its file is."""
    from ..files import shipped_scenes

    emitters = shipped_scenes.scene_emitters(name)
    found = {
        "name": name,
        "description": shipped_scenes.scene_description(name),
        "file": str(shipped_scenes.scene_file(name)),
        "sensors": shipped_scenes.scene_sensors(name),
        "emitters": [one._asdict() for one in emitters],
        "parameters": [one._asdict() for one in shipped_scenes.scene_parameters(name)],
    }
    show(found, as_json)
    ids = dict.fromkeys(emitter.id for emitter in emitters if emitter.id)
    if len(ids) > 1:
        groups = as_options(groups_of_ids(ids))
        show_remarks(as_json, [f"groups, as the ids suggest: {groups}"])


@scenes.command(
    "copy", cls=Command, epilog="Example: mitsuba-sensor scenes copy still_life my_scene/"
)
def copy_command(
    name: arguments.SceneName, folder: arguments.CopyFolder, force: arguments.Force = False
) -> None:
    """Copy one scene, with all files that it reads, into a folder, to change it there."""
    from ..files.scene_copies import copy_scene

    copied = copy_scene(name, folder, force)
    show("\n".join(f"wrote {file}" for file in copied), False)
    show(f"Change it, then: mitsuba-sensor render {copied[0]} -o out/", False)
