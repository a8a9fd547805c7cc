"""Inputs that nobody feeds: said within five seconds, with who publishes what instead."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from difflib import get_close_matches
import time

import attrs
from nadrc_ros.nodes.diagnostics import OK, WARN
from nadrc_ros.nodes.remarks import Remarks
from nadrc_ros.nodes.topics import FLOAT64, Input
from rclpy.node import Node
from rclpy.qos import qos_check_compatible, QoSCompatibility
from rclpy.topic_endpoint_info import TopicEndpointInfo

# An input without samples for so long [s], or for so many periods, is looked into.
GRACE, PERIODS = 4.0, 5
# Names of topics that are taken for the same one, misspelt.
CLOSE = 0.8


@attrs.define
class _Silence:
    """For how long an input has not been fed, and what was said of it."""

    count: int = 0
    since: float = attrs.field(factory=time.monotonic)
    told: str = ''


class InputWatch:
    """
    Says of each input of a node why nothing comes, and when something does.

    It is told once for each reason: nobody publishes the topic, perhaps a name like it; another
    type is published; the quality of service does not fit; or the publisher is silent. An input
    whose silence is a warning is watched for good, another one until its first sample.

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

    """

    def __init__(
        self, node: Node, inputs: Sequence[Input], remarks: Remarks, period: float
    ) -> None:
        self._node = node
        self._inputs = inputs
        self._remarks = remarks
        self._grace = max(GRACE, PERIODS * period)
        self._silences = {each.topic: _Silence() for each in inputs}

    def look(self) -> None:
        """Look at all inputs; to be called about once per second."""
        news: dict[tuple[str, bytes], list[str]] = defaultdict(list)
        held: dict[str, list[str]] = defaultdict(list)
        fed = []
        for each in self._inputs:
            silence = self._silences[each.topic]
            if each.sole:
                self._tell_several(each.topic)
            if each.count != silence.count:
                fed += [each.topic] if silence.told else []
                self._silences[each.topic] = _Silence(each.count)
                continue
            too_long = time.monotonic() - silence.since > self._grace
            if not too_long or (each.count and each.silence != WARN):
                continue
            why, wrong = self._why(each)
            level = WARN if wrong else each.silence
            if level is None:
                continue
            if level != OK:
                held[why].append(each.topic)
            if why != silence.told:
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

    def _why(self, each: Input) -> tuple[str, bool]:
        """Return why nothing comes, and whether that is a mistake whatever the input is for."""
        publishers = self._node.get_publishers_info_by_topic(each.topic)
        if not publishers:
            like = self._like(each.topic)
            return f'nobody publishes it{like}', bool(like)
        names = ', '.join(sorted({publisher_name(info) for info in publishers}))
        types = sorted({info.topic_type for info in publishers})
        if FLOAT64 not in types:
            return f'{names} publishes it as {", ".join(types)}, and {FLOAT64} is needed', True
        for info in publishers:
            fits, reason = qos_check_compatible(info.qos_profile, each.qos)
            if fits == QoSCompatibility.ERROR:
                remedy = (
                    f'start with qos_overrides.{each.topic}.subscription.reliability = best_effort'
                )
                return f'{names} publishes it, but {reason.strip(" ;")}: {remedy}', True
        return f'{names} publishes it, and sends nothing', False

    def _like(self, topic: str) -> str:
        """Return which topic may be meant: one whose name is close, or of another namespace."""
        own = {
            name
            for name, _ in self._node.get_publisher_names_and_types_by_node(
                self._node.get_name(), self._node.get_namespace()
            )
        } | set(self._silences)
        there = {
            name: types
            for name, types in self._node.get_topic_names_and_types()
            if name not in own and self._node.count_publishers(name)
        }
        last = topic.rpartition('/')[2]
        same = [name for name in there if name.rpartition('/')[2] == last]
        for name in get_close_matches(topic, there, n=1, cutoff=CLOSE) or same[:1]:
            names = ', '.join(self._publishers(name))
            return (
                f', but {names} publishes {name} as {", ".join(there[name])}: '
                'did you mean to remap?'
            )
        return ''

    def _publishers(self, topic: str) -> list[str]:
        return [publisher_name(p) for p in self._node.get_publishers_info_by_topic(topic)]


def publisher_name(info: TopicEndpointInfo) -> str:
    """Return the full name of the node that has an endpoint."""
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _line(why: str, topics: Sequence[str]) -> str:
    return f'nothing comes on {", ".join(topics)}: {why}'
