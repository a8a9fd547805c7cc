"""A plant as seen from outside, period by period: the simulation and the plant node run it."""

from __future__ import annotations

from math import nan

from nadrc_ros.simulation.dead_time import DeadTime, reach
from nadrc_ros.simulation.faults import Faults, Injector
from nadrc_ros.simulation.integrate import Integrator, ran_away, substeps_for
from nadrc_ros.simulation.noise import Noise, NoiseSource
from nadrc_ros.simulation.protocols import Plant, Signal, total_disturbance
from nadrc_ros.simulation.sensor import Sensor, shown
from nadrc_ros.simulation.signals import Nothing
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class PlantRun:
    """
    A plant with its disturbance, its measurement noise and its faults, at t_k = k / rate.

    Parameters
    ----------
    plant, disturbance, noise
        What is simulated.
    rate
        Periods per second [Hz].
    initial_state
        x(0), shape (states,).
    faults
        What goes wrong with its sensor and its actuator, which is for the caller to let happen.
    noise_signal
        What is added to its measurements beside the noise.
    sensor
        What it shows of output and noise.
    input_delay
        How long a command takes to the plant [s].
    before
        The command that acts before the first one.

    """

    def __init__(
        self,
        plant: Plant,
        disturbance: Signal,
        noise: Noise,
        rate: float,
        initial_state: tuple[float, ...],
        faults: Faults,
        noise_signal: Signal,
        sensor: Sensor,
        input_delay: float = 0.0,
        before: float = 0.0,
    ) -> None:
        self.rate = rate
        self.k = 0
        self.faults = Injector(faults, rate, noise.seed)
        self.state = list(initial_state)
        self.noise = NoiseSource(noise, 1.0 / rate)
        self._noise, self._derivative_noise = noise, dict[int, NoiseSource]()
        self.noise_signal = noise_signal
        self.sensor = sensor
        self.dead_time = DeadTime(input_delay, rate, before)
        self._later = before
        self._middle = list(initial_state)
        self._next = list(initial_state)
        self._slope = list(initial_state)
        self._w = [0.0]
        self.change(plant, disturbance)

    def change(self, plant: Plant, disturbance: Signal) -> None:
        """Go on from the present state with another plant of the same states or disturbance."""
        self.plant = plant
        self.disturbance = disturbance
        self.substeps = substeps_for(plant, 1.0 / self.rate)
        self._integrator = Integrator(plant, disturbance, self.substeps)

    @property
    def output(self) -> float:
        """Return the noise-free output y(t_k)."""
        return self.plant.output(self.state)

    @property
    def measurement(self) -> float:
        """Return what the sensor shows in period k."""
        return self.measured(float(self.noise_block(self.k, 1)[0]))

    def measured(self, noise: float) -> float:
        """Return what the sensor shows with that noise."""
        return shown(self.output + noise, self.sensor.wrap_min, self.sensor.wrap_max)

    def noise_block(self, k: int, count: int) -> Array:
        """Return all that is added to the output in ``count`` periods from ``k`` on."""
        noise = self.noise.block(k, count)
        if isinstance(self.noise_signal, Nothing):
            return noise
        return noise + signal_block(self.noise_signal, k, count, self.rate)

    def change_noise(self, noise: Noise) -> None:
        """Go on with noise of other variances."""
        self._noise = noise
        self.noise.set_variance(noise.variance)
        for derivative, source in self._derivative_noise.items():
            source.set_variance(noise.variance_of(derivative))

    def measured_derivative(self, derivative: int) -> float:
        """Return y^(derivative), below the order of the plant, with the noise of period k."""
        noise = self.derivative_noise_block(derivative, self.k, 1)
        return self.state[derivative] + float(noise[0])

    def derivative_noise_block(self, derivative: int, k: int, count: int) -> Array:
        """Return what is added to y^(derivative) in ``count`` periods from ``k`` on."""
        if derivative not in self._derivative_noise:
            source = NoiseSource(self._noise, 1.0 / self.rate, derivative)
            self._derivative_noise[derivative] = source
        return self._derivative_noise[derivative].block(k, count)

    def reach(self, command: float, acting: float) -> tuple[float, float]:
        """
        Send the ``command`` of period k; return the one that reaches the plant then.

        The same of what the actuator makes of it, ``acting``. To be called once in each period;
        without a dead time it changes nothing.
        """
        late = self.dead_time
        if late.sent[0]:
            command, acting, self._later = reach(
                late.sent, late.whole, late.rest, self.k, command, acting
            )
        return command, acting

    def total_disturbance(self, command: float, acting: float) -> float:
        """
        Return L(t_k) = y^(n) - b0 u for the plant's nominal b0 and the ``command`` u that acts.

        ``acting`` is what the actuator makes of it. A plant that ran away may have none: nan.
        """
        t, b0 = self.k / self.rate, self.plant.b0
        self.disturbance.derivatives(t, self._w)
        try:
            unexplained = total_disturbance(
                type(self.plant).derivative,
                self.plant,
                b0,
                t,
                self.state,
                acting,
                self._w[0],
                self._slope,
            )
        except (OverflowError, ValueError) as error:
            if not ran_away(error, self.state):
                raise
            return nan
        return unexplained if acting == command else unexplained + b0 * (acting - command)

    def advance(self, acting: float) -> bool:
        """
        Act so over one period; False if the plant diverged (it is then all nan).

        Where the dead time is no whole number of periods, so until the next command is there.
        """
        t, h, rest, state = self.k / self.rate, 1.0 / self.rate, self.dead_time.rest, self.state
        if rest > 0.0:
            self._integrator.advance(t, state, acting, rest, self._middle)
            t, h, acting, state = t + rest, h - rest, self._later, self._middle
        finite = self._integrator.advance(t, state, acting, h, self._next)
        self.state, self._next = self._next, self.state
        self.k += 1
        return finite


def signal_block(signal: Signal, k: int, count: int, rate: float) -> Array:
    """Return a signal in ``count`` periods from ``k`` on."""
    block, out = np.zeros(count), [0.0]
    if not isinstance(signal, Nothing):
        for i in range(count):
            signal.derivatives((k + i) / rate, out)
            block[i] = out[0]
    return block
