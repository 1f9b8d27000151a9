"""Suppression of overlapping boxes, with OpenCV's results."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import UsageError


def _checked(bboxes, scores):
    boxes = np.asarray(bboxes, np.float64).reshape(-1, 4)
    scores = np.asarray(scores, np.float32).ravel()
    if len(boxes) != len(scores):
        raise UsageError(f'NMSBoxes: expected a score for each box, found {len(boxes)} boxes and {len(scores)} scores')
    return boxes, scores


def _overlap(box, others):
    """Returns the intersection of a box (left, top, width, height) with others over their union, float32."""
    low = np.maximum(box[:2], others[:, :2])
    high = np.minimum(box[:2] + box[2:], others[:, :2] + others[:, 2:])
    common = np.prod(np.maximum(high - low, 0), axis=1)
    areas = box[2] * box[3] + others[:, 2] * others[:, 3]
    union = np.where(areas <= np.finfo(np.float64).eps, 1, areas - common)
    return np.where(areas <= np.finfo(np.float64).eps, 1, common / union).astype(np.float32)


def NMSBoxes(bboxes: ArrayLike, scores: ArrayLike, score_threshold: float, nms_threshold: float, eta: float = 1.0, top_k: int = 0) -> Any:
    """Returns the indices of boxes to keep, by descending score, int32; () if there is none.

    Args:
        bboxes: (left, top, width, height) of each.
        score_threshold: boxes need a greater score.
        nms_threshold: maximum overlap with a kept box; from there on multiplied by eta < 1 after each kept box.
        top_k: number of boxes of the greatest scores that are considered; 0: all.
    """
    boxes, scores = _checked(bboxes, scores)
    order = np.argsort(-scores, kind='stable')
    order = order[scores[order] > np.float32(score_threshold)]
    threshold, kept = np.float32(nms_threshold), []
    for index in order[:top_k] if top_k > 0 else order:
        if kept and (_overlap(boxes[index], boxes[kept]) > threshold).any():
            continue
        kept.append(int(index))
        if eta < 1 and threshold > 0.5:
            threshold *= np.float32(eta)
    return np.array(kept, np.int32) if kept else ()


def NMSBoxesBatched(bboxes: ArrayLike, scores: ArrayLike, class_ids: ArrayLike, score_threshold: float, nms_threshold: float,
                    eta: float = 1.0, top_k: int = 0) -> Any:
    """NMSBoxes() among the boxes of each class. class_ids: one per box."""
    boxes, scores = _checked(bboxes, scores)
    apart = max(0.0, (boxes[:, :2] + boxes[:, 2:]).max(initial=0), boxes[:, :2].max(initial=0)) + 1
    boxes[:, :2] += (np.asarray(class_ids).reshape(-1, 1) * apart)
    return NMSBoxes(boxes, scores, score_threshold, nms_threshold, eta, top_k)
