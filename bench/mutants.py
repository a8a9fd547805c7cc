"""
Whether the tests notice when the code is wrong: a sample of mutants, each against its tests.

    python -m bench.mutants [N] [SEED] [PART ...]

cosmic-ray knows what can be changed in a file: an operator, a comparison, a number by one, a
condition, a loop that is left out. Of all such places ``N`` are drawn, and of the changes that are
possible there one each. A mutant is written into a copy of the tree and the tests that concern its
part are run until one fails; one that no test fails has survived, and is printed as a diff.

Left out is what is equivalent by construction: annotations and decorators, numbers that one more
changes by less than a thousandth, identity for equality, and arithmetic that no float has.

Written to out/bench/mutants.json: for each mutant its file, line, operator, outcome and diff.
"""

from __future__ import annotations

import ast
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from difflib import unified_diff
from fnmatch import fnmatch
import os
from pathlib import Path
from queue import SimpleQueue
from random import Random
import shutil
import signal
import subprocess
import sys
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any, NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from nadrc_ros.atomic import write_json

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / 'out' / 'bench' / 'mutants.json'
MUTANTS = 300
SEED = 1
# Part -> the tests that concern it; those named after the mutated file come first. Each pattern
# may match nothing once the files are named otherwise, all together may not.
PARTS = {
    'adrc': (
        *('test_law.py', 'test_gains.py', 'test_observer*.py', 'test_feedback.py'),
        *('test_differentiator.py', 'test_against_pyadrc.py', 'test_controller.py'),
        *('test_supervisor.py', 'test_policy_table.py', 'test_setpoints.py', 'test_stall.py'),
        *('test_retune.py', 'test_transfer*.py', 'test_settings.py'),
        *('test_dropped_ticks.py', 'test_sparse_samples.py', 'test_docs.py'),
    ),
    'theory': ('test_theory*.py', 'test_first_design.py'),
    'ros/stamps.py': ('ros/test_stamps*.py',),
    'tuning/design': ('test_first_design.py', 'test_design*.py', 'test_cli_design.py'),
    'tuning/identification': ('test_identif*.py', 'test_shaping.py', 'test_cli_identify.py'),
}
ARITHMETIC = {'Add', 'Sub', 'Mul', 'Div', 'Pow'}
LEFT_OUT = ('Variable', 'RemoveDecorator', 'Exception', '_Is', 'Invert', 'UAdd')
# One more or less is no change worth a test from here on.
LARGE = 1000.0
OPTIONS = ('-xqq', '-p', 'no:cacheprovider', '--hypothesis-profile=mutants', '--hypothesis-seed=0')
IGNORED = ('.git', '.venv*', 'build', 'install', 'log', 'out', 'runs', '__pycache__', '.*_cache')


class Mutant(NamedTuple):
    """A change of one place of a file: the one of this number that an operator can make in it."""

    part: str
    file: str
    line: int
    operator: str
    occurrence: int


def operators() -> list[str]:
    """Return the operators whose mutants are worth a test."""
    names = []
    for name in operator_names():
        kind = name.partition('/')[2]
        if kind.startswith('ReplaceBinaryOperator_'):
            worth = {*kind.split('_')[1:]} <= ARITHMETIC
        else:
            worth = not any(word in kind for word in LEFT_OUT)
        if worth:
            names.append(name)
    return names


