"""How far a long command is: a bar on a terminal, otherwise a line now and then."""

# ruff: noqa: UP045
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Optional

from nadrc_ros.cli.messages import note as say_note

# Without a terminal, a line that often [s]; what is done sooner needs no sign of life.
_EVERY = 10.0
_BAR = 12
# What gaps take.
_GAPS = 6
# Takes how many are done, and a note.
Tell = Callable[[float, str], None]


@contextmanager
def progress(
    what: str, total: Optional[float] = None, done: float = 0, unit: str = ''
) -> Iterator[Tell]:
    """Show what goes on; give what shows how many of ``total`` are done."""
    from rich import progress as rich
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal or console.is_dumb_terminal:
        with _lines(what, total, unit) as tell:
            yield tell
        return
    about = rich.TextColumn('{task.description}', markup=False)
    if total is None:
        columns = [rich.SpinnerColumn(), about, rich.TimeElapsedColumn()]
    else:
        shown = rich.TextColumn('{task.fields[shown]}', markup=False)
        columns = [about, rich.BarColumn(_BAR), shown]
        if not unit:  # seconds tell by themselves how many remain
            columns.append(rich.TimeRemainingColumn())
    with rich.Progress(*columns, console=console, transient=total is None) as bar:
        begin = '' if total is None else _count(done, total, unit)
        task = bar.add_task(what, total=total, completed=int(done), shown=begin)

        def show(now: float, note: str) -> None:
            assert total is not None
            shown = _count(now, total, unit)
            # A note that would be broken is left out.
            if len(what) + _BAR + len(shown) + len(note) + _GAPS <= console.width:
                shown += f'  {note}'
            bar.update(task, completed=now, shown=shown)

        yield show


def _count(done: float, total: float, unit: str) -> str:
    return f'{round(done, 1):.9g} of {total:.9g} {unit}'.rstrip()


@contextmanager
def _lines(what: str, total: Optional[float], unit: str) -> Iterator[Tell]:
    from threading import Event, Thread
    from time import monotonic

    start = last = monotonic()
    over = Event()

    def tell(done: float, note: str) -> None:
        nonlocal last
        assert total is not None
        if monotonic() - last >= _EVERY:
            last = monotonic()
            more = f', {note}' if note else ''
            say_note(f'{what}: {_count(done, total, unit)}{more}')

    def tell_that_it_goes_on() -> None:
        while not over.wait(_EVERY):
            say_note(f'{what}: {monotonic() - start:.0f} s')

    if total is None:
        Thread(target=tell_that_it_goes_on, daemon=True).start()
    try:
        yield tell
    finally:
        over.set()
