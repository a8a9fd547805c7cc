"""What a node sees of the graph around it, and says of it: namesakes, inputs and outputs alone."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from math import inf
import time

import attrs
from nadrc_ros.adrc.errors import near_to
from nadrc_ros.ros.diagnostics import ERROR, OK, Remarks, WARN
from nadrc_ros.ros.topics import Input, Sender
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

# A node that was killed is listed for 20 s: what is there for longer lives [s].
LISTED = 22.0
# A node that is being stopped and started anew may be listed twice for so many looks.
_LISTED_TWICE = 2
# An input without samples for so long [s], or for so many periods, is looked into; also for so
# many of the longest of the last intervals, of which so many are kept.
GRACE = 4.0
_PERIODS, _INTERVALS, _KEPT = 5, 3.0, 5
# The whole graph is searched again for a name that is meant after so long [s].
_SEARCH_AGAIN = 30.0
# Names of topics that are taken for the same one, misspelt.
_ALIKE = 0.8
# So many looks without a reader until it is said: one that starts is there by then.
LOOKS = 5


def node_of(info: TopicEndpointInfo) -> str:
    """Return the full name of the node that has an endpoint."""
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def publishers(node: Node, topic: str) -> list[str]:
    """Return the full name of the node of each publisher of a topic."""
    return sorted(map(node_of, node.get_publishers_info_by_topic(topic)))


def readers(node: Node, topic: str) -> list[str]:
    """Return who subscribes to a topic, but for the node itself."""
    there = node.get_subscriptions_info_by_topic(topic)
    return sorted({node_of(info) for info in there} - {node.get_fully_qualified_name()})


def missing_readers(
    node: Node, namespace: str, expected: Mapping[str, Sequence[str]]
) -> list[tuple[str, str]]:
    """Return topic and node name of each expected reader that is not there in a namespace."""
    missing = []
    for topic, names in expected.items():
        there = {
            info.node_name
            for info in node.get_subscriptions_info_by_topic(topic)
            if info.node_namespace == namespace
        }
        missing += [(topic, name) for name in names if name not in there]
    return missing


def meant(topic: str, there: Sequence[str]) -> str:
    """Return the topic that may be meant, if any: one that is close, or has the same last part."""
    last = topic.rpartition('/')[2]
    same = (name for name in there if name.rpartition('/')[2] == last)
    return near_to(topic, there, _ALIKE) or next(same, '')


class Namesakes:
    """
    Says that another node has our full name: a WARN, and an ERROR once it cannot be a dead one.

    What is asked of that name reaches either of the two. Nothing is refused, as a node that is
    started anew after a kill must run at once.
    """

    def __init__(
        self, node: Node, remarks: Remarks, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._node = node
        self._remarks = remarks
        self._now = now
        self._since = inf

    def look(self) -> None:
        """Look who is there; to be called once per second."""
        name, now = self._node.get_fully_qualified_name(), self._now()
        # asked of one service, as the list of all nodes is long where there are many
        another = self._node.count_services(f'{name}/get_parameters') > 1
        self._since = min(self._since, now) if another else inf
        alive = now - self._since > LISTED
        known = '' if alive else ', unless it was killed less than 20 s ago'
        text = (
            f'another node is called {name} too{known}: services and parameters reach either of '
            'them; rename one with -r __node:=...'
        )
        self._remarks.put(
            'namesake',
            text if another else '',
            ERROR if alive else WARN,
            looks=_LISTED_TWICE,
            over=f'no other node is called {name} any more',
        )


@attrs.define
class _Silence:
    """Since when an input has not been fed, how it was before, and what was said of it."""

    since: float
    count: int = 0
    intervals: deque[float] = attrs.field(factory=lambda: deque([0.0], maxlen=_KEPT))
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

    It is told once a minute for each reason, in one line for all inputs that have it: nobody
    publishes the topic, but one of a name like it, or ``unseen()`` says why who does would not be
    seen; another type is published; the quality of service does not fit; or the publisher is
    silent. A regular input is watched for good, another one until its first sample. Silence is
    patient: three times the longest of the last intervals, for a sensor that is slow is not one
    that is broken.
    """

    def __init__(
        self,
        node: Node,
        inputs: Sequence[Input],
        remarks: Remarks,
        period: float,
        now: Callable[[], float] = time.monotonic,
        unseen: Callable[[], str] = str,
    ) -> None:
        self._node = node
        self._inputs = inputs
        self._remarks = remarks
        self._grace = max(GRACE, _PERIODS * period)
        self._now = now
        self._unseen = unseen
        self._began = now()
        self._silences: dict[Input, _Silence] = {}

    def look(self) -> None:
        """Look at all inputs; to be called about once per second."""
        news: dict[tuple[str, bytes], list[str]] = defaultdict(list)
        held: dict[str, list[str]] = defaultdict(list)
        fed, now = [], self._now()
        for each in self._inputs:
            silence = self._silences.setdefault(each, _Silence(self._began))
            if each.sole:
                self._tell_several(each.topic)
            if each.count != silence.count:
                if silence.told and self._remarks.due(f'{each.topic} fed'):
                    fed.append(each.topic)
                silence.end(each.count, now)
                continue
            patience = max(self._grace, _INTERVALS * max(silence.intervals))
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
        names = publishers(self._node, topic) if self._node.count_publishers(topic) > 1 else []
        text = f'several publishers of {topic}: {", ".join(names)}'
        self._remarks.put(f'several {topic}', text if names else '')

    def _why(self, each: Input, silence: _Silence) -> tuple[str, bytes | None]:
        """Return why nothing comes, and at which level to say it."""
        there = self._node.get_publishers_info_by_topic(each.topic)
        if not there:
            like = self._like(each, silence)
            if like:
                return f'nobody publishes it{like}', OK if each.silence is None else WARN
            return f'nobody publishes it{self._unseen()}', each.silence
        silence.searched = -inf
        names = ', '.join(sorted({node_of(info) for info in there}))
        types = sorted({info.topic_type for info in there})
        if each.message_type not in types:
            return (
                f'{names} publishes it as {", ".join(types)}, and {each.message_type} is needed',
                WARN,
            )
        unheard = [info for info in there if not _fits(info.qos_profile, each.qos)]
        if unheard:
            names = ', '.join(sorted({node_of(info) for info in unheard}))
            remedy = f'-p qos_overrides.{each.topic}.subscription.reliability:=best_effort'
            return f'{names} publishes it as best effort, heard only with {remedy}', WARN
        if each.absent:
            return str(each.absent), WARN
        return f'{names} publishes it, and sends nothing', each.silence

    def _like(self, each: Input, silence: _Silence) -> str:
        """Return which topic may be meant; searched now and then, if optional only once."""
        pause = inf if each.silence is None else _SEARCH_AGAIN
        if self._now() - silence.searched >= pause:
            silence.searched, silence.like = self._now(), self._search(each.topic)
        return silence.like

    def _search(self, topic: str) -> str:
        """
        Return which topic may be meant: one whose name is close, or of another namespace.

        A topic that has a reader is not meant for us, nor one in the namespace of another node of
        our name: the other axes of a machine.
        """
        node, home = self._node, self._node.get_namespace().rstrip('/')
        there = node.get_node_names_and_namespaces()
        homes = {space.rstrip('/') for name, space in there if name == node.get_name()}
        sent = node.get_publisher_names_and_types_by_node(node.get_name(), node.get_namespace())
        own = {name for name, _ in sent} | {each.topic for each in self._inputs}

        def is_free(name: str) -> bool:
            around = [space for space in homes if name.startswith(space + '/')]
            if name in own or max(around, key=len, default=home) != home:
                return False
            return bool(node.count_publishers(name)) and not node.count_subscribers(name)

        free = {name: ts for name, ts in node.get_topic_names_and_types() if is_free(name)}
        if name := meant(topic, list(free)):
            names, types = ', '.join(publishers(node, name)), ', '.join(free[name])
            return f', but {names} publishes {name} as {types}: did you mean to remap?'
        return ''


