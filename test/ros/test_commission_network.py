"""`nadrc commission` behind a network that is cut in the middle of an experiment."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
import random
import time

from network import Inside, Link, refusal, Sample
from probe import NodeProcess
import pytest
from test_commission_command import BOUNDS, CONTROL, IN_TIME, PLANT, RATE, SLACK
from test_network import wait_until

DOMAIN = '101'  # of no other test but that of the network
CONTROLLER = '/network/controller'
PARAMETERS = f"""
from nadrc_ros.commission.graph_machine import reached
with reached('{CONTROLLER}') as machine:
    print({{name: value for name, value in sorted(machine.values.items())}})
"""


class Remote:
    """A plant and a disabled controller at one end of a link, the command at the other."""

    def __init__(self, link: Link, near: Inside, far: Inside) -> None:
        self.link, self._near, self._far = link, near, far
        self.heard = near.observe('command', 'measurement')
        near('plant', **PLANT)
        self._controller = near('controller', **CONTROL)
        wait_until(lambda: self.heard.of('measurement'))
        self._runs = 0
        self.before = self.parameters()

    def parameters(self) -> str:
        """Return all parameters, as another process beside the controller reads them."""
        self._runs += 1
        process = self._near.run(f'parameters_{self._runs}', '-c', PARAMETERS)
        assert process.end() == 0, process.said
        return process.said.splitlines()[-1]

    def command(self) -> NodeProcess:
        """Start the command line."""
        self._runs += 1
        out = str(self._far.directory / f'out_{self._runs}')
        words = ('commission', '--controller', CONTROLLER, *BOUNDS, '--yes', '--out', out)
        return self._far.run(f'commission_{self._runs}', '-m', 'nadrc_ros.cli', *words)

    def cut(self, delay: float) -> float:
        """Cut the link some time into an experiment; return how soon that was over [s]."""
        sent, process = self.heard.of('command'), self.command()
        count = len(sent)
        wait_until(lambda: self.changes(count) or not process.running)
        assert process.running, process.said
        time.sleep(delay)
        begin = self.link.set(loss=1.0)
        assert process.end() == 1, process.said
        assert f'{CONTROLLER} is not heard any more' in process.said
        self.link.set()
        assert self._controller.running and self.parameters() == self.before
        after = [sample for sample in self.heard.of('command')[count:] if sample.time > begin]
        assert len(after) > 3, 'it was over before the cut'
        assert after[-1].value == CONTROL['safe_command']
        check_rate(self.heard.of('command')[count:])
        return after[-1].time - begin

    def changes(self, count: int) -> bool:
        """Tell whether anything but the safe command was sent since then."""
        sent = self.heard.of('command')[count:]
        return any(sample.value != CONTROL['safe_command'] for sample in sent)


def check_rate(sent: list[Sample]) -> None:
    """Check the rate limit, between samples that are sent up to a period later than due."""
    limit, late = CONTROL['command_rate_limit'], 1.0 / RATE
    for a, b in pairwise(sent):
        assert abs(b.value - a.value) <= limit * (b.time - a.time + late), (a, b)


def test_p23_a_cut_network_ends_an_experiment_and_changes_nothing(
    soak: bool, seed: int, tmp_path: Path
) -> None:
    """Once, with --soak six times at random instants."""
    if reason := refusal():
        pytest.skip(f'DID NOT RUN: {reason}')
    chance, link = random.Random(seed), Link(seed)
    near, far = ends = [Inside(link, end, '/network', tmp_path) for end in link.ends]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
        patch.setenv('ROS_DOMAIN_ID', DOMAIN)
        try:
            remote = Remote(link, near, far)
            for delay in [chance.uniform(0.0, 4.0) for _ in range(6)] if soak else [0.5]:
                seconds = remote.cut(delay)
                print(f'cut {delay:.2f} s into an experiment: safe after {seconds:.3f} s')
                assert seconds < IN_TIME + 1.0 / RATE + SLACK
        finally:
            for end in ends:
                end.kill()
            link.close()
