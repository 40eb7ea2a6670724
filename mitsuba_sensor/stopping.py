"""What a stopped program undoes, what it says, and how Ctrl-C and SIGTERM stop it at once.

Mitsuba catches Ctrl-C itself while it renders, and Python runs no handler of its own before a kernel ends. Therefore
the program blocks these signals in all threads, and a thread of its own waits for them: it undoes what is not finished,
says one sentence, and ends the process. A program that only imports the package keeps its own handlers.

This module stands beside core/, which imports NumPy: threads that NumPy begins before would not block the signals.
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
TRIES = 50  # at undoing: the other threads still run and may write meanwhile

whole_step = (
    threading.RLock()
)  # held while something must happen whole or not at all, and while the program stops
_undoings: list[Callable[[], object]] = []
_written: deque[Path] = deque(maxlen=16)  # the last ones
_remarks: list[Callable[[], str | None]] = []


@contextmanager
def undone_if_stopped(undo: Callable[[], object]) -> Iterator[None]:
    """While the block runs, a stop calls ``undo``; it may be called again, and raises OSError if it must be."""
    with whole_step:
        _undoings.append(undo)
    try:
        yield
    finally:
        with whole_step:
            _undoings.remove(undo)


def remark_if_stopped(remark: Callable[[], str | None]) -> None:
    """From now on a stop says what ``remark`` returns, unless it is None, in place of what was written."""
    _remarks.append(remark)


def note_written(path: Path) -> None:
    """A file that is complete now; if the program is stopped and the file is still there, it says so."""
    _written.append(path)


def begin_command() -> None:
    """Forget what an earlier command in this process has written and remarked."""
    _written.clear()
    _remarks.clear()


def sentence() -> str:
    """What the program says when it is stopped."""
    for remark in reversed(_remarks):
        if said := remark():
            return f"stopped; {said}"
    left = [str(path) for path in dict.fromkeys(_written) if path.exists()]
    return f"stopped; complete: {', '.join(left)}" if left else "stopped; nothing was written"


def stop_at_signals() -> None:
    """From now on the signals of SIGNALS end the process within a second, with exit code 128 + their number.

    A signal that the caller has told the process to ignore (nohup, a background job) stays ignored.
    """
    if not hasattr(signal, "sigwait"):  # Windows: Ctrl-C becomes KeyboardInterrupt there
        return
    numbers = _not_ignored()
    for number in numbers:
        signal.signal(
            number, signal.SIG_DFL
        )  # what a second one does, which comes while the first is at work
    signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    threading.Thread(target=_wait_for, args=(numbers,), name="signals", daemon=True).start()


def _wait_for(numbers: set[signal.Signals]) -> None:
    number = signal.sigwait(numbers)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)
    with whole_step:
        _undo()
        with suppress(OSError, ValueError):  # nobody reads stderr any more
            os.write(2, f"{_on_one_line(sentence())}\n".encode(sys.stderr.encoding, "replace"))
        os._exit(128 + number)


def _on_one_line(text: str) -> str:
    """The text, with names of files that hold control characters escaped."""
    return text if text.isprintable() else repr(text)[1:-1]


def undo_when_terminated() -> None:
    """From now on the signals of SIGNALS end this process, which works for another one, in silence.

    One that the caller has told the process to ignore stays ignored. To be called by the main thread, which must return
    to Python now and then.
    """

    def end(number: int, frame: object) -> None:
        with whole_step:
            _undo()
            os._exit(128 + number)

    numbers = _not_ignored()
    for number in numbers:
        signal.signal(number, end)
    if hasattr(signal, "pthread_sigmask"):  # its parent may have held them back
        signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


def end_quietly() -> None:
    """Undo what is not finished, and end this process, which has worked for another one that is gone."""
    with whole_step:
        _undo()
        os._exit(1)


def _not_ignored() -> set[signal.Signals]:
    """The signals of SIGNALS that this system has, but for those that the caller has told the process to ignore."""
    known = {getattr(signal, name) for name in SIGNALS if hasattr(signal, name)}
    return {number for number in known if signal.getsignal(number) != signal.SIG_IGN}


@contextmanager
def signals_held() -> Iterator[None]:
    """Signals that this thread holds back before the block are held back after it, whatever the block does."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    held = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def _undo() -> None:
    """The last begun first; what fails, because another thread has just written there, again."""
    for undo in reversed(_undoings):
        for _ in range(TRIES):
            with suppress(Exception):
                undo()
                break
