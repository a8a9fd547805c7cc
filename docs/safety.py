"""Writes the generated parts of docs/safety.md, and its picture: `python docs/safety.py`."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from itertools import product
from math import inf, nan
from pathlib import Path
import re

from marked import filled
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.adrc.supervisor import PolicyState, Stall, supervise
from states import draw

PAGE = Path(__file__).with_name('safety.md')
PICTURE = PAGE.with_name('states.svg')
TESTS = PAGE.parents[1] / 'test'
PROMISES = (
    'A NaN or infinite measurement or reference never reaches the observer: estimates and profile '
    'stay bit-identical, only the mean of the command over the gap goes on, and the status says '
    'so.',
    'A published command is always finite and within its limits, whatever comes in.',
    'NaN never turns into a full-scale command: it is rejected before clamping.',
    'No lasting effect: after bad samples the loop is back in its band within a stated number of '
    'good ones.',
    'The command changes by at most rate limit x time, and by no less if the law asks for more, '
    'however rare the samples are; also at a start, a retune, a switch of structure and at '
    'both ends of a fault. Two exceptions, both logged: a range that is narrowed is entered at '
    'once, and at a stop the ramp ends after 0.5 s with the safe command. Where another command '
    'is reported to act, the change may count from that, and a fault goes to it in one tick.',
    'The observers are driven by the command that was applied: ten seconds in saturation leave no '
    'windup that grows, and a bounded overshoot.',
    'When no valid measurement comes for `measurement_timeout`, the fault action starts within '
    'one period and /diagnostics reports ERROR: hold for at most `hold_time`, then to '
    '`safe_command` at the rate limit.',
    'Before `good_samples` valid measurements in a row only the safe command is sent. Before the '
    'first reference, the last of them is held; with `good_samples` from 3, one odd reading never '
    'becomes a setpoint, at the start, at enabling or after a fault.',
    'Late, duplicated or reordered samples, and stamps from the future, are counted and do not '
    'corrupt the estimate.',
    'A time step that is not positive updates nothing; after more than `max_dt`, or a jump of the '
    'clock, the observers restart without a bump.',
    'Enabling is bumpless: the first command is the last applied or the safe one, within 1e-9.',
    'A live change of parameters is atomic, acts between two steps, and leaves the command of the '
    'present sample as it is, to 1e-9. After it, after a gap and after a reset, the loop rejects '
    'a load as one that began with those settings.',
    'An invalid parameter is rejected with a reason that names it, and `get_parameters` always '
    'shows the values in use. A parameter file or argument that is invalid, or is for a node that '
    'is not here, ends the start with a message that says what to write, and exit code 1.',
    'After disabling, SIGINT, SIGTERM, SIGHUP or an exception the last published command is the '
    'safe one; a signal ends the process with 0 within a second.',
    'The plant does not trust the controller: it falls to its own safe command after '
    '`command_timeout`.',
    'No request from outside ends a node: wrong types, unknown parameters, garbage, odd QoS.',
    'Overload is visible and bounded: no burst to catch up, missed periods are counted.',
    'Deterministic: the same inputs give the same bits. A lockstep run replays from the scenario, '
    "a real-time run from the controller's `trace`, to the published commands.",
    'Of several faults the most severe acts; leaving one takes `good_samples` good samples; each '
    'transition is logged once.',
    'Under random faults for a long time nothing grows, the log is not flooded, and no record is '
    'lost.',
)
NUMBERED = dict(enumerate(PROMISES, 1)) | {
    21: 'The live page changes nothing without its token, from a foreign origin or host, or by '
    'GET. A loop under a lease (`~/keep`) is disabled, as by `~/enable` false, within one period '
    'after the lease has run out, so without the heartbeat of a page within 0.5 s. A message on '
    '`~/keep` enables nothing, nor does one that comes too late renew anything.',
    22: 'STOP on the live page acts within 100 ms plus one period whatever else the page does; a '
    'page that is slow, frozen, closed or killed costs the controller nothing.',
    23: 'An experiment of commissioning sends no command out of its bounds, and ends when its '
    'sensor falls silent.',
    24: 'No bytes of any message type on a wired topic end a node or enter an observer unless '
    'they are the number that was asked for.',
    25: 'A managed controller sends nothing but the safe command unless it is active. A '
    'transition that its state does not allow changes nothing, whatever was asked before.',
}
DESIGN = make_design(
    ControllerSettings(reference_timeout=1.0, stall_time=1.0, stall_action='fault')
)
# enabled, measured, referenced, ages of the last valid measurement and reference before the tick
PRESENT = {
    Cause.NONE: (True, True, True, 0.0, 0.0),
    Cause.REFERENCE_TIMEOUT: (True, True, False, 0.0, 10.0),
    Cause.STALLED: (True, True, True, 0.0, 0.0),
    Cause.MEASUREMENT_TIMEOUT: (True, False, True, 10.0, 0.0),
    Cause.START: (True, False, True, inf, 0.0),
    Cause.DISABLED: (False, True, True, 0.0, 0.0),
}


def promise_table() -> str:
    """Return the promises with the tests that hold them."""
    found: dict[int, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted(TESTS.rglob('test_*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.FunctionDef) and node.name.startswith('test_p'):
                for number, words in _promises(node.name):
                    found[number][str(path.relative_to(PAGE.parents[1]))].append(words)
    rows = ['| | promise | tests |', '|---|---|---|']
    for number, promise in NUMBERED.items():
        tests = '<br>'.join(
            f'[{Path(name).stem.removeprefix("test_")}](../{name}): ' + '; '.join(words)
            for name, words in found[number].items()
        )
        rows.append(f'| {number} | {promise} | {tests} |')
    return '\n'.join(rows)


def _promises(name: str) -> Iterator[tuple[int, str]]:
    """Yield the numbers in a test's name, each with the words that follow it."""
    for part in re.finditer(r'p(\d\d)_((?:(?!p\d\d_).)*)', name):
        words = part[2].strip('_') or re.sub(r'.*p\d\d_', '', name)
        yield int(part[1]), words.replace('_', ' ')


