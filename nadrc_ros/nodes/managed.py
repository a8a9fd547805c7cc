"""A controller as a managed node: unconfigured, inactive, active, finalized."""

from __future__ import annotations

from collections.abc import Mapping
import traceback
from typing import Any, TypeVar

from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.ros.diagnostics import Report, WARN
from nadrc_ros.ros.versions import guard_transitions
from rclpy.lifecycle import LifecycleNodeMixin, ManagedEntity, TransitionCallbackReturn

T = TypeVar('T')
_SUCCESS, _FAILURE, _ERROR = (
    getattr(TransitionCallbackReturn, name) for name in ('SUCCESS', 'FAILURE', 'ERROR')
)
# Why a loop may not be closed, and what to do.
_NOT_YET = {
    'unconfigured': 'the controller is unconfigured: configure it first',
    'finalized': 'the controller is finalized: start it again',
}


def managed(kind: type[T]) -> type[T]:
    """Return a class of controller nodes that are managed nodes too."""
    return type('Managed' + kind.__name__, (Managed, kind), {})


class Managed(LifecycleNodeMixin):
    """
    What makes a managed node of a controller node, which follows among the base classes.

    It is active exactly while the loop is closed: who closes or opens it in another way, as by
    ``~/enable``, by a lease that runs out or by giving way, activates or deactivates it.
    """

    def __init__(self, *, parameters: Mapping[str, Any] | None = None, **more: Any) -> None:
        given = {**(parameters or {}), 'enabled_at_start': False}
        # of the node; what is of its life begins in set_up, when there is a node
        super(ManagedEntity, self).__init__(parameters=given, **more)

    def set_up(self) -> None:
        """Begin as unconfigured."""
        if self.pacing.lockstep:
            raise SettingError('pacing', 'lockstep', 'realtime with --managed')
        LifecycleNodeMixin.__init__(self)
        guard_transitions(self, self._refuse)
        super().set_up()
        self._commission.barred = 'a managed controller makes no experiments: start it without'
        self._commission.barred += ' --managed to commission'

    @property
    def lifecycle(self) -> str:
        """Return in which state of its life it is."""
        label: str = self._state_machine.current_state[1]
        return label

    def enable(self, on: bool = True, why: str = '') -> tuple[bool, str]:
        """Close the loop where it is configured, or open it."""
        if on and self.lifecycle in _NOT_YET:
            return False, _NOT_YET[self.lifecycle]
        done: tuple[bool, str] = super().enable(on, why)
        return done

    def _set_enabled(self, on: bool) -> None:
        super()._set_enabled(on)
        if on and self.lifecycle == 'inactive':
            self.trigger_activate()
        elif not on and self.lifecycle == 'active':
            self.trigger_deactivate()

    def _refuse(self, text: str) -> None:
        self.events.tell('refused', text)
        if self.remarks.due(text):
            self.remarks.log(text, WARN)

    # ---- what the transitions do ----

    def on_configure(self, _: Any) -> Any:
        """Let the loop be closed from now on."""
        return _SUCCESS

    def on_activate(self, _: Any) -> Any:
        """Close the loop, if nothing forbids it."""
        return _SUCCESS if self.controller.enabled else self._switch(True, 'activated')

    def on_deactivate(self, _: Any) -> Any:
        """Open the loop: the command goes to the safe one."""
        return self._switch(False, 'deactivated') if self.controller.enabled else _SUCCESS

    def on_cleanup(self, _: Any) -> Any:
        """Restart the observers."""
        self._reset()
        return _SUCCESS

    def on_shutdown(self, _: Any) -> Any:
        """Open the loop for good; the process goes on, as other axes may be in it."""
        return self._switch(False, 'shut down') if self.controller.enabled else _SUCCESS

    def _switch(self, on: bool, why: str) -> Any:
        """Close or open the loop; an error ends the process, which rclpy would keep to itself."""
        try:
            done, said = self.enable(on, why)
        except Exception:
            self.fail('stopping after an error:\n' + traceback.format_exc())
            return _ERROR
        if not done:
            self._refuse(f'not {why}: {said}' if on else said)
        return _SUCCESS if done or not on else _FAILURE

    def report(self) -> Report:
        """Add the state of its life."""
        level, message, values = super().report()
        return level, message, {'lifecycle': self.lifecycle, **values}
