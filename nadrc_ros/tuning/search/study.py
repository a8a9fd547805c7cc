"""
A study: generations of designs, asked for, scored on all cores, told in order, and stored.

A generation is a function of the settings and of the generations stored before it, whoever
computes it: so the result depends neither on the number of cores nor on interruptions. Trials are
stored when their generation is finished. One that was stored in part is computed again and its
missing part added.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor
from contextlib import closing, ExitStack
from hashlib import sha256
import json
from math import ceil, log
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.scenario import dump, Scenario
from nadrc_ros.tuning.search.samplers import FIRST, make_sampler
from nadrc_ros.tuning.search.score import Figures, Judge, Score, undominated
from nadrc_ros.tuning.search.settings import TuneSettings
from nadrc_ros.tuning.search.variables import first_designs, Variable
import numpy as np
import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.storages.journal import (
    JournalFileBackend,
    JournalFileSymlinkLock,
    JournalStorage,
)
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial

# After that long [s] the lock of a process that was killed while it wrote is no lock.
_LOCK_TIMEOUT = 5
# Value of what has none, and how much worse a constrained design is than any other.
_NO_VALUE = 1e9
_FORBIDDEN = 1e3
_SMALLEST = 1e-100
# Share of the first generation that rules propose; the rest is random.
_BY_RULE = 0.5

optuna.logging.set_verbosity(optuna.logging.ERROR)


@attrs.frozen
class Trial:
    """A design that was tried."""

    values: dict[str, float]
    score: Score


def open_storage(where: str) -> optuna.storages.BaseStorage:
    """
    Return the storage at a database URL, or in a journal file.

    Raises
    ------
    UserError
        When it cannot be opened.

    """
    try:
        if '://' in where:
            return optuna.storages.RDBStorage(where)
        path = Path(where).resolve()  # the lock, a link to it, must lead somewhere
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = JournalFileSymlinkLock(str(path), grace_period=_LOCK_TIMEOUT)
        return JournalStorage(_Journal(str(path), lock))
    except OSError:
        raise  # names the file, which may be beside --out
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(f'--storage {where}: not a study, nor a database ({reason})') from None


class _Journal(JournalFileBackend):
    """
    A journal file that does not wait for the disk after each trial.

    To wait takes about as long as a trial. A killed process loses nothing; after a power cut the
    last trials are computed again.
    """

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Write entries, a line each."""
        lines = [json.dumps(log, separators=(',', ':')) + '\n' for log in logs]
        self._lock.acquire()
        try:
            with open(self._file_path, 'a', encoding='utf-8') as file:
                file.writelines(lines)
        finally:
            self._lock.release()


class TuningStudy:
    """
    The study of one controller, in a storage that several machines may share.

    Attributes
    ----------
    known, total, best
        How many trials are scored so far, how many there are in the end, for generations are
        whole, and the best before the last generation in a few words.

    """

    def __init__(
        self,
        judge: Judge,
        varied: Sequence[Variable],
        storage: optuna.storages.BaseStorage,
        name: str,
        worker: int = 0,
    ) -> None:
        self.judge = judge
        self.tuning = judge.tuning
        self.varied = varied
        self.worker = worker
        self.label = name
        self.first = FIRST * judge.tuning.population
        self.name = f'{name}-{digest(judge.scenario, name, self.tuning, varied)}'
        self.directions = [StudyDirection.MINIMIZE] * (1 if self.tuning.budget else 2)
        self._memory: optuna.Study | None = None
        self._read: dict[int, Trial] = {}
        self.stored = optuna.create_study(
            storage=storage, study_name=self.name, directions=self.directions, load_if_exists=True
        )
        self.known = self.done
        self.total = self._total()
        self.best = ''

    def trials(self) -> list[Trial]:
        """Return what was tried so far, in order."""
        return self._trials(self.stored.get_trials(deepcopy=False))

    def _trials(self, stored: Sequence[FrozenTrial]) -> list[Trial]:
        """Return them as this module knows them; each is read once, as a stored one stays."""
        for trial in stored:
            if trial.number not in self._read:
                self._read[trial.number] = _trial(trial)
        return [self._read[trial.number] for trial in stored]

    @property
    def done(self) -> int:
        """Return how many trials are stored."""
        return len(self.stored.get_trials(deepcopy=False))

    def _total(self) -> int:
        later = max(0, self.tuning.trials - self.first)
        size = self.tuning.population
        return max(self.first + ceil(later / size) * size, self.done)

    def _best(self) -> str:
        """Return the best so far in a few words."""
        known = [t.score.figures for t in self.trials() if not t.score.violations]
        least = min((f.objective for f in known if f is not None), default=None)
        return '' if least is None else f'{self.label}: {self.tuning.objective} from {least:.4g}'

    def generations(
        self, executor: Executor, tell: Callable[[], None]
    ) -> Generator[None, None, None]:
        """
        Go on generation by generation until all trials are stored.

        Yields when the designs of one are handed out, before it waits for their scores; ``tell``
        is called after each of these.
        """
        while self.done < self.tuning.trials:
            self.best = self._best()
            history, begun = self._history()
            memory, asked = self._ask(history)
            better = front_of_first(self._trials(history), bool(self.tuning.budget))
            scores = [
                executor.submit(self.judge.score, dict(trial.params), better) for trial in asked
            ]
            try:
                yield
                for i, (trial, score) in enumerate(zip(asked, scores)):
                    self._tell(memory, trial, score.result())
                    self.known = len(history) + i + 1
                    tell()
            finally:
                for score in scores:
                    score.cancel()
            finished = memory.get_trials(deepcopy=False)[len(history) :]
            self.stored.add_trials(finished[begun:])
            self.total = self._total()  # others may have added theirs

    def _tell(self, memory: optuna.Study, trial: optuna.Trial, score: Score) -> None:
        trial.set_user_attr('worker', self.worker)
        trial.set_user_attr('score', attrs.asdict(score))
        if not self.tuning.budget:  # with one, _values says it, and CMA-ES knows no other way
            for name, violation in score.violations.items():
                trial.set_constraint(name, violation)
        memory.tell(trial, _values(score, self.tuning.budget))

    def _ask(self, history: list[FrozenTrial]) -> tuple[optuna.Study, list[optuna.Trial]]:
        """Return a study in memory with the history, and the generation that follows it."""
        own, size = sum(map(self._is_own, history)), self.tuning.population
        generation = 0 if own == 0 else 1 + (own - self.first) // size
        memory = self._in_memory(history)
        memory.sampler = make_sampler(self.tuning, self._seed(generation), history)
        count = size if own else self.first
        if not history:
            by_rule = round(_BY_RULE * count)
            for design in first_designs(self.judge.settings, self.varied, by_rule):
                memory.enqueue_trial(design)
        space = {v.name: _distribution(v, self.tuning.method) for v in self.varied}
        return memory, [memory.ask(space) for _ in range(count)]

    def _in_memory(self, history: list[FrozenTrial]) -> optuna.Study:
        """Return a study with the history: that of the last generation, if nobody added to it."""
        memory = self._memory
        if memory is None or len(memory.get_trials(deepcopy=False)) != len(history):
            memory = self._memory = optuna.create_study(directions=self.directions)
            memory.add_trials(history)
        return memory

    def _history(self) -> tuple[list[FrozenTrial], int]:
        """Return all trials but those of an incomplete generation of its own, and their count."""
        trials = self.stored.get_trials(deepcopy=False)
        own = [i for i, trial in enumerate(trials) if self._is_own(trial)]
        over = len(own) - self.first
        begun = len(own) if over < 0 else over % self.tuning.population
        left_out = set(own[len(own) - begun :])
        return [trial for i, trial in enumerate(trials) if i not in left_out], begun

    def _is_own(self, trial: FrozenTrial) -> bool:
        return bool(trial.user_attrs['worker'] == self.worker)

    def _seed(self, generation: int) -> int:
        entropy = np.random.SeedSequence([self.tuning.seed, self.worker, generation])
        return int(entropy.generate_state(1)[0])


