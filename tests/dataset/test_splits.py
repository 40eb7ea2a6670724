"""Splits share neither a scene nor a chip, whatever is varied."""

from __future__ import annotations

import random
from typing import Any

import pytest
from helpers.datasets import TABLES, plan_of, samples_of, tasks_of
from helpers.marks import exhaustive

from mitsuba_sensor import InputError
from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.dataset.plan import DatasetPlan


def sets_of(plan: DatasetPlan) -> dict[str, tuple[set[Any], set[Any]]]:
    """Split → its scenes, as the file tells them apart, and its chips."""
    assert plan.file.splits is not None
    found: dict[str, tuple[set[Any], set[Any]]] = {}
    for task in plan.tasks():
        for sample in task.samples:
            scenes, chips = found.setdefault(sample.split, (set(), set()))
            scenes.add(tuple(str(sample.values.get(name)) for name in plan.file.splits.by))
            chips.add((sample.config["camera"]["name"], sample.config["serial"]))
    return found


def scenes_of(names: list[str]) -> list[dict[str, Any]]:
    """Scenes that differ."""
    return [
        {"name": name, "file": "flat_field.xml", "parameters": {"exposure_s": number + 1}}
        for number, name in enumerate(names)
    ]


def random_tables(rng: random.Random) -> dict[str, Any]:
    names = [f"s{k}" for k in range(rng.randint(1, 5))]
    splits = [["train", "test"], ["train", "val", "test"], ["all"]][rng.randrange(3)]
    parts = [rng.uniform(0.1, 1) for _ in splits]
    tables: dict[str, Any] = {
        **TABLES,
        "seed": rng.randrange(1000),
        "scenes": scenes_of(names),
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
        tables["random"] = {
            "draws": rng.randint(1, 6),
            "values": {"parameters.radiance": {"log_uniform": [1e-4, 1e-3]}},
        }
        tables["splits"]["by"] = ["scene", "parameters.radiance"]
    chips = rng.randrange(3)
    if chips == 1:
        tables["splits"]["chips"] = rng.randint(1, 3)
    if chips == 2:
        tables["grid"]["serial"] = list(range(5, 5 + rng.randint(1, 6)))
    return tables


@pytest.mark.parametrize(("datasets", "fewest_refused"), [(40, 2), exhaustive(160, 16)])
def test_no_two_splits_share_a_scene_or_a_chip(datasets: int, fewest_refused: int) -> None:
    """Random datasets; those with too few scenes or chips are refused in a sentence that says what to do."""
    rng, made, refused = random.Random(17), 0, 0
    for _ in range(datasets):
        plan_tables = random_tables(rng)
        try:
            plan = plan_of(**plan_tables)
            found = sets_of(plan)
        except InputError as error:
            assert (
                "for" in str(error)
                and "splits" in str(error)
                and ("by" in str(error) or "serial" in str(error))
            )
            refused += 1
            continue
        for number, (scenes, chips) in enumerate(found.values()):
            for others in list(found.values())[number + 1 :]:
                assert not scenes & others[0] and not chips & others[1]
        made += 1
    assert made > datasets / 3.2 and refused >= fewest_refused


@pytest.mark.parametrize("scenes", [10, 40])
def test_the_shares_are_those_asked_for(scenes: int) -> None:
    tables = {
        **TABLES,
        "scenes": scenes_of([f"s{k}" for k in range(scenes)]),
        "splits": {"shares": {"train": 0.7, "val": 0.1, "test": 0.2}, "chips": 2},
    }
    plan = plan_of(**tables)
    sizes = {split: len(own) for split, (own, _) in sets_of(plan).items()}
    assert all(
        abs(sizes[name] - share * scenes) <= 1
        for name, share in tables["splits"]["shares"].items()
    )
    assert len(samples_of([*plan.tasks()])) == 2 * scenes


def test_splits_need_something_to_share_out() -> None:
    shares = {"train": 0.5, "test": 0.5}
    with pytest.raises(InputError, match=r"1 scenes for 2 splits .*deals out the poses"):
        tasks_of(splits={"shares": shares})
    with pytest.raises(InputError, match=r"by has 'pose'; give scene, view, parameters\.NAME"):
        read_dataset({**TABLES, "splits": {"shares": shares, "by": ["pose"]}})
    with pytest.raises(InputError, match="chips is given and serial is varied"):
        read_dataset(
            {**TABLES, "grid": {"serial": [1]}, "splits": {"shares": shares, "chips": 1}}
        )


KEYS = [
    {"time_s": time_s, "origin_m": [time_s, 0, 2], "target_m": [0, 0, 0]} for time_s in (0, 1)
]


def path_tables(views: int, block: int | None, **shares: float) -> dict[str, Any]:
    """A scene on a path, whose poses are dealt out."""
    splits = {"shares": shares, "by": ["scene", "view"], **({"block": block} if block else {})}
    scene = {**TABLES["scenes"][0], "path": {"views": views, "keys": KEYS}}
    return {**TABLES, "scenes": [scene], "splits": splits}


@pytest.mark.parametrize("views", [60, 64])
def test_neighbouring_poses_of_a_block_are_in_one_split(views: int) -> None:
    """So 12 or 13 blocks are dealt out, by the shares; the seed decides which."""
    dealt = list[list[str]]()
    for seed in (1, 2):
        tables = {**path_tables(views, 5, train=0.7, val=0.15, test=0.15), "seed": seed}
        plan = plan_of(**tables)
        samples = samples_of([*plan.tasks()])
        split_of = {one.values["view"]: one.split for one in samples}
        blocks = [
            [split_of[k] for k in range(views)[first : first + 5]]
            for first in range(0, views, 5)
        ]
        assert all(len({*block}) == 1 for block in blocks)
        firsts = [block[0] for block in blocks]
        for name, share in plan.file.splits.shares.items():  # type: ignore[union-attr]
            assert abs(firsts.count(name) - share * len(blocks)) <= 1
        assert len(samples) == views
        dealt.append(firsts)
    assert dealt[0] != dealt[1], "chance would have it once in 3000 pairs of seeds"


def test_blocks_of_one_pose_are_poses_at_random() -> None:
    def splits(block: int | None) -> list[str]:
        plan = plan_of(**path_tables(20, block, train=0.5, test=0.5))
        return [task.samples[0].split for task in plan.tasks()]

    assert splits(1) == splits(None) and splits(1) != splits(4)


def test_a_block_needs_poses_that_are_dealt_out() -> None:
    shares = {"train": 0.5, "test": 0.5}
    with pytest.raises(InputError, match=r'block is 5, .* give by = \["scene", "view"\]'):
        read_dataset({**TABLES, "splits": {"shares": shares, "block": 5}})
    with pytest.raises(InputError, match=r"1 scenes for 2 splits .* a smaller block"):
        tasks_of(**path_tables(20, 20, **shares))


def test_poses_of_one_scene_are_dealt_out_to_splits() -> None:
    """By the shares; a pose is in one split with all its exposures, and its number is that in the file."""
    keys = [
        {"time_s": time_s, "origin_m": [time_s, 0, 2], "target_m": [0, 0, 0]}
        for time_s in (0, 1)
    ]
    tables = {
        **TABLES,
        "scenes": [{**TABLES["scenes"][0], "path": {"views": 11, "keys": keys}}],
        "grid": {"exposure_s": [0.1, 0.2]},
        "splits": {"shares": {"train": 0.8, "test": 0.2}, "by": ["scene", "view"]},
    }
    plan = plan_of(**tables)
    sizes = {split: len(scenes) for split, (scenes, _) in sets_of(plan).items()}
    assert sizes == {"train": 9, "test": 2}
    samples = samples_of([*plan.tasks()])
    assert [one.values["view"] for one in samples] == [k for k in range(11) for _ in range(2)]
    assert [one.values["pose"]["origin_m"][0] for one in samples[::2]] == [
        pytest.approx(k / 10) for k in range(11)
    ]
    for first, second in zip(samples[::2], samples[1::2], strict=True):
        assert first.split == second.split
