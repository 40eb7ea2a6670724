"""Stop at Ctrl-C and SIGTERM at once: undo what is not finished, and report.

Mitsuba catches Ctrl-C while it renders, and Python runs no handler before a kernel ends. Therefore the program blocks
these signals in all threads, and a separate thread waits for them: it undoes what is not finished, prints one sentence,
and ends the process. A program that only imports the package keeps its own handlers.

This module is not in core/, which imports NumPy: threads that NumPy starts before would not block the signals.
"""

import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # Ctrl-C, kill, a terminal that closes
TRIES = 50  # to undo, since other threads still run and may write

whole_step = (
    threading.RLock()
)  # held during steps that must not be interrupted, and while the program stops
_undoings: list[Callable[[], object]] = []
_written: deque[Path] = deque(maxlen=16)
_remarks: list[Callable[[], str | None]] = []


@contextmanager
def undone_if_stopped(undo: Callable[[], object]) -> Iterator[None]:
    """Call ``undo`` if the program is stopped in the block; again if it raises OSError."""
    with whole_step:
        _undoings.append(undo)
    try:
        yield
    finally:
        with whole_step:
            _undoings.remove(undo)


def remark_if_stopped(remark: Callable[[], str | None]) -> None:
    """Report what ``remark`` returns when the program is stopped, unless it is None, instead of written files."""
    _remarks.append(remark)


def note_written(path: Path) -> None:
    """Record a complete file, to be reported if the program is stopped."""
    _written.append(path)


def begin_command() -> None:
    """Forget files and remarks of an earlier command in this process."""
    _written.clear()
    _remarks.clear()


def sentence() -> str:
    """Return the report of a stopped program."""
    for remark in reversed(_remarks):
        if said := remark():
            return f"stopped; {said}"
    left = [str(path) for path in dict.fromkeys(_written) if path.exists()]
    return f"stopped; complete: {', '.join(left)}" if left else "stopped; nothing was written"


def stop_at_signals() -> None:
    """Let SIGNALS end the process within a second, with exit code 128 + their number.

    A signal that the process inherits as ignored (nohup, a background job) stays ignored.
    """
    if not hasattr(signal, "sigwait"):  # Windows: Ctrl-C becomes KeyboardInterrupt there
        return
    numbers = _not_ignored()
    for number in numbers:
        signal.signal(number, signal.SIG_DFL)  # for a second signal during the first
    signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    threading.Thread(target=_wait_for, args=(numbers,), name="signals", daemon=True).start()


def _wait_for(numbers: set[signal.Signals]) -> None:
    number = signal.sigwait(numbers)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)
    with whole_step:
        _undo()
        with suppress(OSError, ValueError):  # stderr is closed
            os.write(2, f"{_on_one_line(sentence())}\n".encode(sys.stderr.encoding, "replace"))
        os._exit(128 + number)


def _on_one_line(text: str) -> str:
    """Return the text with control characters escaped."""
    return text if text.isprintable() else repr(text)[1:-1]


def undo_when_terminated() -> None:
    """Let SIGNALS end this process, a worker of another one, in silence.

    A signal that the process inherits as ignored stays ignored. To be called by the main thread, which must return to
    Python now and then.
    """

    def end(number: int, frame: object) -> None:
        with whole_step:
            _undo()
            os._exit(128 + number)

    numbers = _not_ignored()
    for number in numbers:
        signal.signal(number, end)
    if hasattr(signal, "pthread_sigmask"):  # its parent may have blocked them
        signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


def end_quietly() -> None:
    """Undo what is not finished, and end this process, a worker of another one that has ended."""
    with whole_step:
        _undo()
        os._exit(1)


def _not_ignored() -> set[signal.Signals]:
    """Return those of SIGNALS that this system has and that the process does not inherit as ignored."""
    known = {getattr(signal, name) for name in SIGNALS if hasattr(signal, name)}
    return {number for number in known if signal.getsignal(number) != signal.SIG_IGN}


@contextmanager
def signals_held() -> Iterator[None]:
    """Block the same signals after the block as before it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    held = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def _undo() -> None:
    """Undo the last begun first, and repeat what fails because another thread has just written."""
    for undo in reversed(_undoings):
        for _ in range(TRIES):
            with suppress(Exception):
                undo()
                break
