"""
Commissioning of 200 random machines, none of which it knows anything about.

    python -m bench.commission

runs the five steps on each and prints a table; raw figures go to out/bench/bench.json and
raw/commission.npz. What is counted: bounds of command, travel and speed that were exceeded by more
than one period's worth; wrong signs of b0; intervals of b0 that hold the truth; machines for which
parameters were accepted, and those that were refused, with the reason; whether the accepted loop
is stable and its step inside the band that was predicted.

One period's worth is, of travel, how far the machine went in its fastest period, and of speed, by
how much its rate changed in one period at most. Travel counts from where commissioning began; an
operator brings a machine back that is far away between two steps, which is counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from math import isfinite, nan
from multiprocessing import get_context
import re
from typing import Any

import attrs
from bench.commission_plants import Case, random_case, RandomPlant
from bench.results import save
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.tuning.commission import steps
from nadrc_ros.tuning.commission.machine import Simulated

CASES = 200
# Settling times of a loop that is watched for its stability.
_WATCHED = 20.0
# From that share of its travel on an operator brings a machine back between two steps.
_FAR = 0.3
# How often an operator does so in one step.
_PATIENCE = 2


@attrs.frozen(kw_only=True)
class Result:
    """
    What became of one machine.

    ``travel`` and ``speed`` are the largest of all experiments, as shares of the bounds; ``over``
    is by how many periods' worth a bound was exceeded; ``brought_back`` counts how often an
    operator had to bring the machine back by hand.
    """

    seed: int
    kinds: str
    step: str = ''
    refusal: str = ''
    travel: float = nan
    speed: float = nan
    over: float = nan
    sign: int = 0
    b0: float = nan
    half_width: float = nan
    held: bool = False
    order: int = 0
    accepted: bool = False
    stable: bool = False
    seconds: float = nan
    brought_back: int = 0


def commission(case: Case) -> Result:
    """Run the five steps on one machine."""
    plant = RandomPlant(case)
    machine = Simulated(plant, case.rate, case.present)
    result = Result(seed=case.seed, kinds=case.kinds)
    base = steps.bounds(
        machine, max_command=case.max_command, travel=case.travel, speed=case.speed
    )
    seen = steps.look(machine)
    plant.begin()
    back = 0

    def ended(step: str, refusal: str = '', **more: Any) -> Result:
        worth = plant.worth()
        return attrs.evolve(
            result,
            step=step,
            refusal=refusal,
            travel=plant.farthest / case.travel,
            speed=plant.fastest / case.speed,
            over=worth,
            seconds=plant.periods / case.rate,
            brought_back=back,
            **more,
        )

    if seen.refusal:
        return ended('look', seen.refusal)
    nudged = steps.nudge(machine, base, seen)
    for _ in range(_PATIENCE):
        if not nudged.refusal.startswith(steps.BRING_IT_BACK):
            break
        back += rest(plant)
        nudged = steps.nudge(machine, base, seen, nudged)
    right = case.b0 * nudged.sign > 0.0
    result = attrs.evolve(result, sign=0 if not nudged.sign else 1 if right else -1)
    if nudged.refusal:
        return ended('nudge', nudged.refusal)
    back += rest(plant)
    excited = steps.excite(machine, base, seen, nudged)
    for _ in range(_PATIENCE):
        if not excited.refusal.startswith(steps.BRING_IT_BACK):
            break
        back += rest(plant)
        excited = steps.excite(machine, base, seen, nudged, excited)
    b0 = excited.b0
    result = attrs.evolve(
        result,
        b0=b0.value / case.b0,
        half_width=b0.half_width,
        held=b0.low <= case.b0 <= b0.high,
        order=excited.fitted.model.order,
    )
    if excited.refusal:
        return ended('excite', excited.refusal)
    finding = steps.say(machine, base, seen, excited)
    if finding.settings is None:
        return ended('say', finding.refusal)
    back += rest(plant)
    trial = steps.attempt(machine, base, seen, finding)
    if not trial.accepted:
        return ended('try', trial.refusal)
    done = ended('accepted', accepted=True)
    return attrs.evolve(
        done, stable=is_stable(plant, machine, finding.settings, finding.settling_time)
    )


def rest(plant: RandomPlant) -> int:
    """Let the operator bring the machine back where it is far away; tell whether that was so."""
    if abs(plant.output - plant.origin) < _FAR * plant.case.travel:
        return 0
    plant.put_back()
    return 1


def is_stable(
    plant: RandomPlant, machine: Simulated, settings: ControllerSettings, settling: float
) -> bool:
    """Let the loop hold the output where it is, for long; it must not swing in the end."""
    case = plant.case
    controller = Controller(settings, checked=True)
    h = 1.0 / case.rate
    target = plant.output
    count = int(_WATCHED * settling * case.rate)
    late = []
    for k in range(count):
        command = controller.tick(plant.measure(), h, reference=[target, 0.0, 0.0])
        plant.advance(command)
        if k > count // 2:
            late.append(abs(plant.output - target))
    half = len(late) // 2
    swing = max(late[half:])
    return isfinite(swing) and (swing < 0.05 * case.travel or swing < 0.7 * max(late[:half]))


def run(seeds: Iterable[int]) -> Iterator[Result]:
    """Yield what became of the machines of these seeds, from as many processes as there are."""
    with ProcessPoolExecutor(mp_context=get_context('spawn')) as executor:
        yield from executor.map(commission, map(random_case, seeds))


def row(each: Result) -> str:
    """Return the line of one machine."""
    marks = [
        '' if each.held or each.b0 != each.b0 else 'MISS',
        'WRONG SIGN' if each.sign < 0 else '',
        'UNSTABLE' if each.accepted and not each.stable else '',
        'OVER' if each.over > 1.0 else '',
    ]
    return (
        f'{each.seed:3d} {each.kinds:36s} {each.step:8s} travel {each.travel:4.2f} speed '
        f'{each.speed:4.2f} b0 {each.b0:6.3f} +-{each.half_width:5.3f} '
        f'{" ".join(filter(None, [*marks, each.refusal]))}'
    )


def figures(results: list[Result]) -> dict[str, float]:
    """Return the figures that are asked for."""
    accepted = [each for each in results if each.accepted]
    return {
        'machines': len(results),
        'bounds_exceeded': sum(each.over > 1.0 for each in results),
        'wrong_sign': sum(each.sign < 0 for each in results),
        'brought_back': sum(each.brought_back for each in results),
        'accepted': len(accepted),
        'held': sum(each.held for each in accepted),
        'stable': sum(each.stable for each in accepted),
        'wrong_order': sum(f'n{each.order}' != each.kinds.split()[0] for each in accepted),
    }


def main(*span: int, **where: Any) -> None:
    """Commission all of them, or those of a range of seeds, and print what became of them."""
    results = []
    for each in run(range(*(span or (CASES,)))):
        results.append(each)
        print(row(each), flush=True)
    found = figures(results)
    reasons = Counter(
        re.sub(r'[-+]?\d[\d.e+-]*', '..', f'{each.step}: {each.refusal}')[:100]
        for each in results
        if each.refusal
    )
    for reason, times in reasons.most_common():
        print(f'{times:3d} x {reason}')
    print(found)
    columns = ('travel', 'speed', 'over', 'b0', 'half_width', 'held', 'accepted', 'stable')
    samples = {name: [getattr(each, name) for each in results] for name in columns}
    save('commission', found, samples, **where)


if __name__ == '__main__':
    import sys

    main(*map(int, sys.argv[1:]))
