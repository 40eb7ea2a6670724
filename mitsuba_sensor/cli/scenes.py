"""The commands below scenes: the scenes that ship with the package."""

from __future__ import annotations

import typer
from rich.text import Text

from ..core.id_groups import as_options, groups_of_ids
from . import arguments
from .app import app, show
from .help import Command, Group
from .tables import ResultTable

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

    described = {name: scene_description(name) for name in list_scenes()}
    table = ResultTable(("scene", "what it is"))
    for name, description in described.items():
        table.add_row(name, description)
    listed = [{"name": name, "description": text} for name, text in described.items()]
    show(listed if as_json else table, as_json)


@scenes.command("show", cls=Command, epilog="Example: mitsuba-sensor scenes show still_life")
def show_scene(name: arguments.SceneName, as_json: arguments.Json = False) -> None:
    """What can be set in one scene by `-D NAME=VALUE`, its sensors, its emitters, and where its file is."""
    from ..files.shipped_scenes import (
        scene_description,
        scene_emitters,
        scene_file,
        scene_parameters,
        scene_sensors,
    )

    file, description = scene_file(name), scene_description(name)
    parameters, sensors = scene_parameters(name), scene_sensors(name)
    emitters = scene_emitters(name)
    if as_json:
        facts = {
            "name": name,
            "description": description,
            "file": str(file),
            "sensors": sensors,
            "emitters": [one._asdict() for one in emitters],
        }
        return show({**facts, "parameters": [one._asdict() for one in parameters]}, True)
    table = ResultTable(("-D", "default", "meaning"))
    for one in parameters:
        table.add_row(one.name, Text(one.value), Text(one.meaning))
    lamps = ResultTable(("emitter id", "type"), caption="ids are for --light-groups")
    for emitter in emitters:
        lamps.add_row(emitter.id or "–", emitter.type)
    show(f"{description}\n{file}\nsensors: {', '.join(sensors)}", False)
    show(table, False)
    show(lamps, False)
    ids = [emitter.id for emitter in emitters if emitter.id]
    if len(ids) > 1:
        show(
            f"groups, as the ids suggest: {as_options(groups_of_ids(dict.fromkeys(ids)))}",
            False,
        )


@scenes.command(
    "copy", cls=Command, epilog="Example: mitsuba-sensor scenes copy still_life my_scene/"
)
def copy_command(
    name: arguments.SceneName, folder: arguments.CopyFolder, force: arguments.Force = False
) -> None:
    """Copy one scene, with all files that it reads, into a folder, to change it there."""
    from ..files.scene_copies import copy_scene

    copied = copy_scene(name, folder, force)
    for file in copied:
        show(f"wrote {file}", False)
    show(f"Change it, then: mitsuba-sensor render {copied[0]} -o out/", False)
