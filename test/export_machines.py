"""
Exported C under other compilers and on other machines: `make export-test`.

Says what it ran, and what it did not for want of a tool. Exit code 1 if anything failed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import re
import shutil
import subprocess
import sys
import tempfile
from typing import Any

from export_helpers import STRICT
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.structures import STRUCTURES
from nadrc_ros.export.files import Export
import yaml

ROOT = Path(__file__).resolve().parents[1]
BOARD = ROOT / 'examples' / 'c' / 'cortex_m4'
NATIVE = (
    ('gcc', '-O0'),
    ('gcc', '-O2'),
    ('gcc', '-O3', '-march=native'),
    ('clang', '-O0'),
    ('clang', '-O2'),
    ('clang', '-O3', '-march=native'),
)
M4 = ('-mcpu=cortex-m4', '-mthumb')
HARD = ('-mfloat-abi=hard', '-mfpu=fpv4-sp-d16')
# Rules of MISRA C:2012 that the C breaks, all of them advisory, and why.
DEVIATIONS = {
    '2.5': 'macros of the header are for who includes it',
    '8.7': 'the functions of the header are for who includes it',
    '8.9': 'a table at the top of the file is found sooner than one in a function',
    '12.1': 'cppcheck asks for parentheses around what stands in parentheses',
    '15.5': 'a bad sample returns at once, as in the law',
}
# Findings of cppcheck that are none.
SUPPRESSED = (
    'missingIncludeSystem',
    'unmatchedSuppression',
    'unusedFunction',  # they are for who includes the header
    'incorrectLogicOperator',  # it misreads hexadecimal floats
    'duplicateCondition',  # as in the law
    'knownConditionTrueFalse',  # as in the law, of a feature that is off
)
TIMED = r"""
#include "nadrc.h"
#include <math.h>
#include <stdio.h>
#include <time.h>

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(void)
{
    const double r[NADRC_REFERENCES] = {1.0};
    nadrc_state controller;
    double best = 1e9, y = 0.0, speed = 0.0;
    (void)nadrc_init(&controller, NAN, 0.0);
    for (int block = 0; block < 2000; block++)
    {
        const double begin = now();
        for (int i = 0; i < 1024; i++)
        {
            speed += NADRC_PERIOD * nadrc_step(&controller, y, r, NAN);
            y += NADRC_PERIOD * speed;
        }
        const double t = (now() - begin) / 1024.0;
        if (t < best) best = t;
    }
    printf("%.0f ns a step, with all checks, limits and a plant, which ends at %g\n", best, y);
    return 0;
}
"""


class Machines:
    """Runs, and counts what failed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.failed = 0

    def run(self, *command: str | Path) -> str | None:
        """Return what a command says, None where it fails, which is told."""
        words = [str(each) for each in command]
        done = subprocess.run(
            words, cwd=self.folder, capture_output=True, text=True, check=False, timeout=300
        )
        if done.returncode == 0:
            return done.stdout
        print(f'FAILED: {" ".join(words)}\n{(done.stdout + done.stderr)[:2000]}')
        self.failed += 1
        return None

    def write(self, settings: dict[str, Any], rate: float | None = 1000.0, **more: Any) -> Export:
        """Write an export into the folder."""
        export = Export(settings=ControllerSettings(**settings), rate=rate, **more)
        for name, text in export.files().items():
            (self.folder / name).write_text(text, encoding='utf-8')
        return export

    def check(self, *compiler: str, runner: tuple[str, ...] = ()) -> bool:
        """Compile and run the self test; tell whether the bits are those of Python."""
        what = (*compiler, '-std=c99', '-ffp-contract=off', *STRICT, 'nadrc.c', 'self_test.c')
        if self.run(*what, '-o', 'self_test', '-lm') is None:
            return False
        return self.run(*runner, './self_test') is not None


