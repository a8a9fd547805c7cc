"""The node beside a controller that hears what a page shows, and asks for what a page wants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from functools import partial
from math import nan
import time
from typing import Any

import attrs
from diagnostic_msgs.msg import DiagnosticArray
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import build, declared, flag, text
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.live.blocks import Array, GAP, Ring, thin, THINNED
from nadrc_ros.live.peer import ControllerPeer, Peer, RecorderPeer
from nadrc_ros.live.search import absence, controllers
from nadrc_ros.nodes.recorder_intake import Intake
from nadrc_ros.records.history import History
from nadrc_ros.records.recording import NEEDED, topic_of, TRUTH
from nadrc_ros.records.rows import Row
from nadrc_ros.records.spacing import Spacing
from nadrc_ros.ros.diagnostics import receive_events
from nadrc_ros.ros.graph import publishers
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.pacing import steady_timer
from nadrc_ros.ros.parameter_watch import ASK_AGAIN, ParameterWatch
from nadrc_ros.ros.topics import Info
import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy

_BLOCK, _LOOK = 0.05, 0.2  # [s]
# A page that hangs may cost the controller nothing: no reader that it would wait for.
_HEAR = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
# What is kept: so many seconds, and so many rows at most.
KEPT, MOST_ROWS = 300.0, 400_000
# A plot shows no more bins than that of one block.
_BINS = 50
# The program that commissions a controller holds it by a node of this name.
_COMMISSIONER = '/commission'
_FIRST = (
    *('reference', 'measurement', 'tracking', 'output_estimate', 'command'),
    'disturbance_estimate',
)
# Kinds of messages, and what is in them.
Post = Callable[[str, dict[str, Any]], None]


@attrs.frozen(kw_only=True)
class LiveSettings:
    """Which loop a page shows."""

    controller: str = text('controller', 'name of the controller node', live=False)
    plant: str = text('plant', 'name of a simulated plant, for its ~/output', live=False)
    recorder: str = text('recorder', 'name of the recorder, for its run', live=False)
    read_only: bool = flag(False, 'whether nothing can be changed', live=False)


@attrs.frozen
class Report:
    """What a node said of itself on /diagnostics, at a ``time`` of the steady clock [s]."""

    time: float
    level: int
    text: str
    values: dict[str, str]


class Monitor(LiveNode):
    """
    Hears the signals of a loop as a recorder does, its parameters, events and diagnostics.

    What happens is posted: rows of samples as ``('rows', {rows, flags})``, changed parameters,
    events, and ``('changed', {})`` when nodes or signals are others than they were. All of that
    is on the thread of the executor; what is public here may be read by any thread.

    Attributes
    ----------
    post
        Called with what happens.
    began
        The wall clock at t = 0.
    controller, plant, recorder
        The full names of nodes.
    absent
        That the controller is waited for, and who is there instead; '' once it told what it is.
    signals
        The columns of the rows after the time.
    ring
        The rows of the last minutes.
    descriptors
        Of the controller's parameters, by name.
    reports
        What nodes said of themselves, by their full names.

    """

    default_name = 'live'

    def set_up(self) -> None:
        """Declare the parameters and join the graph."""
        self.settings = self.declare(LiveSettings)
        self.post: Post = lambda kind, content: None
        self.controller, self.plant, self.recorder = (
            self.resolve_topic_name(name)
            for name in (self.settings.controller, self.settings.plant, self.settings.recorder)
        )
        self.peer = None if self.settings.read_only else ControllerPeer(self, self.controller)
        self._asked = Peer(self, self.controller)
        self.recording = RecorderPeer(self, self.recorder)
        self.plant_peer: Peer | None = None
        self.descriptors: dict[str, Any] = {}
        self.reports: dict[str, Report] = {}
        self._undescribed, self._asked_at = False, 0.0
        self._commissioner, self.absent = False, f'waiting for {self.controller}'
        self._known: dict[str, dict[str, Any]] = {}
        self._gain = 0.0
        self.signals: tuple[str, ...] = ()
        self.ring = Ring(1, KEPT, MOST_ROWS)
        self._listen(names_for(None))
        self.began = datetime.now(timezone.utc)
        self._zero = self.intake.now()
        told = [f'{name}/event' for name in (self.controller, self.plant, self.recorder)]
        self._watch = ParameterWatch(self, (*NEEDED, *told), self._on_parameters)
        for source in (self.controller, self.plant, self.recorder):
            receive_events(self, source, self._on_event)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        steady_timer(self, _BLOCK, self._on_block)
        steady_timer(self, _LOOK, self._on_look)

    def _listen(self, signals: tuple[str, ...]) -> None:
        """Hear these signals, instead of those that were heard, of which the rows are kept."""
        ring = Ring(1 + len(signals), KEPT, MOST_ROWS)
        old = self.ring.between(self.ring.first, self.ring.last)
        named, unknown = dict(zip(self.signals, old[:, 1:].T)), np.full(len(old), nan)
        ring.add(np.column_stack([old[:, 0], *(named.get(name, unknown) for name in signals)]))
        for each in self.inputs:
            self.destroy_subscription(each.subscription)
        self.inputs.clear()
        topics = {
            name: topic_of(name, self.settings.plant, self.settings.controller) for name in signals
        }
        self.signals, self.ring = signals, ring
        self._spacing, self._last = Spacing(), nan
        self.intake = Intake(self, topics, float('inf'), 0.0, eager=True, qos=_HEAR, watched=False)

    # ---- what any thread may ask ----

    def now(self) -> float:
        """Return the time t [s]."""
        return self.at(self.intake.now())

    def at(self, moment: int) -> float:
        """Return the t [s] of a moment [ns]."""
        return (moment - self._zero) * 1e-9

    def parameters(self, node: str) -> dict[str, Any]:
        """Return the parameters of a node, as far as it told them."""
        return dict(self._known.get(node, {}))

    @property
    def experiment(self) -> str:
        """Return which experiment of commissioning runs, '' if none does."""
        report = self.reports.get(self.controller)
        return report.values.get('commission', '') if report is not None else ''

    @property
    def commissioned(self) -> str:
        """Return why pages may only watch and stop: somebody commissions it; '' if nobody does."""
        if self.experiment:
            return f'a commissioning experiment runs ({self.experiment})'
        return 'nadrc commission has this controller' if self._commissioner else ''

    @property
    def simulated(self) -> bool:
        """Tell whether the plant is a node of this package."""
        return {'plant', 'noise_variance'} <= self.parameters(self.plant).keys()

    def controller_settings(self) -> ControllerSettings | None:
        """Return what the controller runs with, None for a node of another kind."""
        return settings_of(self.parameters(self.controller))

    # ---- samples ----

    def _on_block(self) -> None:
        self.intake.begin_without_command()
        _, rows = self.intake.close()
        for gap in self.intake.gaps():
            begin, end = self.at(gap.time), self.at(gap.time + gap.length)
            cause = f'{gap.lost} samples were lost' if gap.lost else 'nothing was sent'
            text = f'no {gap.signal} for {end - begin:.4g} s: {cause}'
            told = {'t': begin, 'node': '', 'kind': 'gap', 'text': text, 'signal': gap.signal}
            self.post('event', told | {'from': begin, 'to': end})
        if rows:
            self._take(rows)

    def _take(self, rows: list[Row]) -> None:
        assert self.intake.begin is not None
        offset, found, flags = self.at(self.intake.begin), [], 0
        for row in rows:
            t = offset + row.time
            if self._last == self._last:
                span = t - self._last
                if self._spacing.is_gap(span):
                    found.append([self._last + self._spacing.usual, *[nan] * len(self.signals)])
                    flags |= 0 if len(found) > 1 else GAP
                self._spacing.add(span)
            self._last = t
            found.append([t, *row.values.values()])
        block = self._refer(np.array(found))
        self.ring.add(block)
        if len(block) > 2 * _BINS:
            block, flags = thin(block, _BINS), flags | THINNED
        self.post('rows', {'rows': block, 'flags': flags})

    def _refer(self, rows: Array) -> Array:
        """
        Let the true disturbance be that for b0 of the controller, which is what it estimates.

        Where that takes more than another b0, as with known poles or a dead time, it stays that
        for the plant's own.
        """
        if self._gain:
            signals = self.signals
            command = rows[:, 1 + signals.index('command')]
            rows[:, 1 + signals.index('total_disturbance')] += self._gain * command
        return rows

    def _refer_anew(self) -> None:
        settings, history = self.controller_settings(), History()
        history.take(None, self.plant, self.parameters(self.plant))
        gain, (delay, _) = history.plant_gain(), history.plant_delay()
        self._gain = 0.0
        if settings is None or not gain or delay or len(settings.b0_table) > 1:
            return
        if not any(settings.known_poles):
            self._gain = gain[0][1] - settings.b0

    # ---- the graph ----

    def _on_look(self) -> None:
        self._watch.look()
        known = self.controller in self._known
        self.absent = '' if known else absence(controllers(self), self.controller)
        self.intake.rewire()
        holders = publishers(self, f'{self.controller}/keep')
        self._commissioner = any(name.endswith(_COMMISSIONER) for name in holders)
        now = time.monotonic()
        if self._undescribed and now - self._asked_at > ASK_AGAIN and self._asked.ready:
            self._asked_at = now
            names = list(self.parameters(self.controller))
            self._asked.describe(names).add_done_callback(partial(self._on_described, names))

    def _on_described(self, names: list[str], done: Any) -> None:
        self.descriptors = dict(zip(names, done.result().descriptors))
        self._undescribed = False
        self.post('changed', {})

    def _on_parameters(self, node: str, values: Mapping[str, Any], info: Info | None) -> None:
        before = dict(self._known.get(node, {}))
        self._known[node] = dict(values) if info is None else before | dict(values)
        self._refer_anew()
        if node == self.controller:
            settings = self.controller_settings()
            self.intake.follow(node, self.parameters(node))
            if names_for(settings) != self.signals:
                self._listen(names_for(settings))
                self.intake.follow(node, self.parameters(node))
                self.post('changed', {})
        if info is None:
            self._undescribed, self._asked_at = self._undescribed or node == self.controller, 0.0
            if node == self.plant and self.simulated and not self.settings.read_only:
                self.plant_peer = self.plant_peer or Peer(self, node)
            other = any(before[name] != values[name] for name in before.keys() & values.keys())
            self.post('changed', {'node': node, 'anew': other and node == self.controller})
            return
        told = {'node': node, 'values': dict(values), 't': self.now()}
        self.post('parameters', told | {'before': {n: before.get(n) for n in values}})

    def _on_event(self, node: str, kind: str, message: str, info: Info) -> None:
        self.post('event', {'t': self.now(), 'node': node, 'kind': kind, 'text': message})

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            if status.name in (self.controller, self.plant, self.recorder):
                values = {pair.key: pair.value for pair in status.values}
                before = self.reports.get(status.name)
                report = Report(time.monotonic(), status.level[0], status.message, values)
                self.reports[status.name] = report
                mode = ('mode', 'cause', 'enabled')
                if before is None or any(before.values.get(k) != values.get(k) for k in mode):
                    self.post('state', {})


def names_for(settings: ControllerSettings | None) -> tuple[str, ...]:
    """Return the signals that a page shows of a controller with these settings."""
    if settings is None:
        return (*_FIRST, *TRUTH)
    levels = [f'level_{k + 1}' for k in range(make_design(settings).levels)]
    applied = ['applied'] if settings.applied_timeout > 0.0 else []
    return (*_FIRST, *levels, *TRUTH, *applied)


def settings_of(parameters: Mapping[str, Any]) -> ControllerSettings | None:
    """Return the settings that the parameters of a controller say, None if they say none."""
    own = {name: parameters[name] for name in declared(ControllerSettings) if name in parameters}
    try:
        return build(ControllerSettings, own) if 'inner_bandwidth' in own else None
    except UserError:
        return None
