"""
The tour of the first tutorial without the command `ros2`, which the ROS 2 wheels do not bring.

    .venv/bin/python examples/tour.py

The same four nodes, in one process, with the same changes while they run in real time.
"""

from __future__ import annotations

try:
    from nadrc_ros.testing import loop, RunningLoop
    import numpy as np
except ImportError as error:
    raise SystemExit(f'{error}: source install/local_setup.bash first') from None

PLANT = {'plant': 'paper', 'a1': -1.0, 'a2': -1.0, 'disturbance': 'sine', 'noise_variance': 1e-6}
STEP = 1.5  # s


def main() -> None:
    """Walk through the tour, and say what is to be seen."""
    with loop(
        plant=PLANT,
        controller={'inner_bandwidth': 12.0, 'outer_bandwidth': 12.0},
        reference={'signal': 'cosine', 'frequency': 0.5},
        duration=9.0 * STEP,
    ) as run:
        _look(run, 'in control from the start')
        described = run.controller.describe_parameter('inner_bandwidth')
        print('inner_bandwidth:', described.description)
        run.change(inner_bandwidth=20.0)
        _look(run, 'inner_bandwidth 20')
        run.change(structure='conventional')
        _look(run, 'one observer')
        run.change('plant', disturbance_amplitude=2.0)
        _look(run, 'twice the disturbance')
        run.change('plant', {'fault.measurement.kind': 'silent'})
        _look(run, 'no measurement: the safe command')
        run.change('plant', {'fault.measurement.kind': 'none'})
        _look(run, 'measured again')
        print(run.controller.enable(False)[1])
        _look(run, 'disabled: the safe command')
        print(run.controller.enable()[1])
        _look(run, 'enabled again')
        result = run.finish()
    print(f'ITAE {result.metrics.itae:.3g}, ISU {result.metrics.isu:.3g}')


def _look(run: RunningLoop, said: str) -> None:
    """Let the loop run for a while, and print the largest error of its second half."""
    end = run.time + STEP
    run.run_until(end)
    # Rows come a third of a second late.
    run.wait_until(lambda: run.result().time[-1] > end - 0.5 * STEP)
    result = run.result()
    late = result.time > end - 0.5 * STEP
    error = np.abs(result.reference - result.output)[late].max()
    shown = f'largest error {error:.3f}'
    if np.isnan(result.measurement[late]).all():
        shown += ', nothing measured'
    estimate = run.controller.controller.total_disturbance
    print(f'{run.time:4.1f} s  {said}: {shown}, total disturbance {estimate:.2f}', flush=True)


if __name__ == '__main__':
    main()
