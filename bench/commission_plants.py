"""Random machines for commissioning, with all that may be wrong with one."""

from __future__ import annotations

from collections import deque
from math import inf, sqrt

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
import numpy as np

SUBSTEPS = 4


@attrs.frozen(kw_only=True)
class Case:
    """
    One machine, the bounds its owner gives, and what is true of it.

    y^(order) = b0 u(t - delay) - damping y^(order-1) - stiffness y - load - friction, and a mode
    beside that: q'' = b0 u - 2 zeta w q' - w^2 q, of which ``mode_share`` of q^(2 - order) is
    added to y. ``delay`` counts periods; ``friction`` and ``load`` are in units of y^(order).
    """

    seed: int
    order: int
    b0: float
    rate: float
    delay: int
    damping: float
    stiffness: float
    friction: float
    load: float
    noise: float
    quantum: float
    low_stop: float
    high_stop: float
    mode_frequency: float
    mode_damping: float
    mode_share: float
    command_min: float
    command_max: float
    center: float
    max_command: float
    travel: float
    speed: float

    @property
    def present(self) -> ControllerSettings:
        """Return the settings of a controller that knows nothing but its limits."""
        return ControllerSettings(
            command_min=self.command_min,
            command_max=self.command_max,
            safe_command=self.center,
        )

    @property
    def kinds(self) -> str:
        """Say in a few letters what is special about it."""
        has = {
            f'n{self.order}': True,
            f'd{self.delay}': self.delay > 0,
            'friction': self.friction > 0.0,
            'gravity': self.load != 0.0,
            'stops': self.high_stop < inf,
            'mode': self.mode_share != 0.0,
            'unstable': self.damping < 0.0 or self.stiffness < 0.0,
            'coarse': self.quantum > 2.0 * self.noise,
            'one-sided': self.command_min == 0.0,
        }
        return ' '.join(name for name, there in has.items() if there)


