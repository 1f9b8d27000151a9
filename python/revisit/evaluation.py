"""Evaluation of place recognition: precision and recall of your own matches, and the protocols of docs/reference/EVALUATION.md."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revisit._core.evaluation import (
    ListedPairs, Match, MatchLabel, PairResult, PrIntervals, Protocol, PrSummary, Task, Trajectory, blocks_of, bootstrap,
    evaluate_pairs, label_matches, make_tasks, make_trajectory, precision_recall, protocols, read_pairs, retrieve, summarize)

__all__ = [
    'Evaluation', 'ListedPairs', 'Match', 'MatchLabel', 'PairResult', 'PrIntervals', 'PrSummary', 'Protocol', 'Task', 'Trajectory',
    'blocks_of', 'bootstrap', 'evaluate', 'evaluate_pairs', 'label_matches', 'labels', 'make_tasks', 'make_trajectory',
    'precision_recall', 'protocols', 'read_pairs', 'retrieve', 'summarize']


def labels(scores: ArrayLike, correct: ArrayLike, positive: ArrayLike | None = None,
           ignored: ArrayLike | None = None) -> list[MatchLabel]:
    """Labels of your own matches, one per query, for precision_recall(), summarize() and bootstrap().

    scores: float64 [queries]. The others are bool [queries].
    correct: the best match of the query is correct.
    positive: the query has a correct match in the database; None: equal to `correct`.
    ignored: the best match counts as neither; None: never.
    Raises ValueError for another shape, TypeError for other types and masked arrays.
    """
    if any(isinstance(given, np.ma.MaskedArray) for given in (scores, correct, positive, ignored)):
        raise TypeError('labels: expected arrays without mask, found a masked array; remove the masked queries or mark them ignored')
    columns = [np.asarray(scores, np.float64), np.asarray(correct)]
    columns.append(columns[1] if positive is None else np.asarray(positive))
    columns.append(np.zeros(len(columns[1]), bool) if ignored is None else np.asarray(ignored))
    for name, column in zip(('scores', 'correct', 'positive', 'ignored'), columns):
        if column.shape != columns[0].shape or column.ndim != 1:
            raise ValueError(f'{name}: expected shape {columns[0].shape}, one per query, found {column.shape}')
        if name != 'scores' and column.dtype != bool:
            raise TypeError(f'{name}: expected bool, found {column.dtype}')
    return [MatchLabel(*row) for row in zip(*(column.tolist() for column in columns))]


@dataclass
class Evaluation:
    """Result of one task. intervals: None without resamples. curve: see precision_recall(). matches, labels: one per query."""

    task: Task
    summary: PrSummary
    intervals: PrIntervals | None
    curve: dict[str, NDArray[Any]]
    matches: list[Match]        # empty if the task decides on pairs
    labels: list[MatchLabel]


def evaluate(task: Task, trajectory: Trajectory, *, descriptors: NDArray[np.float32] | None = None, matches: list[Match] | None = None, k: int = 4,
             score: str | None = None, resamples: int = 1000, block: str | None = None, threads: int = 1) -> Evaluation:
    """Evaluates descriptors or your own matches on a task.

    descriptors: float32 [scans][dimensions], one row per scan of the trajectory, compared by cosine.
    matches: one per query, in the order of task.queries. Tasks that decide on pairs take descriptors only.
    k, score: see retrieve().
    resamples: number of bootstrap resamples; 0: no intervals.
    block: length of bootstrap blocks; see blocks_of().
    Raises ValueError unless exactly one of both is given, and what retrieve(), label_matches() and blocks_of() raise.
    """
    if (descriptors is None) == (matches is None):
        raise ValueError('evaluate: expected exactly one of descriptors and matches')
    if task.decides_on_pairs:
        if descriptors is None:
            raise ValueError(f'evaluate: {task.name} decides on pairs of scans; give descriptors')
        pairs = evaluate_pairs(descriptors, task, trajectory, resamples=resamples, block=block, threads=threads)
        return Evaluation(task, pairs.summary, pairs.intervals, pairs.curve, [], [])
    if matches is None:
        matches = retrieve(descriptors, task, k=k, score=score, threads=threads)
    found = label_matches(matches, task, trajectory)
    intervals = None
    if resamples:
        intervals = bootstrap(found, task.missed, blocks=blocks_of(task, trajectory, block), resamples=resamples, threads=threads)
    return Evaluation(task, summarize(found, task.missed), intervals, precision_recall(found, task.missed), matches, found)
