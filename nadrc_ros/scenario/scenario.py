"""One description of an experiment: plant, signals, noise, controllers, changes on the way."""

from __future__ import annotations

from math import isfinite
import re
from typing import Any

import attrs
from nadrc_ros.adrc.errors import did_you_mean, SettingError, UnknownName
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario.errors import ScenarioError
from nadrc_ros.scenario.specs import PlantSpec, SignalSpec
from nadrc_ros.scenario.user_code import blame
from nadrc_ros.simulation.experiment import Experiment, Retune
from nadrc_ros.simulation.faults import Faults
from nadrc_ros.simulation.integrate import substeps_for
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.protocols import Plant
from nadrc_ros.simulation.simulate import Result, simulate

CONTROLLER_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')
SETTINGS = declared(ControllerSettings)


def _as_in_experiment(name: str) -> Any:
    field = getattr(attrs.fields(Experiment), name)
    return attrs.field(
        default=field.default,
        converter=field.converter,
        validator=field.validator,
        metadata=field.metadata,
    )


@attrs.frozen(kw_only=True)
class Scenario:
    """
    A validated experiment with one or several controllers.

    Attributes
    ----------
    plant, reference, disturbance
        What to control, what to follow, what disturbs [unit of y^(n)].
    noise
        Measurement noise, with the seed of all that is random.
    noise_signal
        What is added to each measurement beside it.
    faults
        What goes wrong with the sensor and the actuator.
    initial_state
        x(0), zeros if left out.
    rate, duration, error, settle_time
        As in :class:`Experiment`.
    controllers
        Settings by name; a name is also a ROS namespace. The plant order is that of the plant.
    retunes
        Changes of settings on the way, in order of time, for every controller.

    Raises
    ------
    SettingError
        Names a bad value by its dotted path in the file.
    ScenarioError
        When a user's plant fails, or there is no controller.

    """

    plant: PlantSpec
    reference: SignalSpec
    controllers: dict[str, ControllerSettings]
    disturbance: SignalSpec = attrs.field(factory=SignalSpec)
    noise: Noise = attrs.field(factory=Noise)
    noise_signal: SignalSpec = attrs.field(factory=SignalSpec)
    faults: Faults = attrs.field(factory=Faults)
    initial_state: tuple[float, ...] = ()
    retunes: tuple[Retune, ...] = ()
    rate: float = _as_in_experiment('rate')
    duration: float = _as_in_experiment('duration')
    error: str = _as_in_experiment('error')
    settle_time: float = _as_in_experiment('settle_time')

    def __attrs_post_init__(self) -> None:
        plant = self.plant.make()
        substeps_for(plant, 1.0 / self.rate)  # refuses one that is too fast for the rate
        object.__setattr__(self, 'initial_state', _checked_state(plant, self.initial_state))
        _check_controllers(plant, self.controllers, self.rate)
        last = self._experiment(plant).last
        retunes = _checked_retunes(self.retunes, self.controllers, last)
        object.__setattr__(self, 'retunes', retunes)

    @property
    def code(self) -> tuple[str, ...]:
        """Return the Python files of the user's that it runs."""
        return tuple(filter(None, (self.plant.file, *(signal.file for signal in self._signals))))

    @property
    def files(self) -> tuple[str, ...]:
        """Return all files of the user's that it reads."""
        return (*self.code, *filter(None, (signal.csv for signal in self._signals)))

    @property
    def _signals(self) -> tuple[SignalSpec, ...]:
        return self.reference, self.disturbance, self.noise_signal

    def experiment(self) -> Experiment:
        """Return what is done to each controller, with a plant of its own."""
        return self._experiment(self.plant.make())

    def run(self, name: str) -> Result:
        """
        Run the controller of that name offline.

        Raises
        ------
        ScenarioError
            When the code of a user's plant or signal fails on the way.

        """
        with blame(*self.code):
            return simulate(self.experiment(), self.controllers[name])

    def changed(
        self,
        *,
        duration: float | None = None,
        rate: float | None = None,
        seed: int | None = None,
        noise_variance: float | None = None,
    ) -> Scenario:
        """
        Return the scenario with other values.

        Retunes after a nearer end are left out, and so is a settle time.
        """
        noise = {'seed': seed, 'variance': noise_variance}
        try:
            changed_noise = attrs.evolve(self.noise, **_given(noise))
        except SettingError as error:
            raise error if error.name == 'seed' else error.inside('noise') from None
        changes = _given({'duration': duration, 'rate': rate})
        if changes:
            # Without these the shorter experiment is valid and knows its last sample.
            bare = attrs.evolve(self, retunes=(), settle_time=0.0, **changes)
            last = bare.experiment().last
            changes['settle_time'] = self.settle_time if self.settle_time <= last else 0.0
            changes['retunes'] = tuple(r for r in self.retunes if r.time <= last)
        return attrs.evolve(self, noise=changed_noise, **changes)

    def _experiment(self, plant: Plant) -> Experiment:
        return Experiment(
            plant=plant,
            reference=self.reference.make(),
            disturbance=self.disturbance.make(),
            noise=self.noise,
            noise_signal=self.noise_signal.make(),
            faults=self.faults,
            initial_state=self.initial_state,
            retunes=self.retunes,
            rate=self.rate,
            duration=self.duration,
            error=self.error,
            settle_time=self.settle_time,
        )


