"""The recorder node: samples to a file as they come, and the figures of merit live."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from datetime import datetime, timezone
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from math import inf
import os
import platform
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.nodes.recorder_intake import Intake, late
from nadrc_ros.nodes.recorder_settings import make_units, RecorderSettings, unit_fields
from nadrc_ros.records.figures import Figures, summary
from nadrc_ros.records.history import (
    about_figures,
    append_event,
    append_parameters,
    Event,
    History,
    LASTING,
    write_about,
)
from nadrc_ros.records.recording import (
    FigureSettings,
    NEEDED,
    RunFolder,
    RunSettings,
    STAMPED,
    STAMPS,
)
from nadrc_ros.records.rows import Row
from nadrc_ros.ros.command_line import About
from nadrc_ros.ros.diagnostics import OK, receive_events, Report, WARN
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.pacing import steady_timer
from nadrc_ros.ros.parameter_watch import ParameterWatch
from nadrc_ros.ros.parameters import ParameterGroup, written_to
from nadrc_ros.ros.runtime import run_command
from nadrc_ros.ros.topics import Info, Sender
from nadrc_ros.simulation.metrics import MetricValues
import rclpy

# Rows are written, and figures sent, so often [s].
_FLUSH = 0.2
_METRICS = tuple(field.name for field in attrs.fields(MetricValues))
_SECOND = 1_000_000_000  # ns
# Writes something down, with its time in the run [s].
Note = Callable[[float | None], None]


class RecorderNode(LiveNode):
    """
    Streams the loop's signals to ``samples.csv`` and computes its figures of merit.

    In real time a row belongs to an instant, by the source stamps of what was measured then, and
    is written when it is over: see :class:`~nadrc_ros.records.rows.Rows`. What happens to the
    loop is recorded with the time at which it was told: parameters, events of controller and
    plant, gaps.
    """

    default_name = 'recorder'

    def set_up(self) -> None:
        """Declare the parameters and join the graph."""
        self.settings = self.declare(RecorderSettings)
        self._units = ParameterGroup(self, unit_fields(), make_units).value
        figures = {name: getattr(self.settings, name) for name in declared(FigureSettings)}
        figures['settle_time'] = self.settings.settle_time or 0.1 * self.settings.duration
        rate = self.pacing.rate if self.pacing.lockstep else 0.0
        self._run = RunSettings(rate=rate, **figures)
        topics = self.settings.topics()
        self._columns = ['time', *topics]
        self._standing: dict[tuple[str, str], str] = {}  # what was told before a run holds in it
        self._senders = {name: Sender(self, f'~/{name}') for name in _METRICS}
        # A controller may be wired to other topics than these, but has its events.
        told = f'{self.settings.controller}/event'
        self._watch = ParameterWatch(self, (*NEEDED, told), self._on_parameters)
        for source in (self.settings.controller, self.settings.plant):
            receive_events(self, source, self._on_event)
        period = self.settings.measurement_period
        self.intake = Intake(self, topics, self.settings.duration or inf, period)
        if not (self.pacing.lockstep or self.intake.simulated):  # stamps are of this machine
            self._columns += STAMPS
        steady_timer(self, _FLUSH, self._on_flush)
        self.add_trigger('~/reset', self._reset)
        self.add_trigger('~/save', self._save)

    # ---- the run ----

    def begin(self) -> None:
        """Begin a run, in a folder of its own."""
        allowed = 'a folder, or where one can be made, to write to'
        with written_to('directory', self.settings.directory, allowed) as directory:
            folder = RunFolder(directory, self._columns, self._run)
            self._begin = int(time.time())
            history = History()
            try:
                write_about(folder.path, self._about(folder))
                for node, values in self._watch.known.items():
                    append_parameters(folder.path, None, node, values)
                    history.take(None, node, about_figures(values))
                for (node, kind), message in self._standing.items():
                    append_event(folder.path, Event(None, node, kind, message))
            except OSError:
                folder.discard()
                raise
        self.folder = folder
        self._history = history
        self.figures = Figures(self._run, history)
        self.recording = True
        self._notes: list[tuple[int, Note]] = []
        self.intake.restart(self._begin * _SECOND)
        self.get_logger().info(f'recording to {self.folder.path}')

    def _end_run(self) -> None:
        """Complete the last rows and write the summary."""
        if self.recording:
            self._guarded(self._write, self.intake.end())
        if self.recording:  # the disk is not full
            self._guarded(self._finish)

    def _finish(self, length: float | None = None) -> None:
        """Write what is left and the summary, and say how long the run is [s]."""
        self.recording = False
        self.intake.open = False
        self._write_notes(inf)
        self.figures.end(self.intake.length())
        self.folder.close()
        self.folder.write_summary(self._summary())
        if not self.figures.rows:
            unheard = ', '.join(self.intake.unheard())
            why = f': nothing came of {unheard}' if unheard else ''
            self.get_logger().warning(f'no row was recorded{why}')
            return
        if length is None:
            length = self.figures.stop or self.figures.last
        said = f'{length:.4g} s are recorded in {self.folder.path}'
        if self.intake.commands_before:
            self.get_logger().warning(f'{said}; {late(self.intake.commands_before)}')
        else:
            self.get_logger().info(said)

    def _about(self, folder: RunFolder) -> dict[str, Any]:
        color = self.settings.color
        started = datetime.fromtimestamp(self._begin, timezone.utc)
        return {
            'started': started.isoformat(),
            'namespace': self.get_namespace(),
            'versions': _versions(),
            'units': attrs.asdict(self._units),
            'color': folder.before if color < 0 else color,
        }

    def _summary(self) -> dict[str, Any]:
        by_signal = self.intake.lost_by_signal()
        return summary(self.figures) | {
            'samples_lost': None if by_signal is None else sum(by_signal.values()),
            'samples_lost_by_signal': by_signal,
            'commands_before': self.intake.commands_before,
            'complete': not self.recording,
        }

    # ---- what happens besides ----

    def _on_parameters(self, node: str, values: dict[str, Any], info: Info | None) -> None:
        ours = self.resolve_topic_name(self.settings.controller)
        if node == ours:
            self.intake.follow(node, self._watch.known[node])

        def write(t: float | None) -> None:
            append_parameters(self.folder.path, t, node, values)
            # not all, as somebody may retune without end
            self._history.take(t, node, about_figures(values))

        self._note(write, '/parameter_events of ' + node, info)

    def _on_event(self, node: str, kind: str, message: str, info: Info) -> None:
        if kind in LASTING:
            self._standing[node, kind] = message
        self._note(partial(self._write_event, node, kind, message), 'events of ' + node, info)

    def _note(self, note: Note, source: str, info: Info | None) -> None:
        """Write something when the rows of its time are written: only then is t known."""
        if not self.recording:
            return
        if self.lockstep is not None:
            self._guarded(note, self.figures.last if self.figures.rows else None)
            return
        moment = self.intake.now() if info is None else self.intake.left(source, info)
        self._notes.append((moment, note))

    def _write_notes(self, until: float) -> None:
        own = self.get_fully_qualified_name()
        for moment, kind, message in self.intake.happened():
            self._notes.append((moment, partial(self._write_event, own, kind, message)))
        ready = [each for each in self._notes if each[0] <= until]
        self._notes = [each for each in self._notes if each[0] > until]
        for moment, note in sorted(ready, key=lambda each: each[0]):
            t = self.intake.since_begin(moment)
            if t is None or t <= (self.settings.duration or inf):
                note(t)

    def _write_event(self, node: str, kind: str, message: str, t: float | None) -> None:
        append_event(self.folder.path, Event(t, node, kind, message))

    # ---- rows ----

    def on_samples(self, values: list[float]) -> None:
        """Record one lockstep period."""
        if not self.recording:
            return
        row = Row(self.figures.rows / self.pacing.rate, dict(zip(self._columns[1:], values)))
        if self._is_over(row.time + self._half()):
            self._guarded(self._complete)
        else:
            self._guarded(self._write, [row])

    def _on_flush(self) -> None:
        self._watch.look()
        self.intake.rewire()
        if self.recording:
            self._guarded(self.flush)
        values = self.figures.values()
        for name, sender in self._senders.items():
            sender.send(float(getattr(values, name)))

    def flush(self) -> None:
        """Write all that is over."""
        until, rows = self.intake.close()
        self._write(rows)
        if self._is_over(self.intake.since_begin(until)):
            self._write(self.intake.end())
            self._complete()
            return
        self._write_notes(until)
        self.folder.flush()

    def _is_over(self, time: float | None) -> bool:
        return time is not None and 0.0 < self.settings.duration <= time

    def _write(self, rows: list[Row]) -> None:
        stamped = STAMPED if self._columns[-1] in STAMPS else ()
        for row in rows:
            if self._is_over(row.time + self._half()):
                return
            self.figures.add(row.time, row.values)
            self.folder.write(
                [row.time, *row.values.values(), *(row.stamps[name] for name in stamped)]
            )

    def _half(self) -> float:
        """Return half a period [s]: so near to the end of the duration a row is after it."""
        return 0.5 / self.figures.rate if self.figures.rate else 0.0

    def _complete(self) -> None:
        """End a run that is as long as was asked for."""
        self._finish(self.settings.duration)

    def _guarded(self, work: Callable[..., None], *arguments: Any) -> None:
        """Stop, with a reason, when the disk is full."""
        try:
            work(*arguments)
        except OSError as error:
            self.recording = False
            self.fail(f'{self.folder.path}: cannot write: {error.strerror}')

    # ---- services and reports ----

    def _reset(self) -> str:
        self._end_run()
        self.begin()
        if self.failure:
            raise UserError(self.failure)
        return f'a new run is recorded to {self.folder.path}'

    def _save(self) -> str:
        try:
            if self.recording:
                self.flush()
            self.folder.write_summary(self._summary())
        except OSError as error:
            raise UserError(f'cannot write: {error.strerror}') from None
        return str(self.folder.path)

    def report(self) -> Report:
        """Tell what is recorded, and what is missing."""
        by_signal, unheard = self.intake.lost_by_signal(), self.intake.unheard()
        lost = None if by_signal is None else sum(by_signal.values())
        gap_time = self.figures.gap_time
        values = {
            'rows': self.figures.rows,
            'samples_lost': 'unknown' if lost is None else lost,
            'measured_rate': self.figures.rate,
            'gap_time': gap_time,
            'clock_jumps': self.intake.clock_jumps,
            'waiting_for': ' '.join(unheard),
            'unmatched': ' '.join(self.intake.unmatched()),
            'folder': self.folder.path,
        }
        first = [name for name in ('measurement', 'command') if name in unheard]
        if self.recording and first:  # without these there is no row
            return WARN, f'waiting for {" and ".join(first)}', values
        if lost:
            return WARN, f'{lost} samples lost', values
        if gap_time:
            message = f'{gap_time:.3g} s without a measurement or a true output are in no figure'
            return WARN, message, values
        return OK, 'recording' if self.recording else 'done', values

    def close(self) -> None:
        """Write the summary."""
        self._end_run()


def _versions() -> dict[str, str]:
    """Return the versions of this package and of what it runs on, those that are known."""
    found = {}
    for package in ('nadrc_ros', 'rclpy'):
        with suppress(PackageNotFoundError):  # run from a source tree
            found[package] = version(package)
    found |= {
        'python': platform.python_version(),
        'ROS distribution': os.environ.get('ROS_DISTRO', ''),
        'middleware': rclpy.get_rmw_implementation_identifier(),
        'platform': f'{platform.system()} {platform.machine()}',
    }
    return {name: value for name, value in found.items() if value}


def _about() -> About:
    own = declared(RecorderSettings)
    main_ones = ('directory', 'duration', 'inputs', 'settle_time', 'controller')
    return About(
        purpose='Writes the signals of a loop to a folder, and publishes its figures of merit.',
        topics={
            'reference, measurement, command': 'in: the loop',
            'plant/..., controller/...': 'in: the truth and the estimates, where there are any',
            '~/itae, ~/isu, ...': 'out: the figures of merit so far',
        },
        parameters={name: own[name] for name in main_ones},
        examples=(
            'ros2 run nadrc_ros recorder --ros-args -p directory:=runs -p duration:=10.0',
            'ros2 run nadrc_ros recorder --ros-args -r __ns:=/arm -p settle_time:=2.0',
        ),
        more=('Services: ~/save writes the summary so far, ~/reset begins a new run.',),
    )


def main() -> int:
    """Run the recorder node."""
    return run_command(RecorderNode, _about())


if __name__ == '__main__':
    raise SystemExit(main())
