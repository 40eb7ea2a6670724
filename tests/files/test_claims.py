"""Who has claimed something is waited for while it lives, and no longer."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from mitsuba_sensor.core import InputError
from mitsuba_sensor.files import claims
from mitsuba_sensor.files.claims import claimed, wait_for_claim
from mitsuba_sensor.files.worker_log import BEGUN


def waited_s(path: Path) -> float:
    began = time.monotonic()
    wait_for_claim(path, lambda: False, lambda: None)
    return time.monotonic() - began


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


def test_a_claim_of_a_dead_process_holds_nobody_up(tmp_path: Path) -> None:
    """No process has this number."""
    (tmp_path / "a").write_bytes(
        BEGUN + b"%s 999999999 0\n" % claims.begun_by_this().split()[3]
    )
    assert waited_s(tmp_path / "a") < 1.0
    assert not (tmp_path / "a").exists()


def test_a_claim_of_another_machine_holds_up_as_long_as_it_is_renewed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is written anew for one second, and then not for half of one."""
    monkeypatch.setattr(claims, "DEAD_AFTER_S", 0.5)
    monkeypatch.setattr(claims, "LOOKS_EVERY_S", 0.05)
    path, ended = tmp_path / "a", threading.Event()
    path.write_bytes(BEGUN + b"elsewhere 1 %d\n" % time.time())
    monkeypatch.setattr(claims, "RENEWED_EVERY_S", 0.1)
    threading.Thread(target=claims._renew, args=(path, ended), daemon=True).start()
    threading.Timer(1.0, ended.set).start()
    assert waited_s(path) >= 1.4
    assert not path.exists()


def test_what_is_made_is_waited_for_no_longer(tmp_path: Path) -> None:
    looks = iter([False, False, True])
    with claimed(tmp_path / "a"):
        wait_for_claim(tmp_path / "a", lambda: next(looks), lambda: None)
    assert next(looks, None) is None
