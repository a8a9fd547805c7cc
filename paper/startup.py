"""
(g) The start of the observer: peaking, with and without the paper's device 1/eps = 100 t^3.

The device is the setting ``startup_time``: the bandwidth rises as t^3 to its value in 1 s. Three
starts: all estimates zero although y = 1 (the case of the paper), and what this package does, the
estimates started at the first measurement, with the plant at rest and with it moving.
"""

from __future__ import annotations

import attrs
from matplotlib.figure import Figure
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.report.style import plain_log_ticks
from nadrc_ros.scenario import find_scenario, load
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.noise import Noise
from paper.drawing import CONVENTIONAL, in_style, NESTED, panels, thinned
from paper.loop import Law, run
from paper.section import Finding, Findings, Result, Section, Tell

SETTINGS = ControllerSettings(
    structure='conventional',
    inner_bandwidth=100.0,  # rad/s, the 1/eps of the paper
    controller_bandwidth=4.0,
    command_min=-1e6,
    command_max=1e6,
)
STARTUP_TIME = 1.0  # s
DEVICES = {'off': 0.0, 'on': STARTUP_TIME}
# Start -> x(0), and whether the estimates start at the first measurement.
STARTS = {
    'zero': ((1.0, 0.0), False),
    'measured': ((1.0, 0.0), True),
    'moving': ((1.0, 1.0), True),
}
TITLES = {
    'zero': 'estimates start at 0, y(0) = 1',
    'measured': 'estimates start at y(0), at rest',
    'moving': 'estimates start at y(0), moving',
}
SHOWN = 2.0  # s
# Declared: the device must lower the peak of the command of the paper's case by this factor.
FACTOR = 10.0


def experiment(initial_state: tuple[float, float]) -> Experiment:
    """Return the plant of eq. (26), without noise."""
    plant_26 = load(find_scenario('paper_fair')).experiment
    return attrs.evolve(plant_26, noise=Noise(), initial_state=initial_state, duration=8.0)


def measure(tell: Tell, jobs: int) -> Result:
    """Run the three starts with and without the device."""
    starts: Result = {}
    for i, (name, (state, measured)) in enumerate(STARTS.items()):
        starts[name] = {}
        for device, time in DEVICES.items():
            law = Law(attrs.evolve(SETTINGS, startup_time=time))
            if measured:
                law.start(state[0], 1.0)
            found = run(experiment(state), law)
            early = found.time <= SHOWN
            starts[name][device] = {
                'peak_command': float(abs(found.command).max()),
                'peak_error': found.metrics.max_error,
                'iae': found.metrics.iae,
                'itae': found.metrics.itae,
                'curves': thinned(
                    {'time': found.time[early], 'command': found.command[early]}, points=400
                ),
            }
        tell((i + 1) / len(STARTS))
    return {'bandwidth': SETTINGS.inner_bandwidth, 'startup_time': STARTUP_TIME, 'starts': starts}


@in_style
def figures(result: Result) -> dict[str, Figure]:
    """Draw the commands of the first seconds."""
    figure, axes = panels(1, len(STARTS), 2.7)
    for axis, (name, devices) in zip(axes[0], result['starts'].items()):
        for device, colour in (('off', CONVENTIONAL), ('on', NESTED)):
            curves = devices[device]['curves']
            label = '1/ε = 100 t³' if device == 'on' else 'constant 1/ε = 100'
            axis.plot(curves['time'], curves['command'], color=colour, label=label)
        axis.set_title(TITLES[name])
        axis.set_xlabel('time [s]')
    axes[0, 0].set_yscale('symlog', linthresh=10.0)
    plain_log_ticks(axes[0, 0])
    axes[0, 0].set_ylabel('command u')
    axes[0, 0].legend(loc='lower right')
    return {'startup': figure}


def findings(result: Result) -> Findings:
    """Say what the device does to the peak, and what a start at the measurement does."""
    zero, measured = result['starts']['zero'], result['starts']['measured']
    return {
        'lowers': Finding(
            says='times the device lowers the peak of the command, estimates starting at zero',
            values=zero['off']['peak_command'] / zero['on']['peak_command'],
            low=FACTOR,
        ),
        'measured_peak': Finding(
            says='peak of the command without the device, estimates starting at the measurement',
            values=measured['off']['peak_command'],
            high=2.0,
        ),
        'costs': Finding(
            says='times the ITAE with the device is that without, estimates starting at the '
            'measurement',
            values=measured['on']['itae'] / measured['off']['itae'],
            low=1.0,
        ),
    }


SECTION = Section(
    name='startup',
    title='The start',
    measure=measure,
    figures=figures,
    findings=findings,
)
