"""A plan rejects what a run rejects, with the same sentence; a run makes what a plan accepts."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import tomlkit
from helpers.marks import exhaustive

from mitsuba_sensor import InputError
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.cameras import Folders
from mitsuba_sensor.dataset.checks import Counts, check_scenes, checked_counts
from mitsuba_sensor.dataset.file import dataset_of
from mitsuba_sensor.dataset.plan import DatasetPlan
from mitsuba_sensor.dataset.run import run

Cli = Callable[..., Any]
Place = tuple[str | int, ...]
SCENE = """<scene version="3.0.0"><default name="level" value="2e-4"/>
    <integrator type="direct"/>
    <sensor type="perspective"><float name="fov" value="50"/>
        <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/></film></sensor>
    <emitter type="constant" id="sky"><spectrum name="radiance" value="$level"/></emitter>
    <shape type="sphere" id="ball"><bsdf type="diffuse"><spectrum name="reflectance" value="0.5"/></bsdf></shape>
</scene>"""
KEYS = [
    {"time_s": 0, "origin_m": [0, 0, 4], "target_m": [0, 0, 0]},
    {"time_s": 1, "origin_m": [1, 0, 4], "target_m": [0, 0, 0]},
]
RIGHT: dict[str, Any] = {
    "name": "tiny",
    "seed": 1,
    "outputs": ["raw", "clean", "variance", "preview", "electrons"],
    "render": {"width": 8, "spp": 4},
    "scenes": [
        {
            "name": "still",
            "file": "ball.xml",
            "parameters": {"level": 1e-4},
            "traverse": {"ball.bsdf.reflectance.value": 0.4},
            "scene_unit": "m",
            "integrator": "path",
            "views": [{"origin_m": [0, 0, 4], "target_m": [0, 0, 0], "up": [0, 1, 0]}],
        },
        {
            "name": "moving",
            "file": "ball.xml",
            "path": {"views": 2, "keys": KEYS},
            "motion": {"objects": {"ball": {"velocity_m_per_s": [0.1, 0, 0]}}},
        },
    ],
    "cameras": [
        {"camera": "bayer_2mp", "name": "one", "set": {"adc.bits": 10}, "without": ["prnu"]}
    ],
    "grid": {"exposure_s": [0.01], "frames": [1]},
    "list": [{"temperature_k": 290, "camera.lens.f_number": 2.0}],
    "random": {
        "draws": 2,
        "values": {
            "exposure_ev": {"uniform": [-1, 1]},
            "camera.adc.black_level_dn": {"integer": [60, 70]},
        },
    },
    "splits": {"shares": {"train": 0.5, "test": 0.5}, "by": ["scene", "view"], "chips": 1},
}
ABSURD: tuple[Any, ...] = (
    *(math.nan, math.inf, -math.inf, 1e30, -1e30, 1e-30, 0.5, -1, 0, 1, 3, True),
    *(10**9, 10**40, 2**31, "x", "", "a b", "auto", "0.5", "../x", "/x", "\0", "${x}"),
    *([], [1], ["x", "x"], [math.nan], [[1, 2], [3, 4]], {}, {"x": 1}, {"x": {"y": [1]}}),
)
LONGEST = 700
"""Characters of a sentence, mostly lists of names."""
NEVER: dict[str, tuple[dict[str, Any], str]] = {
    "width of a million": ({"render": {"width": 10**6}}, "from 1 to the film's own 8"),
    "a film beyond the sensor": (
        {"cameras": [{"camera": "bayer_2mp", "set": {"sensor.columns": 4}}]},
        "the film has 8 × 6 pixels, but bayer_2mp has 4 × 1200",
    ),
    **{
        f"[render] {field}": ({"render": {field: 3}}, f"[render] has {field!r}, which {why}")
        for field, why in {
            "max_seconds": "would make other samples on another machine",
            "repeatable": "is always true of a dataset",
            "luminance": "would scale each view by its own median",
            "motion": "belongs to the tables of [[scenes]]",
            "gain": "is varied: gain in [grid]",
            "widht": "is not a field. Did you mean 'width'",
        }.items()
    },
    "a misspelled output": ({"outputs": ["prevew"]}, "Did you mean 'preview'?"),
    "readouts of no camera": ({"outputs": ["readouts"]}, "reads each pixel once"),
    "stops by the thousand": (
        {"grid": {"exposure_ev": [5000]}, "random": None},
        "must be from -60 to 60",
    ),
    "an exposure by name": (
        {"grid": {}, "list": [{"exposure_s": "fast"}]},
        "a number of seconds, e.g.",
    ),
    "a parameter of two numbers": (
        {"grid": {"parameters.level": [[1, 2]]}},
        "must be one text or number",
    ),
    "a table of a table": ({"list": [{"camera": {"adc": {"bits": 12}}}]}, "in quotes"),
    "no frames": (
        {"grid": {"frames": [0]}},
        "frames is 0; it must be a whole number from 1 to 65535",
    ),
    "one field by two names": (
        {"grid": {"f_number": [2], "camera.lens.f_number": [4]}, "list": []},
        "'camera.lens.f_number' twice",
    ),
    "a drawn serial that is no whole number": (
        {"random": {"draws": 1, "values": {"serial": {"uniform": [1, 9]}}}},
        "serial is ",
    ),
    "a camera of nobody": ({"cameras": [{"camera": "bayer2mp"}]}, "Did you mean 'bayer_2mp'?"),
    "half a pupil of a pinhole": (
        {"cameras": [{"camera": "bayer_2mp", "set": {"lens.half_pupil": "left"}}]},
        "half_pupil is 'left'",
    ),
    "parameter of no scene": ({"grid": {"parameters.foo": [1]}}, "has no parameter 'foo'"),
    "too many numbers": (
        {"grid": {"traverse.ball.bsdf.reflectance.value": [[1.0, 2.0]]}},
        "the number of values must be 1",
    ),
    "motion of nothing": (
        {
            "scenes": [
                {
                    **RIGHT["scenes"][1],
                    "motion": {"objects": {"box": {"velocity_m_per_s": [1, 0, 0]}}},
                }
            ]
        },
        "the motion names 'box'",
    ),
    "dual pixels behind a pinhole": (
        {"cameras": [{"camera": "bayer_2mp", "set": {"sensor.dual_pixel": True}}]},
        "the scene's sensor is a pinhole",
    ),
    "a lens that opens less far": (
        {"cameras": [{"camera": "bayer_2mp", "set": {"lens.prescription": "singlet"}}]},
        "lens.f_number is 2; it must be at least 7.98",
    ),
    "frames beyond any memory": (
        {
            "grid": {"frames": [65535]},
            "cameras": [
                {"camera": "bayer_2mp", "set": {"sensor.columns": 16000, "sensor.rows": 12000}}
            ],
            "render": {"spp": 4},
            "scenes": [{"name": "large", "file": "large.xml"}],
        },
        "of memory; take a smaller width or fewer frames",
    ),
    "a picture too small for a DNG": ({"outputs": ["dng"]}, "is too small for a DNG"),
    "light of no group": ({"grid": {"lights.sky": [0.5]}}, 'give light_groups = "auto"'),
    "light of another group": (
        {
            "grid": {"lights.sun": [0.5]},
            "render": {"width": 8, "spp": 4, "light_groups": "auto"},
        },
        "the light groups of the scene are sky",
    ),
    "subframes of nothing": (
        {"render": {"width": 8, "spp": 4, "subframes": 3}},
        "subframes is 3 and nothing moves",
    ),
    "a camera at its target": (
        {
            "scenes": [
                {
                    "name": "path",
                    "file": "ball.xml",
                    "path": {
                        "views": 3,
                        "keys": [KEYS[0], {**KEYS[1], "origin_m": [0, 0, -4]}],
                    },
                }
            ]
        },
        "view 1 on the path of scene 'path' is at [0.0, 0.0, 0.0]",
    ),
    "chips beyond counting": (
        {"splits": {**RIGHT["splits"], "chips": 10**40}},
        "splits.chips is 1",
    ),
}


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    (folder / "ball.xml").write_text(SCENE)
    large = SCENE.replace('"8"', '"16000"').replace('"6"', '"12000"')
    (folder / "large.xml").write_text(large)
    return folder


def places(table: Any, at: Place = ()) -> Iterator[Place]:
    """Yield the place of every value in tables and lists."""
    inner: Any = ()
    if isinstance(table, dict):
        inner = table.items()
    elif isinstance(table, list):
        inner = enumerate(table)
    for name, value in inner:
        yield (*at, name)
        yield from places(value, (*at, name))


def changed(place: Place, *value: Any) -> dict[str, Any]:
    """Return the right tables with another value at a place, or without it."""
    tables = copy.deepcopy(RIGHT)
    inner: Any = tables
    for name in place[:-1]:
        inner = inner[name]
    if value:
        inner[place[-1]] = value[0]
    else:
        del inner[place[-1]]
    return tables


def plan_of(tables: dict[str, Any], scenes: Path) -> DatasetPlan:
    dataset = dataset_of(copy.deepcopy(tables), "the tables")
    return DatasetPlan(dataset, Folders([scenes]), tomlkit.dumps(tables))


def counts_of(plan: DatasetPlan) -> Counts:
    """Count as `dataset plan` does."""
    counts = checked_counts(plan)
    check_scenes(plan)
    return counts


def refusal(ask: Callable[[], object]) -> str:
    """Return the sentence of an error, or an empty text."""
    try:
        ask()
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("seed", "files"), [(0, 15), *(exhaustive(seed, 100) for seed in (1, 2, 3))]
)
def test_whatever_a_field_is_a_plan_and_a_run_refuse_it_with_one_sentence(
    seed: int, files: int, scenes: Path, tmp_path: Path
) -> None:
    """Each of 315 files lacks one of 80 fields, or has one of 32 absurd values there."""
    chance, refused, out = random.Random(seed), 0, tmp_path / "out"
    for _ in range(files):
        place = chance.choice([*places(RIGHT)])
        tables = changed(place, *chance.choice([(), *((one,) for one in ABSURD)]))
        said = refusal(lambda tables=tables: counts_of(plan_of(tables, scenes)))
        if not said:
            continue
        refused += 1
        assert len(said) < LONGEST and said[-1] in ".?" and "\n" not in said, said
        again = refusal(lambda tables=tables: run(plan_of(tables, scenes), out, workers=0))
        assert again == said and not out.exists()
    assert refused > 0.6 * files


@pytest.mark.exhaustive
def test_what_a_plan_lets_pass_a_run_makes(scenes: Path, tmp_path: Path) -> None:
    chance, made = random.Random(7), 0
    while made < 6:
        place = chance.choice([*places(RIGHT)])
        tables = changed(place, chance.choice(ABSURD))
        if refusal(lambda tables=tables: counts_of(plan_of(tables, scenes))):
            continue
        if "level" in place or counts_of(plan_of(tables, scenes)).samples > 10:
            continue  # without light, which only a render finds; too many
        made += 1
        found = run(plan_of(tables, scenes), tmp_path / str(made), workers=0, progress=False)
        assert not found.failed, (place, found.failed)


@pytest.mark.parametrize("name", NEVER)
def test_what_can_never_be_made_is_refused_by_plan_and_run(
    name: str, scenes: Path, tmp_path: Path
) -> None:
    changes, sentence = NEVER[name]
    tables, out = RIGHT | changes, tmp_path / "out"
    if "scenes" in changes or "serial" in str(changes):
        del tables["splits"]  # of which one scene has none
    said = refusal(lambda: counts_of(plan_of(tables, scenes)))
    assert sentence in said, said
    assert refusal(lambda: run(plan_of(tables, scenes), out, workers=0)) == said
    assert not out.exists()


def test_the_command_line_refuses_in_one_line(
    scenes: Path, cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wrong.toml").write_text(
        'name = "wrong"\nscenes = [{ name = "ball", file = "ball.xml", traverse = { "a.b" = nan } }]\n'
        'cameras = [{ camera = "bayer_2mp" }]\n'
    )
    monkeypatch.chdir(scenes)
    for command in (("plan",), ("plan", "--count-only"), ("run", "-o", tmp_path / "out")):
        done = cli("dataset", *command, tmp_path / "wrong.toml")
        assert done.exit_code == 2 and done.stderr.count("\n") == 1 and not done.stdout
        assert "wrong.toml': scenes.0.traverse.a.b" in done.stderr and "finite" in done.stderr
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError):
        make_dataset(tmp_path / "wrong.toml", tmp_path / "out")
