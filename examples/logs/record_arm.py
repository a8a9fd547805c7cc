"""
Writes the log of an arm in MuJoCo, under a PID or under a tuned controller.

    python record_arm.py arm_pid.csv
    python record_arm.py arm_adrc.csv PARAMETERS.yaml

The shoulder of examples/mujoco/arm.xml moves to and fro; its encoder has 16384 counts a turn. A
stiff servo holds the elbow, and nobody logs it. Needs `pip install mujoco`, and no ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import pi
from pathlib import Path
import sys

import mujoco
from nadrc_ros.adrc import Controller, ControllerSettings
from nadrc_ros.adrc.fields import declared
import yaml

MODEL = Path(__file__).parents[1] / 'mujoco' / 'arm.xml'
RATE = 100.0  # Hz
DURATION = 20.0  # s
POSES = (0.0, 0.9, 0.3, 1.2, -0.5, 0.7, -0.9, 0.2, 1.0, 0.0)  # rad
CYCLE, MOVE = 2.0, 0.8  # s
COUNTS = 16384
LIMIT = 12.0  # N m
# Returns the torque [N m] for a setpoint and an angle [rad].
Law = Callable[[float, float], float]


def pid() -> Law:
    """Return a PID that somebody tuned by hand."""
    total, last = 0.0, 0.0

    def law(wanted: float, angle: float) -> float:
        nonlocal total, last
        error, rate = wanted - angle, (angle - last) * RATE
        total, last = total + error / RATE, angle
        return 20.0 * error + 20.0 * total - 3.0 * rate

    return law


def adrc(file: Path) -> Law:
    """Return the controller of a parameter file, as the node would run it."""
    ((_, content),) = yaml.safe_load(file.read_text(encoding='utf-8')).items()
    values = content['ros__parameters']
    known = declared(ControllerSettings)
    controller = Controller(ControllerSettings(**{k: v for k, v in values.items() if k in known}))
    return lambda wanted, angle: controller.tick(angle, 1.0 / RATE, reference=[wanted])


def setpoint(t: float) -> float:
    """Return where the shoulder is to be [rad]: it moves to a pose, and waits there."""
    number, since = divmod(t, CYCLE)
    last, pose = POSES[int(number) - 1], POSES[int(number)]
    share = min(since / MOVE, 1.0)
    return last + (pose - last) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def rows(law: Law) -> Iterator[str]:
    """Yield the lines of the log."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    steps = round(1.0 / (RATE * model.opt.timestep))
    yield 't [s],setpoint [rad],angle [rad],torque [N m]'
    for k in range(round(DURATION * RATE)):
        t = k / RATE
        angle = round(data.qpos[0] / (2.0 * pi) * COUNTS) * 2.0 * pi / COUNTS
        torque = max(-LIMIT, min(LIMIT, law(setpoint(t), angle)))
        yield f'{t:.2f},{setpoint(t):.5f},{angle:.5f},{torque:.4f}'
        for _ in range(steps):
            data.ctrl[:] = torque, -80.0 * data.qpos[1] - 4.0 * data.qvel[1]
            mujoco.mj_step(model, data)


def main() -> None:
    """Write a log."""
    if len(sys.argv) not in (2, 3):
        raise SystemExit('usage: record_arm.py LOG.csv [PARAMETERS.yaml]')
    law = adrc(Path(sys.argv[2])) if len(sys.argv) == 3 else pid()
    Path(sys.argv[1]).write_text('\n'.join([*rows(law), '']), encoding='utf-8')


if __name__ == '__main__':
    main()
