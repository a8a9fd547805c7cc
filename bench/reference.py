"""
A reference that comes alone: what each way to its derivatives is worth, as docs/reference.md says.

    python -m bench.reference

Keys: ``reference.<order>.<way>.<sender>`` the RMS distance of an arm from what is published
[1e-3 rad]; ``.noise at rest`` and the like the noise of the command under a noisy reference, over
that without derivatives.
``reference.setpoints <order>.<way>.<name>`` what setpoints in a sequence do to a plant 1 / s^n.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sin, sqrt, tanh
import random
from typing import Any

from bench.results import save, show
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation.protocols import Signal
from nadrc_ros.simulation.signals import Ramp, Sine, Trapezoid

RATE = 200.0
H = 1.0 / RATE
MOVE = Trapezoid(velocity=0.8, acceleration=2.0, start_time=0.5)
SWING = Sine(amplitude=0.5, frequency=pi, start_time=0.5)
GRAIN = 2.0 / 4096.0
SENDERS: dict[str, tuple[Signal, dict[str, Any]]] = {
    'trapezoid': (MOVE, {}),
    'sine': (SWING, {}),
    'trapezoid, 12 bit': (MOVE, {'grain': GRAIN}),
    'sine, 12 bit': (SWING, {'grain': GRAIN}),
    'trapezoid at 20 Hz': (MOVE, {'every': 10}),
    'joystick at 20 Hz': (SWING, {'every': 10, 'grain': GRAIN}),
    'joystick at 20 Hz, sent on': (SWING, {'every': 10, 'grain': GRAIN, 'held': True}),
}
# Of standard deviation 1e-3, with a pole.
NOISY: dict[str, tuple[Signal, float]] = {
    'noise at rest': (Ramp(slope=0.0), 0.0),
    'noise of a ramp': (Ramp(slope=0.5), 0.0),
    'noise of a sine': (SWING, 0.0),
    'coloured noise at rest': (Ramp(slope=0.0), 0.9),
    'coloured noise of a sine': (SWING, 0.9),
}
WAYS: dict[str, dict[str, Any]] = {
    'topics': {'reference_derivatives': 'topics'},
    'auto': {'reference_derivatives': 'auto'},
    'error_based': {'error_based': True},
    'none': {'reference_derivatives': 'none'},
}

# Called with the number of the tick: r, r', r'' of a new sample, or None.
Sender = Callable[[int], 'list[float] | None']


def sender(
    signal: Signal,
    *,
    every: int = 1,
    grain: float = 0.0,
    noise: float = 0.0,
    pole: float = 0.0,
    seed: int = 1,
    held: bool = False,
) -> Sender:
    """Send each so many ticks, or what was sent last at each tick."""
    rng, sent, added = random.Random(seed), [0.0, 0.0, 0.0], 0.0

    def send(k: int) -> list[float] | None:
        nonlocal sent, added
        if k % every:
            return list(sent) if held else None
        sent = [0.0, 0.0, 0.0]
        signal.derivatives(k * H, sent)
        if noise:
            added = pole * added + rng.gauss(0.0, noise * sqrt(1.0 - pole * pole))
            sent[0] += added
        if grain:
            sent[0] = round(sent[0] / grain) * grain
        return list(sent)

    return send


def arm_settings(order: int, **way: Any) -> ControllerSettings:
    """Return settings of an arm, position or speed of which is measured, or a soft one."""
    wc = 5.0 if order == 3 else 8.0
    return ControllerSettings(
        plant_order=order,
        b0=4.0,
        inner_bandwidth=6.0 * wc,
        outer_bandwidth=3.0 * wc,
        controller_bandwidth=wc,
        **way,
    )


def arm(settings: ControllerSettings, signal: Signal, send: Sender) -> tuple[float, list[float]]:
    """
    Return the RMS distance of an arm from a signal, and the commands.

    It has gravity, friction that sticks, a coarse encoder and 1.3 times the b0 of the settings.
    """
    n = settings.plant_order
    controller, x, r, total = Controller(settings, checked=True), [0.0] * n, [0.0], 0.0
    known = None if settings.reference_derivatives == 'topics' else 1
    commands = []
    for k in range(800):
        sent = send(k)
        u = controller.tick(round(x[0] / GRAIN) * GRAIN, H, reference=sent and sent[:known])
        commands.append(u)
        signal.derivatives(k * H, r)
        total += (r[0] - x[0]) ** 2
        for _ in range(10):
            push = 1.3 * settings.b0 * u - x[-1] - 10.0 * sin(x[0]) - tanh(x[-1] / 0.01)
            for i in range(n - 1):
                x[i] += 0.1 * H * x[i + 1]
            x[-1] += 0.1 * H * push
    return sqrt(total / 800), commands


def noise(
    way: dict[str, Any], order: int, noisy: tuple[Signal, float], ticks: int = 2000
) -> float:
    """
    Return how much of the noise of a reference is in the command of an integrator chain.

    It is what two of one kind differ by: what is late with either is no noise.
    """
    signal, pole = noisy
    commands = []
    for seed in (1, 2):
        controller = Controller(arm_settings(order, **way), checked=True)
        send = sender(signal, noise=1e-3, pole=pole, seed=seed)
        x, u = [0.0] * order, []
        for k in range(ticks):
            u.append(controller.tick(x[0], H, reference=(send(k) or [])[:1]))
            for i in range(order - 1):
                x[i] += H * x[i + 1]
            x[-1] += H * 4.0 * u[-1]
        commands.append(u[ticks // 2 :])
    return sqrt(sum((a - b) ** 2 for a, b in zip(*commands, strict=True)))


def drawn(every: int) -> Callable[[int], float]:
    """Return a setpoint from 0 to 1 that is drawn anew each so many ticks."""
    rng = random.Random(5)
    values = [rng.random() for _ in range(600 // every)]
    return lambda k: values[k // every]


def parts(count: int, every: int) -> Callable[[int], float]:
    """Return a step to 1 after a second, in parts that come each so many ticks."""
    return lambda k: min(max((k - 100) // every + 1, 0), count) / count


def coloured() -> Callable[[int], float]:
    """Return noise of a reference that rests, of standard deviation 0.01 and pole 0.9."""
    rng, values = random.Random(2), [0.0]
    for _ in range(600):
        values.append(values[-1] + 0.1 * (rng.gauss(0.0, 0.01) - values[-1]))
    return lambda k: values[k]


# What is sent at 100 Hz, and each so many ticks.
SETPOINTS: dict[str, tuple[Callable[[int], float], int]] = {
    'drawn at 5 Hz': (drawn(20), 1),
    'drawn at 20 Hz': (drawn(5), 1),
    'two halves, 20 ms apart': (parts(2, 2), 1),
    'two halves, 0.1 s apart': (parts(2, 10), 1),
    'three thirds, 0.3 s apart': (parts(3, 30), 1),
    'slider at 20 Hz, 0.4 s': (lambda k: min(max((k - 100) / 40, 0.0), 1.0), 5),
    'coloured noise at rest': (coloured(), 1),
}


def setpoints(order: int, way: dict[str, Any]) -> dict[str, float]:
    """Return the largest command, its RMS and how far y goes for setpoints of a plant 1 / s^n."""
    settings = ControllerSettings(
        plant_order=order,
        inner_bandwidth=40.0,
        outer_bandwidth=30.0,
        controller_bandwidth=4.0,
        command_min=-1e4,
        command_max=1e4,
        **way,
    )
    found = {}
    for name, (send, every) in SETPOINTS.items():
        controller, chain = Controller(settings, checked=True), [send(0)] + [0.0] * (order - 1)
        commands, outputs = [], []
        for k in range(600):
            outputs.append(chain[0])
            sent = None if k % every else [send(k)]
            u = controller.tick(chain[0], 0.01, reference=sent)
            commands.append(u)
            for i in range(order - 1):
                chain[i] += 0.01 * (chain[i + 1] + 0.005 * u)
            chain[-1] += 0.01 * u
        found[f'{name}: largest command'] = max(map(abs, commands))
        found[f'{name}: RMS of the command'] = sqrt(sum(u * u for u in commands) / 600)
        found[f'{name}: smallest y'] = min(outputs)
        found[f'{name}: largest y'] = max(outputs)
    return found


def figures(order: int, way: dict[str, Any]) -> dict[str, float]:
    """Return the figures of one way."""
    settings = arm_settings(order, **way)
    found = {
        name: 1e3 * arm(settings, signal, sender(signal, **how))[0]
        for name, (signal, how) in SENDERS.items()
    }
    for name, noisy in NOISY.items():
        found[name] = noise(way, order, noisy) / noise(WAYS['none'], order, noisy)
    return found


def main(orders: tuple[int, ...] = (1, 2, 3), **where: Any) -> None:
    """Compare the ways."""
    found = {order: {name: figures(order, way) for name, way in WAYS.items()} for order in orders}
    jumps = {n: {w: setpoints(n, WAYS[w]) for w in ('none', 'auto')} for n in orders}
    saved = {str(n): each for n, each in found.items()}
    saved |= {f'setpoints {n}': each for n, each in jumps.items()}
    save('reference', saved, {}, **where)
    for order, each in found.items():
        turned = {key: {way: row[key] for way, row in each.items()} for key in each['auto']}
        show(f'order {order}: RMS error [1e-3], noise over that of none', turned, '')
    for order, each in jumps.items():
        turned = {key: {way: row[key] for way, row in each.items()} for key in each['auto']}
        show(f'order {order}: setpoints in a sequence', turned, '')


if __name__ == '__main__':
    main()
