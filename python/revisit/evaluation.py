"""How well places are recognised: precision and recall of own matches, and the protocols of docs/EVALUATION.md."""

from dataclasses import dataclass

import numpy as np

from revisit._core.evaluation import (
    ListedPairs, Match, PairResult, PrIntervals, Protocol, PrSummary, Task, Trajectory, Verdict, blocks_of, bootstrap,
    evaluate_pairs, judge, make_tasks, make_trajectory, precision_recall, protocols, read_pairs, retrieve, summarize)

__all__ = [
    'Evaluation', 'ListedPairs', 'Match', 'PairResult', 'PrIntervals', 'PrSummary', 'Protocol', 'Task', 'Trajectory', 'Verdict',
    'blocks_of', 'bootstrap', 'evaluate', 'evaluate_pairs', 'judge', 'make_tasks', 'make_trajectory', 'precision_recall',
    'protocols', 'read_pairs', 'retrieve', 'summarize', 'verdicts']


def verdicts(scores, correct, positive=None, ignored=None) -> list[Verdict]:
    """Verdicts of own scores and labels, one a query: what precision_recall(), summarize() and bootstrap() take.

    correct: the best match of the query is true.
    positive: there was a true match to find; None: only where the match is true.
    ignored: the match is neither right nor wrong.
    """
    if any(isinstance(given, np.ma.MaskedArray) for given in (scores, correct, positive, ignored)):
        raise TypeError('expected arrays, found a masked one, whose mask would be lost: leave these queries out, or mark them ignored')
    columns = [np.asarray(scores, np.float64), np.asarray(correct)]
    columns.append(columns[1] if positive is None else np.asarray(positive))
    columns.append(np.zeros(len(columns[1]), bool) if ignored is None else np.asarray(ignored))
    for name, column in zip(('scores', 'correct', 'positive', 'ignored'), columns):
        if column.shape != columns[0].shape or column.ndim != 1:
            raise ValueError(f'{name}: expected one a query, {columns[0].shape}, found {column.shape}')
        if name != 'scores' and column.dtype != bool:
            raise TypeError(f'{name}: expected truth values, found {column.dtype}')
    return [Verdict(*row) for row in zip(*(column.tolist() for column in columns))]


@dataclass
class Evaluation:
    """What one task gave."""

    task: Task
    summary: PrSummary
    intervals: PrIntervals | None
    curve: dict[str, np.ndarray]
    matches: list[Match]        # none of a task that decides on pairs
    verdicts: list[Verdict]


def evaluate(task: Task, trajectory: Trajectory, *, descriptors=None, matches: list[Match] | None = None, k: int = 4,
             score: str | None = None, resamples: int = 1000, block: str | None = None, threads: int = 1) -> Evaluation:
    """A task with given descriptors, or with own matches.

    descriptors: float32 [scans][numbers], a row for each scan of the trajectory, compared by cosine.
    matches: one for each of task.queries, in their order. A task that decides on pairs takes descriptors only.
    k, score: of retrieve().
    resamples: of the bootstrap; 0: no intervals.
    block: length of its blocks, as blocks_of() takes it.
    """
    if (descriptors is None) == (matches is None):
        raise ValueError('evaluate: give descriptors or matches, one of both')
    if task.decides_on_pairs:
        if descriptors is None:
            raise ValueError(f'{task.name} decides on pairs of scans, which takes descriptors')
        pairs = evaluate_pairs(descriptors, task, trajectory, resamples=resamples, block=block, threads=threads)
        return Evaluation(task, pairs.summary, pairs.intervals, pairs.curve, [], [])
    if matches is None:
        matches = retrieve(descriptors, task, k=k, score=score, threads=threads)
    judged = judge(matches, task, trajectory)
    intervals = None
    if resamples:
        intervals = bootstrap(judged, task.missed, blocks=blocks_of(task, trajectory, block), resamples=resamples, threads=threads)
    return Evaluation(task, summarize(judged, task.missed), intervals, precision_recall(judged, task.missed), matches, judged)
