"""What is taken along from a page: the parameters as a file, and the report of the run."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
import sys
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.live.outbox import Message
from nadrc_ros.live.undo import Values
from nadrc_ros.scenario.parameter_files import ANY_CONTROLLER, parameter_text

# What no second run may have: its file exists.
_ONCE = ('trace',)
# A report takes so long at most [s].
_LONGEST = 120.0


def saved(node: str, values: Mapping[str, Any], before: Values) -> Message:
    """Return the parameter file of a controller, with those values that replace others."""
    key = ANY_CONTROLLER if node.endswith('/controller') else node
    kept = {name: value for name, value in values.items() if name not in _ONCE}
    difference = [
        {'name': name, 'from': old, 'to': values[name]}
        for name, old in before.items()
        if name in values
    ]
    many = (
        '1 parameter differs' if len(difference) == 1 else f'{len(difference)} parameters differ'
    )
    return {
        'name': f'{node.strip("/").replace("/", "_")}.yaml',
        'text': f'{many} from where you began' if difference else 'as where you began',
        'difference': difference,
        'yaml': parameter_text({key: kept}),
    }


async def make_report(run: str, folder: Path) -> str:
    """
    Make the page of a recorded run in a folder, in a process of its own; return its name.

    Raises
    ------
    UserError
        When that fails, with the last line of what was said.

    """
    name = f'{Path(run).name}.html'
    command = ['nice', sys.executable, '-m', 'nadrc_ros.cli', 'report']
    process = await asyncio.create_subprocess_exec(
        *command,
        *('--page', str(folder / name), '--', run),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    try:
        said, _ = await asyncio.wait_for(process.communicate(), _LONGEST)
    except asyncio.TimeoutError:
        process.kill()
        raise UserError(f'the report was not ready after {_LONGEST:g} s') from None
    if process.returncode:
        lines = said.decode(errors='replace').strip().splitlines()
        raise UserError(lines[-1] if lines else 'the report failed')
    return name