def picture() -> str:
    """Return what the fault policy does, as it does it: every transition from every state."""
    edges: dict[tuple[Mode, Mode], set[str]] = defaultdict(set)
    for mode, cause in product(Mode, Cause):
        if (mode == Mode.OK) != (cause == Cause.NONE):
            continue
        for present, (enabled, measured, referenced, y_age, r_age) in PRESENT.items():
            if present == Cause.START and mode != Mode.SAFE:
                continue  # there was a measurement, or it would not have left SAFE
            stimuli = {_name(present): (0.0, False)}
            if cause not in (Cause.NONE, Cause.DISABLED):
                stimuli |= {
                    'hold_time is over': (10.0, False),
                    'safe_command reached': (0.0, True),
                }
            for label, (age, at_safe) in stimuli.items():
                before = PolicyState(mode, cause, y_age, r_age, age, good=DESIGN.good_samples)
                if present == Cause.STALLED:
                    before = before._replace(stall=Stall(stalled=10.0, aim=1.0, distance=1.0))
                plain = before._replace(fault_age=0.0)
                there = Sample(
                    0.0 if measured else nan, 0.01, 0.01, 0.0, DESIGN.safe_command + (not at_safe)
                )
                elsewhere = there._replace(applied=DESIGN.safe_command + 1.0)
                rest = measured, referenced, enabled, True, 1.0, there.measurement
                after = supervise(DESIGN, before, there, *rest).mode
                same = supervise(DESIGN, plain, elsewhere, *rest).mode
                if after != mode and (label == _name(present) or after != same):
                    edges[mode, Mode(after)].add(label)
    return draw([mode.name for mode in Mode], {tuple(edge): edges[edge] for edge in edges})


def _name(cause: Cause) -> str:
    return 'good samples' if cause == Cause.NONE else cause.name.lower()


def page() -> str:
    """Return the page with its generated parts as they have to be."""
    return filled(PAGE, {'promises': promise_table()})


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
    PICTURE.write_text(picture(), encoding='utf-8')
