"""The trace of a controller: one line per tick, enough to replay the run to the bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
import json
from math import nan
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.atomic import content_of, FORMAT, format_of


class TraceWriter:
    """
    Writes JSON lines: ``{"settings": ...}`` first and at every change, then one record per tick.

    The first says also its ``format`` and whether the sensor counted as ``checked``. A record has
    the arguments of :meth:`Controller.tick` (``y``, ``dt``, ``elapsed``, ``age``, ``r``, the
    ``applied`` command that counted, with the ``applied_age`` of a report, ``followed``, ``x`` for
    ``gain_variable``, and the ``feed_forward`` that counted), ``enabled``, and what came out:
    ``u`` and ``status``.
    Between two ticks ``{"disabled": true}`` and ``{"reset": true}`` say what was asked for.
    Numbers are written so that they read back to the bit; nan and infinities as JavaScript writes
    them.

    When the disk is full the trace ends, with the reason in ``failure``, and ``failed`` is told;
    the controller goes on.
    """

    def __init__(
        self,
        path: Path,
        settings: ControllerSettings,
        checked: bool = False,
        failed: Callable[[str], object] = lambda text: None,
    ) -> None:
        self.failure = ''
        self._failed = failed
        self._file = path.open('x', encoding='utf-8')
        first = {FORMAT: format_of('trace'), 'settings': attrs.asdict(settings)}
        self._write({**first, 'checked': checked})

    def settings(self, settings: ControllerSettings) -> None:
        """Record that these settings are staged before the next tick."""
        self._write({'settings': attrs.asdict(settings)})

    def disabled(self) -> None:
        """Record that the loop is opened before the next tick, which may find it closed again."""
        self._write({'disabled': True})

    def reset(self) -> None:
        """Record that a reset is asked for before the next tick."""
        self._write({'reset': True})

    def tick(self, controller: Controller, reference: Sequence[float | None] | None) -> None:
        """Record the tick that ``controller`` just did with that reference."""
        sample = controller.sample
        self._write(
            {
                'y': sample.measurement,
                'dt': sample.span,
                'elapsed': sample.elapsed,
                'age': sample.age,
                'r': reference,
                'r_span': controller.intake.span,
                'applied': sample.applied,
                'followed': sample.followed,
                'x': sample.gain_variable,
                'applied_age': sample.applied_age,
                'feed_forward': sample.feed_forward,
                'enabled': controller.enabled,
                'u': controller.command,
                'status': int(controller.status),
            }
        )

    def flush(self) -> None:
        """Hand what was written to the operating system."""
        self._do(self._file.flush)

    def close(self) -> None:
        """Close the file."""
        self._do(self._file.close)

    def discard(self) -> None:
        """Remove the file, which was made for a run that does not begin."""
        self.close()
        Path(self._file.name).unlink(missing_ok=True)

    def _write(self, record: dict[str, Any]) -> None:
        self._do(lambda: self._file.write(json.dumps(record) + '\n'))

    def _do(self, work: Callable[[], object]) -> None:
        if self.failure:
            return
        try:
            work()
        except OSError as error:
            self.failure = f'{self._file.name}: cannot write: {error.strerror}'
            self._failed(f'the trace ends: {self.failure}')
            with suppress(OSError):
                self._file.close()


def replay(path: Path) -> Iterator[tuple[float, float]]:
    """
    Run the law over a trace again; yield the recorded and the replayed command of each tick.

    A last line that was cut short, by a kill or a full disk, is left out.
    """
    controller: Controller | None = None
    with path.open(encoding='utf-8') as file:
        for line in file:
            if not line.endswith('\n'):
                return
            record = json.loads(line)
            if 'settings' in record:
                settings = ControllerSettings(**record['settings'])
                if controller is None:
                    content_of(path.name, 'trace', record)
                    controller = Controller(settings, checked=record.get('checked', False))
                else:
                    controller.retune(settings)
                continue
            if controller is None:
                raise ValueError(f'{path}: a trace begins with settings')
            if 'disabled' in record:
                controller.enabled = False
                continue
            if 'reset' in record:
                controller.reset()
                continue
            controller.enabled = record['enabled']
            controller.tick(
                record['y'],
                record['dt'],
                elapsed=record['elapsed'],
                age=record['age'],
                reference=record['r'],
                reference_span=record.get('r_span', 0.0),
                applied=record['applied'],
                followed=record.get('followed', True),
                gain_variable=record.get('x', nan),
                applied_age=record.get('applied_age', nan),
                feed_forward=record.get('feed_forward', 0.0),
            )
            yield record['u'], controller.command
