"""The kit of the studies: steps are measured once, and forecasts follow the times that were measured."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mitsuba_sensor.study.kit import Forecast, Kit, Step


class Clock:
    """A clock of the test's own, which a step moves by the seconds that it takes."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s

    def step(self, key: str, expected_s: float, seconds: float, kind: str = "") -> Step:
        return Step(key, expected_s, self.taking(seconds), kind)

    def taking(self, seconds: float) -> Callable[[], float]:
        def measure() -> float:
            self.now_s += seconds
            return seconds

        return measure


def forecasts(*steps: tuple[str, float, float, str]) -> list[Forecast]:
    """What a kit says before each of these steps (name, expected and true seconds, kind), and at the end."""
    clock, told = Clock(), list[Forecast]()
    Kit(progress=told.append, clock=clock).take([clock.step(*step) for step in steps])
    return told


def test_a_step_is_measured_once() -> None:
    kit, calls = Kit(), list[int]()
    for _ in range(2):
        kit.take([Step("one", 1.0, lambda: calls.append(1) or 7)])
    assert calls == [1] and kit["one"] == 7 and kit.new == 1


@pytest.mark.parametrize("busy", [1.0, 8.0])
def test_after_one_step_of_each_kind_the_forecast_is_that_of_this_machine(busy: float) -> None:
    """Frames take twice what was expected, moments half, on a machine of any load."""
    steps = [("f1", 1.0, 2.0 * busy, "frames"), ("m1", 4.0, 2.0 * busy, "moments")]
    steps += [(f"f{k}", 3.0, 6.0 * busy, "frames") for k in range(2, 5)]
    steps += [(f"m{k}", 2.0, 1.0 * busy, "moments") for k in range(2, 5)]
    told = forecasts(*steps)
    true_s = sum(seconds for _, _, seconds, _ in steps)
    assert [one.total_s for one in told[2:]] == pytest.approx([true_s] * (len(told) - 2))
    assert told[0].total_s == sum(expected_s for _, expected_s, _, _ in steps)


@pytest.mark.parametrize(("seconds", "total_s"), [(10.0, 30.0), (0.1, 2.1)])
def test_a_kind_that_was_not_measured_yet_takes_as_it_says_or_as_much_longer_as_steps_so_far(
    seconds: float, total_s: float
) -> None:
    """Steps of 1 s and 2 s; the first one takes 10 s, or nearly nothing, which says little of the second one."""
    told = forecasts(("a", 1.0, seconds, "a"), ("b", 2.0, 20.0, "b"))
    assert told[1].total_s == pytest.approx(total_s)


def test_the_forecast_names_what_takes_the_time() -> None:
    told = forecasts(
        ("a1", 1.0, 1.0, "frames"),
        ("b1", 1.0, 50.0, "a million samples"),
        ("a2", 1.0, 1.0, "frames"),
    )
    assert (
        told[2].longest == "a million samples"
        and told[2].longest_s == 50.0
        and told[2].now == "a2"
    )


def test_steps_that_come_later_are_in_the_forecast() -> None:
    clock, told = Clock(), list[Forecast]()
    kit = Kit(progress=told.append, clock=clock)
    later = [clock.step("later", 10.0, 20.0, "a")]
    kit.take([clock.step("first", 1.0, 2.0, "a")], later)
    assert told[-1].total_s == pytest.approx(22.0)


def test_the_longest_step_is_named_with_its_seconds() -> None:
    clock = Clock()
    kit = Kit(clock=clock)
    assert kit.longest_step == ""
    kit.take([clock.step("short", 1.0, 1.0), clock.step("long", 1.0, 9.0)])
    assert kit.longest_step == "long (9.0 s)" and kit.seconds == 10.0