def there(*tools: str, purpose: str) -> bool:
    """Tell whether tools are there; say what is not run without."""
    missing = [tool for tool in tools if shutil.which(tool) is None]
    if missing:
        print(f'NOT RUN: {purpose}: there is no {", ".join(missing)}')
    return not missing


def shapes() -> Iterator[dict[str, Any]]:
    """Yield settings over every structure, order, number of levels and law."""
    for k, structure in enumerate(STRUCTURES):
        for order in range(1, 6):
            yield {
                'structure': structure,
                'plant_order': order,
                'levels': 1 + (order + k) % 6,
                'extended_states': 1 + order % 3,
                'feedback': ('linear', 'fal')[(order + k) % 2],
                'tracking_acceleration': 20.0 * (order % 3 == 2),
                'error_based': order % 4 == 3,
                'command_rate_limit': 300.0 * (k % 2),
                'max_dt': 0.1,
            }


def main() -> int:
    """Run everything there are tools for."""
    with tempfile.TemporaryDirectory() as folder:
        machines = Machines(Path(folder))
        for rate in (1000.0, None):
            for settings in shapes():
                more = {} if rate else {'startup_time': 0.2}
                machines.write(settings | more, rate, ticks=2500)
                machines.check('gcc', '-O1')
            kind = 'a fixed rate' if rate else 'measured time steps'
            print(f'gcc -O1: {5 * len(STRUCTURES)} shapes at {kind}')
        export = machines.write({'command_rate_limit': 200.0, 'max_dt': 0.1})
        for compiler in NATIVE:
            name = ' '.join(compiler)
            if there(compiler[0], purpose=name) and machines.check(*compiler):
                print(f'{name}: {export.ticks} calls have the bits of Python')
        (machines.folder / 'timed.c').write_text(TIMED)
        built = machines.run(
            *('gcc', '-O2', '-ffp-contract=off', 'nadrc.c', 'timed.c', '-o', 'timed', '-lm')
        )
        if built is not None:
            print('gcc -O2: ' + (machines.run('./timed') or '').strip())
        aarch64(machines)
        cortex_m4(machines, export)
        rules(machines)
        single(machines)
        example(machines)
    print(f'{machines.failed} failed' if machines.failed else 'all of that is well')
    return int(machines.failed > 0)


def aarch64(machines: Machines) -> None:
    """Run under qemu-user; gcc contracts there unless it is told not to."""
    compiler = 'aarch64-linux-gnu-gcc'
    if not there(compiler, 'qemu-aarch64', purpose='aarch64'):
        return
    for level in ('-O0', '-O2', '-O3'):
        if machines.check(compiler, level, '-static', runner=('qemu-aarch64',)):
            print(f'aarch64 under qemu, {level}: the bits of Python')
    machines.run(compiler, '-O2', '-static', 'nadrc.c', 'self_test.c', '-o', 'self_test')
    again = ['qemu-aarch64', './self_test']
    done = subprocess.run(again, cwd=machines.folder, capture_output=True, check=False)
    caught = done.returncode == 2
    machines.failed += not caught
    print(f'aarch64 without -ffp-contract=off: {"caught" if caught else "NOT CAUGHT"}')


def cortex_m4(machines: Machines, export: Export) -> None:
    """Run under qemu-system-arm with semihosting, and tell what it takes."""
    gcc, qemu = 'arm-none-eabi-gcc', 'qemu-system-arm'
    if not there(gcc, qemu, purpose='Cortex-M4'):
        return
    bare = ('--specs=rdimon.specs', '-nostartfiles', '-T', BOARD / 'memory.ld', BOARD / 'start.c')
    for flags in (('-O2', *M4, *HARD), ('-Os', *M4)):
        machines.run(
            *(gcc, '-std=c99', '-ffp-contract=off', *flags, *bare, 'nadrc.c', 'self_test.c'),
            *('-o', 'self_test.elf', '-lm'),
        )
        if machines.run(*emulated(qemu), 'self_test.elf') is not None:
            print(f'Cortex-M4 under qemu, {" ".join(flags)}: the bits of Python')
        machines.run(gcc, '-std=c99', '-ffp-contract=off', *flags, '-c', 'nadrc.c', '-o', 'm4.o')
        size = (machines.run('arm-none-eabi-size', 'm4.o') or '').split()
        if size:
            tables = 8 * sum(map(_numbers, export.source.arrays.values()))
            print(
                f'  flash {size[6]} bytes, {tables} of them tables; RAM: that of the states alone'
            )


