"""Splits share neither a scene nor a sensor unit, whatever varies."""

from __future__ import annotations

import random
from typing import Any

import pytest
from helpers.datasets import TABLES, plan_of, samples_of
from helpers.marks import exhaustive

from mitsuba_sensor import InputError
from mitsuba_sensor.dataset.checks import checked_counts
from mitsuba_sensor.dataset.plan import DatasetPlan

HALVES = {"train": 0.5, "test": 0.5}
KEYS = [
    {"time_s": time_s, "origin_m": [time_s, 0, 2], "target_m": [0, 0, 0]} for time_s in (0, 1)
]


def sets_of(plan: DatasetPlan) -> dict[str, tuple[set[Any], set[Any]]]:
    """Return split → its scenes, as the file distinguishes them, and its sensor units."""
    assert plan.file.splits is not None
    found: dict[str, tuple[set[Any], set[Any]]] = {}
    for task in plan.tasks():
        for sample in task.samples:
            scenes, chips = found.setdefault(sample.split, (set(), set()))
            scenes.add(tuple(str(sample.values.get(name)) for name in plan.file.splits.by))
            chips.add((sample.config["camera"]["name"], sample.config["serial"]))
    return found


def scenes_of(number: int) -> list[dict[str, Any]]:
    """Return different scenes."""
    return [
        {"name": f"s{k}", "file": "flat_field.xml", "parameters": {"exposure_s": k + 1}}
        for k in range(number)
    ]


def random_tables(rng: random.Random) -> dict[str, Any]:
    scenes = scenes_of(rng.randint(1, 5))
    splits = [["train", "test"], ["train", "val", "test"], ["all"]][rng.randrange(3)]
    parts = [rng.uniform(0.1, 1) for _ in splits]
    tables: dict[str, Any] = {
        "seed": rng.randrange(1000),
        "scenes": scenes,
        "cameras": [
            [{"camera": "konnik_table1"}],
            [{"camera": "konnik_table1"}, {"camera": "bayer_2mp"}],
        ][rng.randrange(2)],
        "grid": {"exposure_s": [0.1, 0.2]},
        "splits": {
            "shares": dict(zip(splits, (part / sum(parts) for part in parts), strict=True))
        },
    }
    if rng.random() < 0.5:
        law = {"parameters.radiance": {"log_uniform": [1e-4, 1e-3]}}
        tables["random"] = {"draws": rng.randint(1, 6), "values": law}
        tables["splits"]["by"] = ["scene", "parameters.radiance"]
    chips = rng.randrange(3)
    if chips == 1:
        tables["splits"]["chips"] = rng.randint(1, 3)
    if chips == 2:
        tables["grid"]["serial"] = list(range(5, 5 + rng.randint(1, 6)))
    return tables


@pytest.mark.parametrize(("datasets", "fewest_refused"), [(40, 2), exhaustive(160, 16)])
def test_no_two_splits_share_a_scene_or_a_chip(datasets: int, fewest_refused: int) -> None:
    """Random datasets; too few scenes or sensor units are rejected with a remedy."""
    rng, made, refused = random.Random(17), 0, 0
    for _ in range(datasets):
        tables = random_tables(rng)
        try:
            found = [*sets_of(plan_of(**tables)).values()]
        except InputError as error:
            assert "splits" in str(error) and ("by" in str(error) or "serial" in str(error))
            refused += 1
            continue
        for number, (scenes, chips) in enumerate(found):
            for others in found[number + 1 :]:
                assert not scenes & others[0] and not chips & others[1]
        made += 1
    assert made > datasets / 3.2 and refused >= fewest_refused


@pytest.mark.parametrize("scenes", [10, 40])
def test_the_shares_are_those_asked_for(scenes: int) -> None:
    shares = {"train": 0.7, "val": 0.1, "test": 0.2}
    plan = plan_of(scenes=scenes_of(scenes), splits={"shares": shares, "chips": 2})
    sizes = {split: len(own) for split, (own, _) in sets_of(plan).items()}
    assert all(abs(sizes[name] - share * scenes) <= 1 for name, share in shares.items())
    assert len(samples_of([*plan.tasks()])) == 2 * scenes


