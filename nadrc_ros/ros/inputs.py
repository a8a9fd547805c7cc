"""Inputs that nobody feeds: said within five seconds, with who publishes what instead."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from math import inf
import time

import attrs
from nadrc_ros.adrc.errors import near_to
from nadrc_ros.ros.diagnostics import OK, WARN
from nadrc_ros.ros.remarks import Remarks
from nadrc_ros.ros.topics import FLOAT64, Input
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

# An input without samples for so long [s], or for so many periods, is looked into; also for so
# many of the longest of the last intervals, of which so many are kept.
GRACE, PERIODS, INTERVALS, KEPT = 4.0, 5, 3.0, 5
# The whole graph is searched again for a name that is meant after so long [s].
SEARCH_AGAIN = 30.0
# Names of topics that are taken for the same one, misspelt.
CLOSE = 0.8


@attrs.define
class _Silence:
    """Since when an input has not been fed, how it was before, and what was said of it."""

    since: float
    count: int = 0
    intervals: deque[float] = attrs.field(factory=lambda: deque([0.0], maxlen=KEPT))
    told: str = ''
    like: str = ''
    searched: float = -inf

    def end(self, count: int, now: float) -> None:
        """Note that samples came."""
        if self.count:
            self.intervals.append(now - self.since)
        self.since, self.count, self.told = now, count, ''


class InputWatch:
    """
    Says of each input of a node why nothing comes, and when something does.

    It is told once a minute for each reason: nobody publishes the topic, perhaps a name like it;
    another type is published; the quality of service does not fit; or the publisher is silent. A
    regular input is watched for good, another one until its first sample.

    Parameters
    ----------
    node
        Whose inputs they are.
    inputs
        What it reads.
    remarks
        Where it is said.
    period
        Nominal period [s].
    now
        The time [s].

    """

    def __init__(
        self,
        node: Node,
        inputs: Sequence[Input],
        remarks: Remarks,
        period: float,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._node = node
        self._inputs = inputs
        self._remarks = remarks
        self._grace = max(GRACE, PERIODS * period)
        self._now = now
        self._silences = {each.topic: _Silence(now()) for each in inputs}

    def look(self) -> None:
        """Look at all inputs; to be called about once per second."""
        news: dict[tuple[str, bytes], list[str]] = defaultdict(list)
        held: dict[str, list[str]] = defaultdict(list)
        fed, now = [], self._now()
        for each in self._inputs:
            silence = self._silences[each.topic]
            if each.sole:
                self._tell_several(each.topic)
            if each.count != silence.count:
                if silence.told and self._remarks.due(f'{each.topic} fed'):
                    fed.append(each.topic)
                silence.end(each.count, now)
                continue
            patience = max(self._grace, INTERVALS * max(silence.intervals))
            if now - silence.since <= patience or (each.count and not each.regular):
                continue
            why, level = self._why(each, silence)
            if level is None:
                continue
            if level != OK:
                held[why].append(each.topic)
            if why != silence.told and self._remarks.due(f'{each.topic} {why}'):
                silence.told = why
                news[why, level].append(each.topic)
        for (why, level), topics in news.items():
            self._remarks.log(_line(why, topics), level)
        if fed:
            self._remarks.log(f'samples come on {", ".join(fed)}', OK)
        lines = '; '.join(_line(why, topics) for why, topics in held.items())
        self._remarks.hold('inputs', lines, WARN)

    def _tell_several(self, topic: str) -> None:
        several = self._node.count_publishers(topic) > 1
        names = self._publishers(topic) if several else []
        text = f'several publishers of {topic}: {", ".join(names)}'
        self._remarks.put(f'several {topic}', text if several else '')

    def _why(self, each: Input, silence: _Silence) -> tuple[str, bytes | None]:
        """Return why nothing comes, and at which level to say it."""
        publishers = self._node.get_publishers_info_by_topic(each.topic)
        if not publishers:
            like = self._like(each, silence)
            if not like:
                return 'nobody publishes it', each.silence
            return f'nobody publishes it{like}', OK if each.silence is None else WARN
        silence.searched = -inf
        names = ', '.join(sorted({node_of(info) for info in publishers}))
        types = sorted({info.topic_type for info in publishers})
        if FLOAT64 not in types:
            return f'{names} publishes it as {", ".join(types)}, and {FLOAT64} is needed', WARN
        unheard = [info for info in publishers if not _fits(info.qos_profile, each.qos)]
        if unheard:
            names = ', '.join(sorted({node_of(info) for info in unheard}))
            remedy = f'-p qos_overrides.{each.topic}.subscription.reliability:=best_effort'
            return f'{names} publishes it as best effort, heard only with {remedy}', WARN
        return f'{names} publishes it, and sends nothing', each.silence

    def _like(self, each: Input, silence: _Silence) -> str:
        """Return which topic may be meant; searched now and then, if optional only once."""
        pause = inf if each.silence is None else SEARCH_AGAIN
        if self._now() - silence.searched >= pause:
            silence.searched, silence.like = self._now(), self._search(each.topic)
        return silence.like

    def _search(self, topic: str) -> str:
        """
        Return which topic may be meant: one whose name is close, or of another namespace.

        A topic that has a reader is not meant for us, nor one in the namespace of another node of
        our name: the other axes of a machine.
        """
        node = self._node
        home = node.get_namespace().rstrip('/')
        homes = {
            space.rstrip('/')
            for name, space in node.get_node_names_and_namespaces()
            if name == node.get_name()
        }

        def is_free(name: str) -> bool:
            around = [space for space in homes if name.startswith(space + '/')]
            of = max(around, key=len, default=home)
            return of == home and bool(node.count_publishers(name))

        own = {
            name
            for name, _ in node.get_publisher_names_and_types_by_node(
                node.get_name(), node.get_namespace()
            )
        } | set(self._silences)
        there = {
            name: types
            for name, types in node.get_topic_names_and_types()
            if name not in own and is_free(name) and not node.count_subscribers(name)
        }
        if name := meant(topic, list(there)):
            names = ', '.join(self._publishers(name))
            return (
                f', but {names} publishes {name} as {", ".join(there[name])}: '
                'did you mean to remap?'
            )
        return ''

    def _publishers(self, topic: str) -> list[str]:
        return [node_of(p) for p in self._node.get_publishers_info_by_topic(topic)]


def meant(topic: str, there: Sequence[str]) -> str:
    """Return the topic that may be meant, if any: one that is close, or has the same last part."""
    last = topic.rpartition('/')[2]
    same = (name for name in there if name.rpartition('/')[2] == last)
    return near_to(topic, there, CLOSE) or next(same, '')


def node_of(info: TopicEndpointInfo) -> str:
    """Return the full name of the node that has an endpoint."""
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _fits(sent: QoSProfile, heard: QoSProfile) -> bool:
    """Tell whether a reader of ours hears a writer: it can ask for nothing else."""
    best_effort = sent.reliability == ReliabilityPolicy.BEST_EFFORT
    return not best_effort or heard.reliability == ReliabilityPolicy.BEST_EFFORT


def _line(why: str, topics: Sequence[str]) -> str:
    return f'nothing comes on {", ".join(topics)}: {why}'