def example(machines: Machines) -> None:
    """Run the loop of examples/c on the board."""
    gcc, qemu = 'arm-none-eabi-gcc', 'qemu-system-arm'
    if not there(gcc, qemu, purpose='the example for a Cortex-M4'):
        return
    page = yaml.safe_load((BOARD.parent / 'yaw.yaml').read_text(encoding='utf-8'))
    values = page['/**/controller']['ros__parameters']
    machines.write(values, values.pop('rate'), name='yaw', ticks=0)
    bare = ('--specs=rdimon.specs', '-nostartfiles', '-T', BOARD / 'memory.ld', BOARD / 'start.c')
    machines.run(
        *(gcc, '-std=c99', '-O2', '-Wall', '-Wextra', '-Werror', '-ffp-contract=off', *M4, *bare),
        *('-I.', BOARD / 'loop.c', 'yaw.c', '-o', 'loop.elf'),
    )
    print('examples/c/cortex_m4: ' + (machines.run(*emulated(qemu), 'loop.elf') or '').strip())


def _numbers(table: list[Any]) -> int:
    return sum(_numbers(each) if isinstance(each, list) else 1 for each in table)


def emulated(qemu: str) -> tuple[str, ...]:
    """Return the command that runs a program on the board."""
    return (
        *(qemu, '-M', 'mps2-an386', '-nographic'),
        *('-semihosting-config', 'enable=on,target=native', '-kernel'),
    )


def rules(machines: Machines) -> None:
    """Look for what is undefined, and for what cppcheck and MISRA's rules find."""
    machines.run('gcc', '-std=c99', '-O2', '-ffp-contract=off', '-c', 'nadrc.c', '-o', 'nadrc.o')
    undefined = machines.run('nm', '--undefined-only', 'nadrc.o')
    machines.failed += bool(undefined)
    print(f'undefined symbols at a fixed rate: {undefined or "none"}')
    if not there('cppcheck', purpose='cppcheck, MISRA C:2012'):
        return
    known = ('-DFLT_EVAL_METHOD=0', '-DDBL_MANT_DIG=53', '--std=c99', '-q')
    off = [f'--suppress={each}' for each in SUPPRESSED]
    machines.run('cppcheck', *known, '--enable=all', *off, '--error-exitcode=1', 'nadrc.c')
    found = subprocess.run(
        ['cppcheck', *known, '--addon=misra', 'nadrc.c', 'nadrc.h'],
        cwd=machines.folder,
        capture_output=True,
        text=True,
        check=False,
    )
    broken = set(re.findall(r'\[misra-c2012-([0-9.]+)\]', found.stderr))
    for rule in sorted(broken - DEVIATIONS.keys()):
        machines.failed += 1
        print(f'FAILED: MISRA C:2012 rule {rule}: {found.stderr}')
    if not broken:
        print('NOT RUN: MISRA C:2012: this cppcheck found nothing at all, not even what is known')
    for rule in sorted(broken & DEVIATIONS.keys()):
        print(f'MISRA C:2012 rule {rule} is not kept: {DEVIATIONS[rule]}')


def single(machines: Machines) -> None:
    """Run what computes with float, where it has hardware for it and here."""
    export = machines.write({'command_rate_limit': 200.0, 'max_dt': 0.1}, single=True)
    if machines.check('gcc', '-O2'):
        print(f'float, gcc -O2: the bits of Python with float32. {export.about()[-3]}')


if __name__ == '__main__':
    sys.exit(main())