def passive(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return from where to where, line and column, there is an annotation or a decorator."""
    spans = []
    for node in ast.walk(ast.parse(source)):
        parts = [getattr(node, 'annotation', None), getattr(node, 'returns', None)]
        for part in (*parts, *getattr(node, 'decorator_list', ())):
            if part is not None:
                begin = part.lineno, part.col_offset
                spans.append((begin, (part.end_lineno, part.end_col_offset)))
    return spans


def mutants_of(part: str, file: Path) -> list[list[Mutant]]:
    """Return the mutants of each place of a file."""
    source = file.read_text(encoding='utf-8')
    spans, places = passive(source), dict[Any, list[Mutant]]()
    nodes = list(ast_nodes(get_ast(source)))
    for name in operators():
        operator, occurrence = get_operator(name)(), -1
        for node in nodes:
            for place in operator.mutation_positions(node):
                occurrence += 1
                if 'NumberReplacer' in name and abs(ast.literal_eval(node.value)) > LARGE:
                    continue
                if not any(begin <= place[0] < end for begin, end in spans):
                    path = str(file.relative_to(ROOT))
                    mutant = Mutant(part, path, place[0][0], name, occurrence)
                    places.setdefault(place, []).append(mutant)
    return list(places.values())


def sample(count: int, seed: int, parts: list[str]) -> list[Mutant]:
    """Draw so many places of the parts, and of the mutants of each place one."""
    places = []
    for part in parts:
        path = ROOT / 'nadrc_ros' / part
        for file in sorted(path.rglob('*.py')) if path.is_dir() else [path]:
            places += mutants_of(part, file)
    random = Random(seed)
    chosen = random.sample(places, min(count, len(places)))
    print(f'{len(chosen)} of {len(places)} places, seed {seed}', flush=True)
    return [random.choice(mutants) for mutants in chosen]


def tests_of(part: str, file: str = '') -> list[str]:
    """Return the test files of a part, those named after the file first."""
    names = sorted(str(p.relative_to(ROOT / 'test')) for p in (ROOT / 'test').rglob('test_*.py'))
    found = [n for pattern in PARTS[part] for n in names if fnmatch(n, pattern)]
    if not found:
        raise SystemExit(f'{part}: no test file matches {PARTS[part]}')
    return sorted(dict.fromkeys(found), key=lambda n: Path(file).stem not in n)


class Tree:
    """A copy of this tree in which one mutant at a time lives."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*IGNORED), symlinks=True)

    def passes(self, tests: list[str], timeout: float) -> str:
        """Run tests until one fails and return 'killed', 'too slow' or 'survived'."""
        process = subprocess.Popen(
            [sys.executable, '-m', 'pytest', *OPTIONS, *(f'test/{name}' for name in tests)],
            cwd=self._folder,
            env=os.environ | {'PYTHONPATH': str(self._folder)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return 'killed' if process.wait(timeout) else 'survived'
        except subprocess.TimeoutExpired:
            return 'too slow'
        finally:
            with_children(process)

    def judge(self, mutant: Mutant, timeout: float) -> tuple[str, str]:
        """Return what became of a mutant, and the change as a diff."""
        path = self._folder / mutant.file
        source, times = path.read_text(encoding='utf-8'), path.stat()
        mutated = mutate_code(source, get_operator(mutant.operator)(), mutant.occurrence)
        lines = [text.splitlines(keepends=True) for text in (source, mutated)]
        diff = ''.join(unified_diff(*lines, mutant.file, mutant.file, n=2))
        path.write_text(mutated, encoding='utf-8')
        try:
            first, *rest = tests_of(mutant.part, mutant.file)
            outcome = self.passes([first], timeout)
            if outcome == 'survived' and rest:
                outcome = self.passes(rest, timeout)
            return outcome, diff
        finally:
            path.write_text(source, encoding='utf-8')
            # so that its byte code is good again
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def with_children(process: subprocess.Popen[bytes]) -> None:
    """End what is left of a run of tests."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    finally:
        process.wait()


def main(words: list[str]) -> None:
    """Judge the sample and tell what survived."""
    numbers = [int(word) for word in words if word.isdigit()]
    count, seed = [*numbers, *(MUTANTS, SEED)[len(numbers) :]]
    parts = [word for word in words if not word.isdigit()] or list(PARTS)
    mutants = sample(count, seed, parts)
    workers = os.cpu_count() or 1
    begin, rows = monotonic(), []
    with TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        trees: SimpleQueue[Tree] = SimpleQueue()
        for made in pool.map(Tree, (Path(folder, str(i)) for i in range(workers))):
            trees.put(made)

        def timed(part: str) -> float:
            tree, start = trees.get(), monotonic()
            if tree.passes(tests_of(part), 3600.0) != 'survived':
                raise SystemExit(f'{part}: its tests fail without any mutant')
            trees.put(tree)
            return 20.0 + 4.0 * (monotonic() - start)

        os.environ.pop('PYTHONDONTWRITEBYTECODE', None)
        timeouts = dict(zip(parts, pool.map(timed, parts)))
        # Else the byte code of one mutant could be taken for that of the next.
        os.environ['PYTHONDONTWRITEBYTECODE'] = '1'
        print({part: f'{timeout:.0f} s at most' for part, timeout in timeouts.items()}, flush=True)

        def judged(mutant: Mutant) -> dict[str, Any]:
            tree, start = trees.get(), monotonic()
            outcome, diff = tree.judge(mutant, timeouts[mutant.part])
            trees.put(tree)
            seconds = round(monotonic() - start, 1)
            return {**mutant._asdict(), 'outcome': outcome, 'seconds': seconds, 'diff': diff}

        for row in pool.map(judged, mutants):
            rows.append(row)
            if row['outcome'] == 'survived':
                print(f'\n{row["operator"]}\n{row["diff"]}', flush=True)
    print(f'\n{"part":24}{"mutants":>8}{"killed":>8}{"too slow":>10}{"survived":>10}')
    for part in (*parts, 'all'):
        found = Counter(row['outcome'] for row in rows if part in (row['part'], 'all'))
        cells = f'{found["killed"]:8}{found["too slow"]:10}{found["survived"]:10}'
        print(f'{part:24}{found.total():8}{cells}')
    print(f'{monotonic() - begin:.0f} s')
    OUT.parent.mkdir(parents=True, exist_ok=True)
    content = {'seed': seed, 'seconds': round(monotonic() - begin), 'mutants': rows}
    write_json(OUT, 'mutants', content)


if __name__ == '__main__':
    main(sys.argv[1:])