def path_tables(views: int, block: int | None, **shares: float) -> dict[str, Any]:
    """Return a scene whose poses on a path are distributed to splits."""
    splits = {"shares": shares, "by": ["scene", "view"], **({"block": block} if block else {})}
    scene = {**TABLES["scenes"][0], "path": {"views": views, "keys": KEYS}}
    return {"scenes": [scene], "splits": splits, "grid": {"exposure_s": [0.1, 0.2]}}


@pytest.mark.parametrize(("views", "block"), [(60, 5), (64, 5), (55, 1), (55, None)])
def test_poses_are_dealt_out_in_blocks_of_neighbours(views: int, block: int | None) -> None:
    """The seed chooses blocks by the fractions. A pose is in one split with its exposures, number and place."""
    dealt, size = list[list[str]](), block or 1
    for seed in (1, 2):
        tables = {**path_tables(views, block, train=0.7, val=0.15, test=0.15), "seed": seed}
        plan = plan_of(**tables)
        samples = samples_of([*plan.tasks()])
        assert [one.values["view"] for one in samples] == [
            k for k in range(views) for _ in "12"
        ]
        for one in samples:
            place = one.values["view"] / (views - 1)
            assert one.values["pose"]["origin_m"][0] == pytest.approx(place, abs=1e-6)
        splits = [one.split for one in samples]
        blocks = [{*splits[k : k + 2 * size]} for k in range(0, 2 * views, 2 * size)]
        assert all(len(one) == 1 for one in blocks)
        firsts = splits[:: 2 * size]
        for name, share in plan.file.splits.shares.items():  # type: ignore[union-attr]
            assert abs(firsts.count(name) - share * len(blocks)) <= 1
        dealt.append(firsts)
    assert dealt[0] != dealt[1], "chance would have it once in 3000 pairs of seeds"


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"splits": {"shares": HALVES}}, r"at least 2 scenes, .* distributes the poses"),
        ({"splits": {"shares": HALVES, "by": ["pose"]}}, r"by has 'pose'; give scene, view"),
        (
            {"grid": {"serial": [1]}, "splits": {"shares": HALVES, "chips": 1}},
            "chips is given and serial varies",
        ),
        (
            {"splits": {"shares": HALVES, "block": 5}},
            r'block is 5 poses, .* by = \["scene", "view"\]',
        ),
        (path_tables(20, 20, **HALVES), r"at least 2 scenes, .* a smaller block"),
    ],
)
def test_splits_need_something_to_share_out(tables: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        [*plan_of(**tables).tasks()]


@pytest.mark.parametrize(("serials", "left_out"), [([1, 2, 3, 4], 8), (None, 0)])
def test_combinations_that_no_split_has_are_counted(
    serials: list[int] | None, left_out: int
) -> None:
    """Two scenes and two exposures: a scene meets half of the four sensor units."""
    splits = {"shares": HALVES, **({} if serials else {"chips": 2})}
    grid: dict[str, Any] = {
        "exposure_s": [0.1, 0.2],
        **({"serial": serials} if serials else {}),
    }
    counts = checked_counts(plan_of(scenes=scenes_of(2), splits=splits, grid=grid))
    assert (counts.samples, counts.left_out) == (8, left_out)
    assert [f"{left_out} of 16 combinations" in note for note in counts.notes()] == [
        True
    ] * bool(left_out)


def test_a_row_without_a_serial_number_is_of_chip_one() -> None:
    rows = [{"serial": 1}, {"serial": 2}, {"temperature_k": 300}]
    plan = plan_of(scenes=scenes_of(2), splits={"shares": HALVES}, list=rows)
    (_, first), (_, second) = sets_of(plan).values()
    assert not first & second and len(samples_of([*plan.tasks()])) == 3