def _given(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _checked_state(plant: Plant, state: Any) -> tuple[float, ...]:
    if isinstance(state, (list, tuple)):
        numbers = [x for x in state if isinstance(x, (int, float)) and not isinstance(x, bool)]
        if not state:
            return (0.0,) * plant.states
        if len(state) == len(numbers) == plant.states and all(map(isfinite, numbers)):
            return tuple(map(float, numbers))
    raise SettingError('plant.initial_state', state, f'a list of {plant.states} finite numbers')


def _check_controllers(
    plant: Plant, controllers: dict[str, ControllerSettings], rate: float
) -> None:
    if not controllers:
        raise ScenarioError('there is no controller: controllers needs at least one')
    for name, settings in controllers.items():
        check_controller_name(name)
        if settings.plant_order != plant.order:
            raise SettingError(
                f'controllers.{name}.plant_order',
                settings.plant_order,
                f'{plant.order}, the order of the plant',
            )
        try:
            settings.check_rate(rate)
        except SettingError as error:
            raise error.inside(f'controllers.{name}') from None


def check_controller_name(name: object) -> None:
    """Refuse a controller name that cannot be a ROS namespace."""
    if not isinstance(name, str) or not CONTROLLER_NAME.fullmatch(name):
        raise SettingError(
            'controllers', name, 'named by letters, digits and _, no digit first (a ROS name)'
        )


def _checked_retunes(
    retunes: tuple[Retune, ...], controllers: dict[str, ControllerSettings], last: float
) -> tuple[Retune, ...]:
    """Merge the changes in order of time into each controller, as a run will; return them so."""
    checked = []
    merged = dict(controllers)
    for i, retune in sorted(enumerate(retunes), key=lambda item: item[1].time):
        path = f'retune[{i}]'
        if retune.time > last:
            raise SettingError(
                f'{path}.time', retune.time, f'a finite number from 0 to {last:g} s, in the run'
            )
        if not retune.settings:
            raise ScenarioError(f'{path} changes nothing: it needs a controller setting')
        for key, value in retune.settings.items():
            _check_live(path, key, value)
        for name, settings in merged.items():
            merged[name] = _merge(path, name, settings, retune)
        after = next(iter(merged.values()))
        values = {key: getattr(after, key) for key in retune.settings}
        checked.append(Retune(time=retune.time, settings=values))
    return tuple(checked)


def _check_live(path: str, key: str, value: object) -> None:
    live = [name for name, setting in SETTINGS.items() if setting.live]
    if key not in SETTINGS:
        raise UnknownName(f'{path}.{key}', value, did_you_mean(key, ['time', *live]))
    if key not in live:
        raise SettingError(f'{path}.{key}', value, 'left out: it is fixed at the start')


def _merge(
    path: str, name: str, settings: ControllerSettings, retune: Retune
) -> ControllerSettings:
    everything = attrs.asdict(settings) | retune.settings
    try:
        return build(ControllerSettings, everything, path)
    except SettingError as error:
        raise SettingError(
            error.name, error.value, f'{error.allowed} (with controllers.{name})'
        ) from None