def random_case(seed: int) -> Case:
    """Return the machine of a seed."""
    rng = np.random.default_rng((23, seed))

    def chance(share: float) -> bool:
        return bool(rng.random() < share)

    def uniform(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def spread(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    order = 1 + int(chance(0.5))
    b0 = spread(1e-2, 1e2) * (1.0 if chance(0.5) else -1.0)
    rate = spread(50.0, 200.0)
    limit = spread(1.0, 100.0)
    max_command = uniform(0.3, 1.0) * limit
    # in that time the largest command drives it through its travel
    pace = spread(0.2, 2.0)
    travel = abs(b0) * max_command * pace**order
    speed = travel / pace * uniform(0.5, 2.0)
    damping = spread(0.1, 5.0) / pace if chance(0.6) else 0.0
    if chance(0.08):
        damping = -uniform(0.05, 0.3) / pace
    stiffness = 0.0
    if order == 2 and chance(0.2):
        stiffness = (uniform(0.3, 2.0) / pace) ** 2
    # of the range of the command, which is 2 limit
    friction = uniform(0.0, 0.2) * 2.0 * limit * abs(b0) if chance(0.5) else 0.0
    # who owns it lets it have what its friction takes
    max_command = min(max(max_command, 1.5 * friction / abs(b0)), limit)
    if order == 1:  # and does not forbid how fast it stops by itself
        speed = max(speed, 1.3 * friction + 0.5 * abs(damping) * travel)
    load = uniform(-0.1, 0.1) * 2.0 * limit * b0 if chance(0.3) else 0.0
    low_stop, high_stop = (-inf, inf)
    if chance(0.2):
        low_stop, high_stop = -uniform(0.5, 3.0) * travel, uniform(0.5, 3.0) * travel
    center = 0.0
    if abs(load) > friction:
        if chance(0.5):  # it rests on a stop
            low_stop, high_stop = (0.0, 3.0 * travel) if load > 0.0 else (-3.0 * travel, 0.0)
        else:  # its owner knows the command that holds it, nearly
            center = load / b0 * uniform(0.97, 1.03)
    noise = travel * spread(1e-4, 5e-3)
    mode = chance(0.25)
    return Case(
        seed=seed,
        order=order,
        b0=b0,
        rate=rate,
        delay=int(rng.integers(0, 11)),
        damping=damping,
        stiffness=stiffness,
        friction=friction,
        load=load,
        noise=noise,
        quantum=travel * spread(1e-4, 3e-3) if chance(0.4) else 0.0,
        low_stop=low_stop,
        high_stop=high_stop,
        mode_frequency=spread(0.15, 0.8) * rate,
        mode_damping=spread(0.02, 0.2),
        mode_share=uniform(-1.2, 0.5) if mode else 0.0,
        command_min=-limit,
        command_max=limit,
        center=center,
        max_command=min(max_command, limit - abs(center)),
        travel=travel,
        speed=speed,
    )


class RandomPlant:
    """A machine of a case, period by period; it remembers how far and how fast it went."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.y = self.v = self.q = self.p = 0.0
        self.rng = np.random.default_rng((24, case.seed))
        self.late = deque([case.center] * case.delay)
        self.farthest = self.fastest = self.jump = 0.0
        self.origin = self.rate = 0.0
        self.periods = 0
        self._bank: list[float] = []

    @property
    def output(self) -> float:
        """Return the true output."""
        share = self.case.mode_share
        return self.y + share * (self.q if self.case.order == 2 else self.p)

    def begin(self) -> None:
        """Count travel and speed from here on."""
        self.farthest = self.fastest = self.jump = 0.0
        self.origin = self.output
        self.periods = 0

    def put_back(self) -> None:
        """Bring it back to where it began, at rest."""
        self.y = self.origin
        self.v = self.q = self.p = self.rate = 0.0
        self.late = deque([self.case.center] * self.case.delay)

    def measure(self) -> float:
        """Return what the sensor shows."""
        if not self._bank:
            self._bank = (self.case.noise * self.rng.standard_normal(1024)).tolist()
        shown = self.output + self._bank.pop()
        quantum = self.case.quantum
        return round(shown / quantum) * quantum if quantum > 0.0 else shown

    def advance(self, command: float) -> None:
        """Act so for one period."""
        case = self.case
        self.late.append(command)
        force = case.b0 * self.late.popleft()
        before, h = self.output, 1.0 / case.rate
        dt = h / SUBSTEPS
        w2, damped = case.mode_frequency**2, 2.0 * case.mode_damping * case.mode_frequency
        dry = case.friction * dt
        for _ in range(SUBSTEPS):
            if case.order == 2:
                push = force - case.load - case.damping * self.v - case.stiffness * self.y
                rate = self.v + push * dt
                rate = 0.0 if abs(rate) <= dry else rate - (dry if rate > 0.0 else -dry)
                self.y += 0.5 * (self.v + rate) * dt
                self.v = rate
            else:
                level = self.y + (force - case.load - case.damping * self.y) * dt
                self.y = 0.0 if abs(level) <= dry else level - (dry if level > 0.0 else -dry)
            if not case.low_stop < self.y < case.high_stop:
                self.y = min(max(self.y, case.low_stop), case.high_stop)
                self.v = 0.0
            if case.mode_share:
                self.p += (force - damped * self.p - w2 * self.q) * dt
                self.q += self.p * dt
        now = self.output
        self.farthest = max(self.farthest, abs(now - self.origin))
        rate = (now - before) / h
        self.fastest = max(self.fastest, abs(rate))
        self.jump = max(self.jump, abs(rate - self.rate))
        self.rate = rate
        self.periods += 1

    def worth(self) -> float:
        """Return by how many periods' worth of motion a bound was exceeded."""
        case = self.case
        travel = (self.farthest - case.travel) / (max(self.fastest, 1e-30) / case.rate)
        speed = (self.fastest - case.speed) / max(self.jump, 1e-30)
        return max(travel, speed, 0.0)


def noise_of(case: Case) -> float:
    """Return the deviation of the measurement at rest."""
    return sqrt(case.noise**2 + case.quantum**2 / 12.0)