class OutputWatch:
    """Warns while a node acts and nobody subscribes to what it sends; says who may be meant to."""

    def __init__(self, node: Node, sender: Sender, remarks: Remarks) -> None:
        self._node = node
        self._topic, self._type = sender.topic, sender.message_type
        self._remarks = remarks
        self._untaken = 0
        self._like = ''

    def look(self, acting: bool) -> None:
        """Look who subscribes; to be called once per second."""
        untaken = acting and not readers(self._node, self._topic)
        self._untaken = self._untaken + 1 if untaken else 0
        if self._untaken % _SEARCH_AGAIN == LOOKS:
            self._like = self._search()
        text = f'nobody subscribes to {self._topic}, so the commands move nothing{self._like}'
        self._remarks.put('takers', text if self._untaken >= LOOKS else '')

    def _search(self) -> str:
        """Return which topic may be meant: one that is read, and that nobody publishes."""
        node = self._node
        free = [
            name
            for name, types in node.get_topic_names_and_types()
            if self._type in types and not node.count_publishers(name) and readers(node, name)
        ]
        if name := meant(self._topic, free):
            names = ', '.join(readers(node, name))
            return f', but {names} subscribes to {name}: did you mean to remap?'
        return ''


def _fits(sent: QoSProfile, heard: QoSProfile) -> bool:
    """Tell whether a reader of ours hears a writer: it can ask for nothing else."""
    best_effort = sent.reliability == ReliabilityPolicy.BEST_EFFORT
    return not best_effort or heard.reliability == ReliabilityPolicy.BEST_EFFORT


def _line(why: str, topics: Sequence[str]) -> str:
    return f'nothing comes on {", ".join(topics)}: {why}'
