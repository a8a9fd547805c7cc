"""How far a long command is: a bar on a terminal, otherwise a line now and then."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from nadrc_ros.cli.failure import complain

# Without a terminal, a line that often [s]; what is done sooner needs no sign of life.
EVERY = 10.0


class Tell(Protocol):
    """Takes how many are done, and a note."""

    def __call__(self, done: int, note: str = '') -> None:
        """Show it."""


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show that something goes on of which nobody knows how long it takes, and for how long."""
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_terminal:
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (
            SpinnerColumn(),
            TextColumn('{task.description}', markup=False),
            TimeElapsedColumn(),
        )
        with Progress(*columns, console=console, transient=True) as bar:
            bar.add_task(what, total=None)
            yield
        return
    from threading import Event, Thread
    from time import monotonic

    start, done = monotonic(), Event()

    def say() -> None:
        while not done.wait(EVERY):
            complain(f'{what}, {monotonic() - start:.0f} s')

    teller = Thread(target=say, daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


@contextmanager
def progress(what: str, total: int, done: int) -> Iterator[Tell]:
    """Give what shows how many of ``total`` are done."""
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_terminal:
        from rich.progress import MofNCompleteColumn, Progress, TextColumn

        columns = (*Progress.get_default_columns(), MofNCompleteColumn())
        with Progress(
            *columns, TextColumn('{task.fields[note]}', markup=False), console=console
        ) as bar:
            task = bar.add_task(what, total=total, completed=done, note='')

            def show(done: int, note: str = '') -> None:
                bar.update(task, completed=done, note=note)

            yield show
        return
    from time import monotonic

    last = monotonic()

    def write(done: int, note: str = '') -> None:
        nonlocal last
        if monotonic() - last >= EVERY:
            last = monotonic()
            complain(f'{done} of {total} {what}' + (f', {note}' if note else ''))

    yield write
