"""Who has claimed something is waited for while it lives, and no longer."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.waiting import wait_until

from mitsuba_sensor.core import InputError
from mitsuba_sensor.files import claims
from mitsuba_sensor.files.claims import claimed, wait_for_claim
from mitsuba_sensor.files.worker_log import BEGUN


class Clock:
    """A time that goes on while somebody sleeps.  renews : called at each sleep with the seconds since the begin."""

    def __init__(self, renews: Callable[[float], object] = lambda seconds: None) -> None:
        self.seconds, self.renews = 0.0, renews

    def monotonic(self) -> float:
        return self.seconds

    def sleep(self, seconds: float) -> None:
        self.seconds += seconds
        self.renews(self.seconds)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(claims, "time", found)
    return found


def test_one_has_a_claim_until_its_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b"
    with claimed(path) as first:
        with claimed(path) as second:
            assert (first, second) == (True, False)
        assert path.exists()
    assert not path.exists()
    with claimed(path) as third:
        assert third


def test_a_claim_goes_with_an_error(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), claimed(tmp_path / "a"):
        raise ZeroDivisionError
    assert not (tmp_path / "a").exists()


def test_a_place_that_takes_no_claim_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("a")
    with pytest.raises(InputError, match="cannot write"), claimed(tmp_path / "a" / "b"):
        pass


def test_a_claim_of_a_dead_process_holds_nobody_up(tmp_path: Path, clock: Clock) -> None:
    """No process has this number."""
    here = claims.begun_by_this().split()[3]
    (tmp_path / "a").write_bytes(BEGUN + b"%s 999999999 0\n" % here)
    wait_for_claim(tmp_path / "a", lambda: False, lambda: None)
    assert clock.seconds == 0.0 and not (tmp_path / "a").exists()


def test_a_claim_of_another_machine_holds_up_as_long_as_it_is_renewed(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is renewed for ten minutes, and then no more."""
    path, renewed_s = tmp_path / "a", 600.0
    path.touch()
    monkeypatch.setattr(claims, "is_begun", lambda path: True)

    def renew(seconds: float) -> None:
        if seconds < renewed_s:
            os.utime(path, (seconds, seconds))

    clock.renews = renew
    wait_for_claim(path, lambda: False, lambda: None)
    assert clock.seconds == pytest.approx(renewed_s + claims.DEAD_AFTER_S, abs=1.0)
    assert not path.exists()


def test_who_has_a_claim_renews_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "RENEWED_EVERY_S", 0.01)
    with claimed(tmp_path / "a"):
        os.utime(tmp_path / "a", (1.0, 1.0))
        wait_until(lambda: (tmp_path / "a").stat().st_mtime > 1.0)


def test_what_is_made_is_waited_for_no_longer(tmp_path: Path) -> None:
    looks = iter([False, False, True])
    with claimed(tmp_path / "a"):
        wait_for_claim(tmp_path / "a", lambda: next(looks), lambda: None)
    assert next(looks, None) is None
