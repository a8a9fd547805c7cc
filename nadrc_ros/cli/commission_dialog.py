"""What `nadrc commission` asks and says, and what its report has of that."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import sys
from typing import Any, Protocol, TypeVar

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.atomic import write_whole
from nadrc_ros.cli.messages import error, note, say, warning
from nadrc_ros.commission.page import page, Step
from nadrc_ros.tuning.commission.steps import BRING_IT_BACK
import typer

_PAGE = 'commission.html'


class Refusable(Protocol):
    """The result of a step: why no other may follow, '' if it may."""

    @property
    def refusal(self) -> str:
        """Return it."""
        ...


_Result = TypeVar('_Result', bound=Refusable)


class Dialog:
    """
    Explains, asks, and keeps what was said; ``yes`` answers every question.

    Attributes
    ----------
    refused, changed
        Whether a step was refused, and whether anything is other than before.

    """

    def __init__(self, out: Path, yes: bool) -> None:
        self.refused = self.changed = False
        self._out, self._yes = out, yes
        self._steps: list[Step] = []

    @property
    def _somebody(self) -> bool:
        """Tell whether somebody is there who answers."""
        return not self._yes and sys.stdin.isatty()

    def _number(self, name: str, question: str, usual: float | None) -> float:
        """Ask for a number, and take the usual one where nobody answers."""
        option = '--' + name.replace('_', '-')
        if not self._somebody:
            if usual is None:
                raise UserError(f'{option} is needed: only who owns the machine knows it')
            note(f'{option} {usual:g}: 5 % of the range of the command')
            return usual
        answer: float = typer.prompt(question, default=usual, type=float)
        return answer

    def _say(self, title: str, text: str) -> None:
        """Begin a step."""
        typer.echo('')
        say(f'Step {title}')
        say(text)

    def _ask(self, title: str, text: str, question: str, needed: bool = True) -> bool:
        """Explain a step and ask for it; no is the answer of who says nothing."""
        self._say(title, text)
        if self._yes:
            return True
        if not sys.stdin.isatty():
            raise UserError(f'{question} Nobody is here to answer: --yes answers every question')
        if typer.confirm(question, default=False):
            return True
        if needed:
            say('Nothing more is sent, and nothing was changed.')
        return False

    def _note(
        self, title: str, result: Any, samples: tuple[Any, ...], refuse: bool = True
    ) -> bool:
        """Tell the result of a step, and whether it may go on."""
        lines = list(result.lines)
        for line in lines:
            if line != result.refusal:
                say(line)
        self._record(title, lines, samples)
        if result.refusal:
            (error if refuse else warning)(result.refusal)
            self.refused = self.refused or refuse
            if refuse:
                say('Nothing was changed.')
        return not result.refusal

    def _record(self, title: str, lines: list[str], samples: tuple[Any, ...] = ()) -> None:
        """Keep something for the report."""
        self._steps.append(Step(title=title, lines=lines, samples=samples))

    def _until_back(self, step: Callable[[_Result | None], _Result]) -> _Result:
        """
        Do a step, and again after each time that somebody brought the machine back for it.

        It is given what it told before, None at first.
        """
        result = None
        while True:
            result = step(result)
            if not (self._somebody and result.refusal.startswith(BRING_IT_BACK)):
                return result
            warning(result.refusal)
            say('Nothing is sent now: move it by hand, or wait until it rests there again.')
            if not typer.confirm('Is it back? Then this step goes on.', default=False):
                return result

    def report(self, name: str) -> None:
        """Write the page of what was done so far with a controller."""
        if not self._steps:
            return
        path = self._out / _PAGE
        write_whole(path, page(f'Commissioning of {name}', self._steps).encode())
        say(f'Report: {path}')
