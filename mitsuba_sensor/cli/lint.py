"""The command lint: what in a scene is black, wrong or surprising for a camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ..render.options import SceneOptions
from . import options
from .app import app, render_input, show

if TYPE_CHECKING:
    from ..render.lint import Finding
    from ..sensor.camera import Camera

STYLES = {"black": "bold red", "wrong": "bold yellow", "note": "dim"}


@app.command(epilog="Example: mitsuba-sensor lint scenes/cornell_box.xml --camera rgbir_2mp")
@options.flags(
    options.CameraFlags, SceneOptions, without=("exposure_s", "temperature_k", "settings", "width", "motion")
)
def lint(scene: options.Scene, as_json: options.Json = False, **flags: options.Flag) -> None:
    """Say what in SCENE is black, wrong or worth knowing for this camera. Nothing is rendered.

    Exit code: 0 if there is nothing but notes, 1 if something is black or wrong, 2 if the scene cannot be loaded.
    """
    from ..render.scene import inspect_scene

    given, _ = render_input(scene, flags)
    chosen, parameters = given.camera, flags["parameters"] or {}
    findings = inspect_scene(given.scene.file, chosen, parameters, flags["scene_unit"])
    show([finding.to_dict() for finding in findings] if as_json else _table(findings, scene.name, chosen), as_json)
    if any(finding.level != "note" for finding in findings):
        raise typer.Exit(1)


def _table(findings: Sequence[Finding], scene: str, camera: Camera) -> RenderableType:
    """One row per finding, the gravest first."""
    low, high = camera.band_nm
    head = Text.assemble((scene, "bold"), f" for {camera.name}, {low:g} to {high:g} nm")
    if not findings:
        return Group(head, Text("nothing to say", style="green"))
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in ("", "where", "what", "remedy"):
        table.add_column(heading, overflow="fold")
    for finding in findings:
        level = Text(finding.level, style=STYLES[finding.level])
        table.add_row(level, Text(finding.where), Text(finding.what), Text(finding.remedy))
    return Group(head, table)
