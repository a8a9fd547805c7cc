"""How far a long command is: a bar on a terminal, otherwise a line now and then."""

# ruff: noqa: UP045
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Optional

from nadrc_ros.cli.failure import complain

# Without a terminal, a line that often [s]; what is done sooner needs no sign of life.
_EVERY = 10.0
# Takes how many are done, and a note.
Tell = Callable[[float, str], None]


@contextmanager
def progress(what: str, total: Optional[float] = None, done: float = 0) -> Iterator[Tell]:
    """Show that something goes on; give what shows how many of ``total`` are done."""
    from rich import progress as rich
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        with _lines(what, total) as tell:
            yield tell
        return
    if total is None:
        about = rich.TextColumn('{task.description}', markup=False)
        columns = [rich.SpinnerColumn(), about, rich.TimeElapsedColumn()]
    else:
        note = rich.TextColumn('{task.fields[note]}', markup=False)
        columns = [*rich.Progress.get_default_columns(), rich.MofNCompleteColumn(), note]
    with rich.Progress(*columns, console=console, transient=total is None) as bar:
        task = bar.add_task(what, total=total, completed=int(done), note='')
        yield lambda done, note: bar.update(task, completed=done, note=note)


@contextmanager
def _lines(what: str, total: Optional[float]) -> Iterator[Tell]:
    from threading import Event, Thread
    from time import monotonic

    start = last = monotonic()
    over = Event()

    def tell(done: float, note: str) -> None:
        nonlocal last
        if monotonic() - last >= _EVERY:
            last = monotonic()
            complain(f'{round(done, 1):.9g} of {total:.9g} {what}' + (f', {note}' if note else ''))

    def tell_that_it_goes_on() -> None:
        while not over.wait(_EVERY):
            complain(f'{what}, {monotonic() - start:.0f} s')

    if total is None:
        Thread(target=tell_that_it_goes_on, daemon=True).start()
    try:
        yield tell
    finally:
        over.set()
