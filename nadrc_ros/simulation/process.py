"""A plant as seen from outside, period by period: the simulation and the plant node run it."""

from __future__ import annotations

from nadrc_ros.simulation.integrate import Integrator, substeps_for
from nadrc_ros.simulation.noise import Noise, NoiseSource
from nadrc_ros.simulation.plants import Plant, total_disturbance
from nadrc_ros.simulation.signals import Signal


class Process:
    """
    A plant with its disturbance and its measurement noise, at t_k = k / rate.

    Parameters
    ----------
    plant, disturbance, noise
        What is simulated.
    rate
        Periods per second [Hz].
    initial_state
        x(0), shape (states,).

    """

    def __init__(
        self,
        plant: Plant,
        disturbance: Signal,
        noise: Noise,
        rate: float,
        initial_state: tuple[float, ...],
    ) -> None:
        self.rate = rate
        self.k = 0
        self.state = list(initial_state)
        self.noise = NoiseSource(noise, 1.0 / rate)
        self._next = list(initial_state)
        self._derivative = list(initial_state)
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
        """Return the output with the noise of period k."""
        return self.output + self.noise.at(self.k)

    def total_disturbance(self, command: float) -> float:
        """Return L(t_k) = y^(n) - b0 u for the plant's nominal b0 and the command from t_k on."""
        t = self.k / self.rate
        self.disturbance.derivatives(t, self._w)
        return total_disturbance(
            self.plant, self.plant.b0, t, self.state, command, self._w[0], self._derivative
        )

    def advance(self, command: float) -> bool:
        """Hold ``command`` over one period; False if the plant diverged (it is then all nan)."""
        finite = self._integrator.advance(
            self.k / self.rate, self.state, command, 1.0 / self.rate, self._next
        )
        self.state, self._next = self._next, self.state
        self.k += 1
        return finite
