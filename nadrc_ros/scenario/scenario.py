"""One description of an experiment: plant, signals, noise, controllers, changes on the way."""

from __future__ import annotations

from functools import partial
import re
from typing import Any

import attrs
from nadrc_ros.adrc.cascade import loops_of
from nadrc_ros.adrc.errors import did_you_mean, SettingError, UnknownName
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario.specs import PlantSpec, SignalSpec
from nadrc_ros.scenario.units import Units
from nadrc_ros.scenario.user_code import blame, ScenarioError
from nadrc_ros.simulation.experiment import Conditions, Experiment, Retune
from nadrc_ros.simulation.integrate import substeps_for
from nadrc_ros.simulation.protocols import Plant
from nadrc_ros.simulation.sensor import Sensor
from nadrc_ros.simulation.simulate import Result, simulate

_ROS_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')
_SETTINGS = declared(ControllerSettings)
# 3.14159 for pi is the same angle.
_SAME_PERIOD = 1e-5
# Conditions that a file names beside the values of the plant.
_OF_THE_PLANT = ('initial_state', 'input_delay')


@attrs.frozen(kw_only=True)
class Scenario(Conditions):
    """
    A validated experiment with one or several controllers.

    Attributes
    ----------
    plant, reference, disturbance
        What to control, what to follow, what disturbs [unit of y^(n)].
    noise_signal
        What is added to each measurement beside the noise.
    feed_forward
        What is added to the command of each controller that listens to it [command unit].
    controllers
        Settings by name; a name is also a ROS namespace. The plant order is that of the plant; of
        a cascade, the orders of its loops make that together.
    units
        Units of output and command, for axes and tables.
    retunes
        Changes of settings on the way, in order of time, for every controller.
    experiment
        What is done to each controller: all this, made.

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
    noise_signal: SignalSpec = attrs.field(factory=SignalSpec)
    feed_forward: SignalSpec = attrs.field(factory=SignalSpec)
    units: Units = attrs.field(factory=Units)
    experiment: Experiment = attrs.field(init=False, eq=False, repr=False)

    def __attrs_post_init__(self) -> None:
        same = {field.name: getattr(self, field.name) for field in attrs.fields(Conditions)}
        plant = self.plant.make()
        substeps_for(plant, self.period)  # refuses one that is too fast for the rate
        try:
            experiment = Experiment(
                plant=plant,
                reference=self.reference.make(),
                disturbance=self.disturbance.make(),
                noise_signal=self.noise_signal.make(),
                feed_forward=self.feed_forward.make(),
                **same,
            )
        except SettingError as error:
            raise error.inside('plant') if error.name in _OF_THE_PLANT else error from None
        _check_controllers(plant, self.controllers, self.rate)
        for name, settings in self.controllers.items():
            _check_period(self.sensor, name, settings)
        _check_heard(self.feed_forward, self.controllers)
        retunes = _checked_retunes(self.retunes, self.controllers, self.last)
        object.__setattr__(self, 'initial_state', experiment.initial_state)
        object.__setattr__(self, 'retunes', retunes)
        object.__setattr__(self, 'experiment', attrs.evolve(experiment, retunes=retunes))

    def __reduce__(self) -> tuple[Any, ...]:
        # A plant of a user's file cannot be sent to another process, but it can be made there.
        given = {field.name for field in attrs.fields(Scenario) if field.init}
        return partial(Scenario, **{name: getattr(self, name) for name in given}), ()

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
        return self.reference, self.disturbance, self.noise_signal, self.feed_forward

    def run(self, name: str) -> Result:
        """
        Run the controller of that name offline.

        Raises
        ------
        ScenarioError
            When the code of a user's plant or signal fails on the way.

        """
        with blame(*self.code):  # a user's plant may have a memory: each run has its own
            fresh = attrs.evolve(self.experiment, plant=self.plant.make())
            return simulate(fresh, self.controllers[name])

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
            last = Conditions(**{'duration': self.duration, 'rate': self.rate} | changes).last
            changes['settle_time'] = self.settle_time if self.settle_time <= last else 0.0
            changes['retunes'] = tuple(r for r in self.retunes if r.time <= last)
        return attrs.evolve(self, noise=changed_noise, **changes)


def _given(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _check_controllers(
    plant: Plant, controllers: dict[str, ControllerSettings], rate: float
) -> None:
    if not controllers:
        raise ScenarioError('there is no controller: controllers needs at least one')
    for name, settings in controllers.items():
        if not isinstance(name, str) or not _ROS_NAME.fullmatch(name):
            raise SettingError(
                'controllers', name, 'named by letters, digits and _, no digit first (a ROS name)'
            )
        *outer, innermost = [each.plant_order for each in loops_of(settings)]
        left = plant.order - sum(outer)
        try:
            if innermost != left:
                where = 'inner.' * len(outer) + 'plant_order'
                less = f' less the {sum(outer)} of the loops around it' if outer else ''
                raise SettingError(where, innermost, f'{left}, the order of the plant{less}')
            settings.check_rate(rate)
            for each in loops_of(settings):
                if len(each.b0_table) > 1 and each.b0_source == 'topic':
                    allowed = 'measurement or reference: a scenario has no signal b0_variable'
                    raise SettingError('b0_source', 'topic', allowed)
        except SettingError as error:
            raise error.inside(f'controllers.{name}') from None


def _check_period(sensor: Sensor, name: str, settings: ControllerSettings) -> None:
    """Refuse another period of an angle than the sensor has: the figures would be of its error."""
    period, width = settings.measurement_period, sensor.wrap_max - sensor.wrap_min
    if period > 0.0 and width > 0.0 and abs(period - width) > _SAME_PERIOD * width:
        allowed = f'{width:.9g}, what the sensor wraps by (wrap_max - wrap_min), or 0: no angle'
        raise SettingError(f'controllers.{name}.measurement_period', period, allowed)


def _check_heard(feed_forward: SignalSpec, controllers: dict[str, ControllerSettings]) -> None:
    """Refuse a feed-forward that no controller listens to: the run would be one without it."""
    innermost = [loops_of(settings)[-1] for settings in controllers.values()]
    unheard = not any(loop.feed_forward_timeout > 0.0 for loop in innermost)
    if feed_forward.title != 'none' and unheard:
        allowed = 'left out, or feed_forward_timeout of a controller above 0: none listens to it'
        raise SettingError('feed_forward', feed_forward.title, allowed)


def _checked_retunes(
    retunes: tuple[Retune, ...], controllers: dict[str, ControllerSettings], last: float
) -> tuple[Retune, ...]:
    """Merge the changes in order of time into each controller, as a run will; return them so."""
    live = [name for name, setting in _SETTINGS.items() if setting.live]
    checked, merged = [], dict(controllers)
    for i, retune in sorted(enumerate(retunes), key=lambda item: item[1].time):
        path = f'retune[{i}]'
        if retune.time > last:
            raise SettingError(
                f'{path}.time', retune.time, f'a finite number from 0 to {last:g} s, in the run'
            )
        if not retune.settings:
            raise ScenarioError(f'{path} changes nothing: it needs a controller setting')
        for key, value in retune.settings.items():
            if key not in _SETTINGS:
                raise UnknownName(f'{path}.{key}', value, did_you_mean(key, ['time', *live]))
            if key not in live:
                raise SettingError(f'{path}.{key}', value, 'left out: it is fixed at the start')
        for name, settings in merged.items():
            if len(loops_of(settings)) > 1:
                raise ScenarioError(
                    f'{path}: controllers.{name} is a cascade, and keeps its settings'
                )
            merged[name] = _merge(path, name, settings, retune)
        after = next(iter(merged.values()))
        values = {key: getattr(after, key) for key in retune.settings}
        checked.append(Retune(time=retune.time, settings=values))
    return tuple(checked)


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
