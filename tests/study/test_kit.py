"""The kit of the studies: steps are measured once, and it tells how much is done."""

from __future__ import annotations

from collections.abc import Callable

from mitsuba_sensor.study.kit import Kit, Step


class Clock:
    """A clock of the test's own, which a step moves by the seconds that it takes."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s

    def step(self, key: str, expected_s: float, seconds: float) -> Step:
        return Step(key, expected_s, self.taking(seconds))

    def taking(self, seconds: float) -> Callable[[], float]:
        def measure() -> float:
            self.now_s += seconds
            return seconds

        return measure


def test_a_step_is_measured_once() -> None:
    kit, calls = Kit(), list[int]()
    for _ in range(2):
        kit.take([Step("one", 1.0, lambda: calls.append(1) or 7)])
    assert calls == [1] and kit["one"] == 7 and kit.new == 1


def test_the_share_that_is_done_counts_steps_by_their_seconds_those_of_later_too() -> None:
    """Of 10 s: 1 s, 4 s, and 5 s that follow; what is known already is no part of it."""
    told = list[tuple[str, float]]()
    kit = Kit({"known": (0, 9.0)}, lambda *said: told.append(said))
    first = [Step("known", 99.0, int), Step("a", 1.0, int), Step("b", 4.0, int)]
    later = [Step("c", 5.0, int)]
    kit.take(first, later)
    kit.take(later)
    assert told == [("a", 0.0), ("b", 0.1), ("done", 0.5), ("c", 0.5), ("done", 1.0)]


def test_the_longest_step_is_named_with_its_seconds() -> None:
    clock = Clock()
    kit = Kit(clock=clock)
    assert kit.longest_step == ""
    kit.take([clock.step("short", 1.0, 1.0), clock.step("long", 1.0, 9.0)])
    assert kit.longest_step == "long (9.0 s)" and kit.seconds == 10.0
