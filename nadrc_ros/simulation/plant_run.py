"""A plant as seen from outside, period by period: the simulation and the plant node run it."""

from __future__ import annotations

from math import nan

from nadrc_ros.simulation.faults import Faults, Injector, Sample
from nadrc_ros.simulation.integrate import Integrator, ran_away, substeps_for
from nadrc_ros.simulation.noise import Noise, NoiseSource
from nadrc_ros.simulation.protocols import Plant, Signal, total_disturbance
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
        What goes wrong with its sensor and its actuator.
    noise_signal
        What is added to its measurements beside the noise.

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
    ) -> None:
        self.rate = rate
        self.k = 0
        self.faults = Injector(faults, rate, noise.seed)
        self.state = list(initial_state)
        self.noise = NoiseSource(noise, 1.0 / rate)
        self.noise_signal = noise_signal
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

    def inject(self, faults: Faults) -> None:
        """Go on with other faults; the times of those that change count from now on."""
        self.faults.change(faults, self.k)

    @property
    def output(self) -> float:
        """Return the noise-free output y(t_k)."""
        return self.plant.output(self.state)

    @property
    def measurement(self) -> float:
        """Return the output with the noise of period k."""
        return self.output + self.noise_at(self.k)

    def noise_at(self, k: int) -> float:
        """Return all that is added to the output in period ``k``, never less than the last one."""
        noise = self.noise.at(k)
        return noise if self._random_alone else noise + self._added(k)

    def noise_block(self, k: int, count: int) -> Array:
        """Return what :meth:`noise_at` gives for ``count`` periods from ``k`` on."""
        noise = self.noise.block(k, count)
        if self._random_alone:
            return noise
        added: Array = np.array([self._added(i) for i in range(k, k + count)])
        return noise + added

    @property
    def _random_alone(self) -> bool:
        return isinstance(self.noise_signal, Nothing)

    def _added(self, k: int) -> float:
        self.noise_signal.derivatives(k / self.rate, self._w)
        return self._w[0]

    def total_disturbance(self, command: float, acting: float) -> float:
        """
        Return L(t_k) = y^(n) - b0 u for the plant's nominal b0 and the ``command`` u from t_k on.

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

    def samples(self, measurement: float, *, still: bool = False) -> list[Sample]:
        """
        Return what arrives of the measurement of period k: one sample, but for faults.

        ``still`` says that it was asked for before, as no time passes yet.
        """
        return self.faults.deliver(self.k, measurement, still=still)

    def act(self, command: float) -> float:
        """Return what the actuator makes of the command; to be called once in each period."""
        return self.faults.act(self.k, command)

    def advance(self, acting: float) -> bool:
        """Act so over one period; False if the plant diverged (it is then all nan)."""
        finite = self._integrator.advance(
            self.k / self.rate, self.state, acting, 1.0 / self.rate, self._next
        )
        self.state, self._next = self._next, self.state
        self.k += 1
        return finite
