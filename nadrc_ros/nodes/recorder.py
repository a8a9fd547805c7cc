"""The recorder node: samples to a file as they come, and the figures of merit live."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timezone
from math import isnan, nan
from pathlib import Path
import sys
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, declared, number, text
from nadrc_ros.nodes.command_line import NodeParser
from nadrc_ros.nodes.diagnostics import Diagnostics, OK, WARN
from nadrc_ros.nodes.lockstep import Lockstep
from nadrc_ros.nodes.parameter_watch import ParameterWatch
from nadrc_ros.nodes.parameters import ParameterGroup, refuse_unknown
from nadrc_ros.nodes.runtime import LiveNode, run
from nadrc_ros.nodes.stamps import Losses, Places
from nadrc_ros.nodes.topics import Info, receive, RECORD, Sender
from nadrc_ros.nodes.versions import versions
from nadrc_ros.records.history import append_parameters, write_about
from nadrc_ros.records.recording import (
    ESTIMATES,
    FigureSettings,
    NEEDED,
    OFF_RATE,
    RunFolder,
    RunSettings,
    STAMPS,
    summary,
    topic_of,
    TRUTH,
)
from nadrc_ros.simulation.metrics import MetricValues
from rclpy.clock import Clock, ClockType
from rclpy.qos import ReliabilityPolicy
from std_srvs.srv import Trigger

FLUSH = 0.2
METRICS = tuple(field.name for field in attrs.fields(MetricValues))
BEST_EFFORT = ReliabilityPolicy.BEST_EFFORT
DEFAULT_INPUTS = (*NEEDED, *TRUTH, *ESTIMATES, 'level_1', 'level_2')

DESCRIPTION = 'Writes the signals of a loop to a folder, and publishes its figures of merit.'
EXAMPLE = '  ros2 run nadrc_ros recorder --ros-args -p directory:=runs -p duration:=10.0'


@attrs.frozen(kw_only=True)
class RecorderSettings(FigureSettings):
    """What is recorded, and where to."""

    inputs: str = text(
        ' '.join(DEFAULT_INPUTS), 'signals to record, separated by spaces', live=False
    )
    plant: str = text('plant', 'name of the plant node, for its ~/output', live=False)
    controller: str = text('controller', 'name of the controller node', live=False)
    directory: str = text('runs', 'where a new folder is made for each run', live=False)
    duration: float = number(
        0.0,
        0.0,
        1e7,
        's',
        'length of a run, from the first command; 0 = until stopped',
        live=False,
    )

    def topics(self) -> dict[str, str]:
        """
        Return the topic of each input, in the order of the columns.

        Raises
        ------
        SettingError
            For an input that does not exist, or one of the three needed ones left out.

        """
        names = self.inputs.split()
        for name in NEEDED:
            if name not in names:
                raise SettingError('inputs', self.inputs, f'a list that has {name}')
        return {name: topic_of(name, self.plant, self.controller) for name in names}


class RecorderNode(LiveNode):
    """
    Streams the loop's signals to ``samples.csv`` and computes its figures of merit.

    In real time a row belongs to one measurement and is complete when the next one comes: the
    command is then the one that acted meanwhile. Its time is counted in periods since the first
    command, so that a measurement that was lost, or never sent, leaves a gap and does not shift
    the rest. When measurement and command left their publishers is recorded too, but in lockstep.
    """

    default_name = 'recorder'

    def set_up(self) -> None:
        """Declare the parameters and join the graph."""
        self.settings = ParameterGroup(
            self, declared(RecorderSettings), lambda values: build(RecorderSettings, values)
        ).value
        figures = {name: getattr(self.settings, name) for name in declared(FigureSettings)}
        figures['settle_time'] = self.settings.settle_time or 0.1 * self.settings.duration
        self._run = RunSettings(rate=self.pacing.rate, **figures)
        topics = self.settings.topics()
        self._simulated: bool = self.get_parameter('use_sim_time').value
        # Stamps are of this machine's clock.
        self._stamps = () if self.pacing.lockstep or self._simulated else STAMPS
        self._columns = ['time', *topics, *self._stamps]
        self._losses = {name: Losses() for name in topics}
        self._places = Places(self.pacing.rate, stamped=not self._simulated)
        self._senders = {name: Sender(self, f'~/{name}') for name in METRICS}
        self._watch = ParameterWatch(self, NEEDED, self._on_parameters)
        self.lockstep: Lockstep | None = None
        if self.pacing.lockstep:
            self.lockstep = Lockstep(self, self.pacing, self._fire)
            for topic in topics.values():
                self.lockstep.add_input(topic)
        else:
            self._heard = {
                name: receive(self, topic, self._taker(name), RECORD)
                for name, topic in topics.items()
            }
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(FLUSH, self._on_flush, clock=steady)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(Trigger, '~/save', self._on_save)
        refuse_unknown(self)
        self._open_run()  # last, as a node that fails to start should leave no folder behind
        self.diagnostics = Diagnostics(self, self._report)

    # ---- the run ----

    def _open_run(self) -> None:
        directory = Path(self.settings.directory).expanduser()
        self.folder = RunFolder(directory, self._columns, self._run)
        self._begin = int(time.time())
        write_about(self.folder.path, self._about())
        for node, values in self._watch.known.items():
            append_parameters(self.folder.path, None, node, values)
        self.metrics = self._run.metrics()
        self.recording = True
        self.lost = dict.fromkeys(self._losses, 0)
        self._latest = dict.fromkeys(self._columns[1:], nan)
        self._started = False
        self._pending: tuple[int, float] | None = None
        self._first = 0
        self._index = -1
        self._rows = 0
        self.get_logger().info(f'recording to {self.folder.path}')

    def _end_run(self) -> None:
        """Complete the last row and write the summary."""
        if not self.recording:
            return
        self._complete_row()
        self.recording = False
        try:
            self.folder.close()
            self.folder.write_summary(self._summary())
        except OSError as error:
            self.fail(f'{self.folder.path}: cannot write: {error.strerror}')

    def _about(self) -> dict[str, Any]:
        started = datetime.fromtimestamp(self._begin, timezone.utc)
        return {
            'started': started.isoformat(),
            'namespace': self.get_namespace(),
            'versions': versions(),
        }

    def _on_parameters(self, node: str, values: dict[str, Any]) -> None:
        if not self.recording:
            return
        now = (self._index + 1) / self.pacing.rate if self._rows else None
        try:
            append_parameters(self.folder.path, now, node, values)
        except OSError as error:
            self._stop_on_full_disk(error)

    def _summary(self) -> dict[str, Any]:
        by_signal = self._lost_by_signal()
        return summary(self._run, self.metrics, self._rows, self._index + 1) | {
            'samples_lost': None if by_signal is None else sum(by_signal.values()),
            'samples_lost_by_signal': by_signal,
            'complete': not self.recording,
        }

    def _lost_by_signal(self) -> dict[str, int] | None:
        """Return what was lost, None where the middleware does not number what it sends."""
        if any(losses.unknown for losses in self._losses.values()):
            return None
        return {name: n for name, n in self.lost.items() if n}

    # ---- samples ----

    def _taker(self, name: str) -> Any:
        def take(value: float, info: Info) -> None:
            lost = self._losses[name].before(info['publication_sequence_number'])
            if self.recording and self._started:  # before the first row, none is missing
                self.lost[name] += lost
            if name == 'measurement':
                self._measure(value, self._places.of(info, self._now(), lost))
            if self.recording:
                self._started = self._started or name == 'command'
                self._latest[name] = value
                if (stamp := f'{name}_stamp') in self._stamps:
                    left = info['source_timestamp'] - self._begin * 1_000_000_000
                    self._latest[stamp] = left / 1e9

        return take

    def _now(self) -> int:
        return self.get_clock().now().nanoseconds if self._simulated else time.monotonic_ns()

    def _measure(self, value: float, place: int) -> None:
        if self.recording:
            self._complete_row()
            self._pending = place, value

    def _complete_row(self) -> None:
        """Write the row of the last measurement, now that its command is known."""
        if not self._started or self._pending is None:
            return
        (place, measurement), self._pending = self._pending, None
        if not self._rows:
            self._first = place
        index = place - self._first
        t = index / self.pacing.rate
        if 0.0 < self.settings.duration <= t + 0.5 * self.pacing.period:
            self._end_run()
            self.get_logger().info(f'{self.settings.duration:g} s are recorded')
            return
        self._index = index
        self._row(t, {**self._latest, 'measurement': measurement})

    def _fire(self, values: list[float]) -> None:
        """Record one lockstep period."""
        if self.recording:
            self._index += 1
            self._row(self._index / self.pacing.rate, dict(zip(self._columns[1:], values)))

    def _row(self, t: float, values: dict[str, float]) -> None:
        self._run.add(self.metrics, t, values)
        self._rows += 1
        try:
            self.folder.write([t, *values.values()])
        except OSError as error:
            self._stop_on_full_disk(error)

    def _on_flush(self) -> None:
        self._watch.look()
        if self.recording:
            try:
                self.folder.flush()
            except OSError as error:
                self._stop_on_full_disk(error)
        values = self.metrics.values()
        for name, sender in self._senders.items():
            sender.send(float(getattr(values, name)))

    def _stop_on_full_disk(self, error: OSError) -> None:
        self.recording = False
        self.fail(f'{self.folder.path}: cannot write: {error.strerror}')

    # ---- services and reports ----

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        self._end_run()
        try:
            self._open_run()
        except OSError as error:
            response.success, response.message = False, f'cannot write: {error.strerror}'
            return response
        if self.failure:
            response.success, response.message = False, self.failure
            return response
        response.success = True
        response.message = f'a new run is recorded to {self.folder.path}'
        return response

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        try:
            if self.recording:
                self.folder.flush()
            self.folder.write_summary(self._summary())
        except OSError as error:
            response.success, response.message = False, f'cannot write: {error.strerror}'
            return response
        response.success, response.message = True, str(self.folder.path)
        return response

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        by_signal = self._lost_by_signal()
        lost = None if by_signal is None else sum(by_signal.values())
        unheard = [] if self.lockstep else [k for k, v in self._latest.items() if isnan(v)]
        values = {
            'rows': self._rows,
            'samples_lost': 'unknown' if lost is None else lost,
            'measured_rate': self._places.measured_rate,
            'waiting_for': ' '.join(unheard),
            'folder': self.folder.path,
        }
        first = [name for name in ('measurement', 'command') if name in unheard]
        if self.recording and first:  # without these there is no row
            return WARN, f'waiting for {" and ".join(first)}{self._best_effort(first)}', values
        if self._off_rate():
            measured, rate = self._places.measured_rate, self.pacing.rate
            message = f'measurements come at {measured:.4g} Hz and the rate is {rate:g} Hz'
            return WARN, f'{message}: the figures of this run are wrong', values
        if lost:
            return WARN, f'{lost} samples lost', values
        return OK, 'recording' if self.recording else 'done', values

    def _off_rate(self) -> bool:
        measured = 0.0 if self._simulated else self._places.measured_rate
        return measured > 0.0 and abs(measured / self.pacing.rate - 1.0) > OFF_RATE

    def _best_effort(self, names: list[str]) -> str:
        """Return how to hear those that are published, but not as reliably as is asked for."""
        for topic in (self._heard[name] for name in names):
            publishers = self.get_publishers_info_by_topic(topic)
            name = f'qos_overrides.{topic}.subscription.reliability'
            given = any(p.qos_profile.reliability == BEST_EFFORT for p in publishers)
            if given and self.get_parameter(name).value != 'best_effort':
                return f': {topic} is published as best effort, so start with {name} best_effort'
        return ''

    def close(self) -> None:
        """Write the summary."""
        self._end_run()


def main() -> int:
    """Run the recorder node."""
    NodeParser('recorder', DESCRIPTION, EXAMPLE).parse(sys.argv)
    return run(lambda: RecorderNode(arguments=sys.argv))


if __name__ == '__main__':
    raise SystemExit(main())
