"""How far a long command is: a bar on a terminal, otherwise a line now and then."""

# ruff: noqa: UP045
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Optional, Protocol

from nadrc_ros.cli.failure import complain

# Without a terminal, a line that often [s]; what is done sooner needs no sign of life.
EVERY = 10.0


class Tell(Protocol):
    """Takes how many are done, and a note."""

    def __call__(self, done: float = 0, note: str = '') -> None:
        """Show it."""


@contextmanager
def progress(what: str, total: Optional[float] = None, done: float = 0) -> Iterator[Tell]:
    """Show that something goes on; give what shows how many of ``total`` are done."""
    from rich.console import Console

    console = Console(stderr=True)
    with (_bar if console.is_terminal else _lines)(console, what, total, done) as tell:
        yield tell


@contextmanager
def _bar(console: Any, what: str, total: Optional[float], done: float) -> Iterator[Tell]:
    from rich import progress as rich

    if total is None:
        about = rich.TextColumn('{task.description}', markup=False)
        columns = [rich.SpinnerColumn(), about, rich.TimeElapsedColumn()]
    else:
        note = rich.TextColumn('{task.fields[note]}', markup=False)
        columns = [*rich.Progress.get_default_columns(), rich.MofNCompleteColumn(), note]
    with rich.Progress(*columns, console=console, transient=total is None) as bar:
        task = bar.add_task(what, total=total, completed=int(done), note='')

        def tell(done: float = 0, note: str = '') -> None:
            bar.update(task, completed=done, note=note)

        yield tell


@contextmanager
def _lines(_: Any, what: str, total: Optional[float], done: float) -> Iterator[Tell]:
    from threading import Event, Thread
    from time import monotonic

    start = last = monotonic()
    over = Event()

    def tell(done: float = done, note: str = '') -> None:
        nonlocal last
        now = monotonic()
        if now - last >= EVERY:
            last = now
            far = (
                f'{what}, {now - start:.0f} s'
                if total is None
                else f'{done:g} of {total:g} {what}'
            )
            complain(far + (f', {note}' if note else ''))

    def keep_telling() -> None:
        while not over.wait(EVERY):
            tell()

    teller = Thread(target=keep_telling, daemon=True)
    if total is None:  # nobody else will
        teller.start()
    try:
        yield tell
    finally:
        over.set()
        if total is None:
            teller.join()