def run_studies(
    studies: Sequence[TuningStudy],
    executor: Executor,
    tell: Callable[[int, str], None] = lambda known, best: None,
) -> None:
    """
    Run studies to their ends, in turn: while one proposes designs, those of the others are run.

    ``tell`` is called after each trial with how many are known in all, and the best of each study.
    When one fails, designs that were not begun are cancelled.
    """

    def told() -> None:
        known = sum(min(one.known, one.total) for one in studies)
        tell(known, ', '.join(one.best for one in studies if one.best))

    with ExitStack() as stack:
        turns = [stack.enter_context(closing(one.generations(executor, told))) for one in studies]
        while turns:
            turns = [turn for turn in turns if next(turn, 'ended') != 'ended']


def front_of_first(trials: Sequence[Trial], single: bool) -> list[Figures]:
    """Return the figures with the first seed of the best designs, for others to come close to."""
    known = [
        t.score.first
        for t in trials
        if t.score.figures is not None and t.score.first is not None and not t.score.violations
    ]
    if single:
        best = min(known, key=lambda f: f.objective, default=None)
        return [] if best is None else [Figures(best.objective, 0.0)]
    return undominated(known, lambda one: one)


def digest(scenario: Scenario, name: str, tuning: TuneSettings, varied: Sequence[Variable]) -> str:
    """Return what tells studies apart: everything that changes a result but the length."""
    text = dump(attrs.evolve(scenario, controllers={name: scenario.controllers[name]}))
    for file in scenario.files:
        text = text.replace(file, sha256(Path(file).read_bytes()).hexdigest())
    parts: list[Any] = [
        text,
        sorted(attrs.asdict(attrs.evolve(tuning, trials=1)).items()),
        list(varied),
    ]
    return sha256(repr(parts).encode()).hexdigest()[:12]


def _distribution(variable: Variable, method: str) -> BaseDistribution:
    if variable.whole:
        low, high = int(variable.low), int(variable.high)
        # NSGA-II swaps and draws levels as the few words that they are; the others need a number.
        if method == 'nsga2':
            return CategoricalDistribution(range(low, high + 1))
        return IntDistribution(low, high)
    return FloatDistribution(variable.low, variable.high, log=variable.low > 0.0)


def _trial(trial: FrozenTrial) -> Trial:
    noted = trial.user_attrs['score']
    figures, first = (noted[k] and Figures(**noted[k]) for k in ('figures', 'first'))
    return Trial(trial.params, Score(figures=figures, first=first, violations=noted['violations']))


def _values(score: Score, budget: float) -> list[float]:
    """
    Return what the search makes least.

    On a front it keeps designs that are evenly spread, and where tracking is bad they are of
    little use: it is told log ISU and -1 / objective^2, which spreads them where it is good.
    """
    known = score.figures or score.first
    if budget:
        if score.violations or known is None:
            return [_FORBIDDEN * (1.0 + sum(score.violations.values()))]
        return [log(max(known.objective, _SMALLEST))]
    if known is None:
        return [_NO_VALUE, _NO_VALUE]
    return [-(max(known.objective, _SMALLEST) ** -2), log(max(known.isu, _SMALLEST))]
