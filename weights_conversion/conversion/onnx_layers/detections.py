"""Layers that decode boxes and suppress those that overlap better ones, with NonMaxSuppression and TopK.

Rows of an output: image, class, score, xmin, ymin, xmax, ymax.
"""

import numpy as np
from revisit.caffe.proto.caffe_pb2 import PriorBoxParameter

ALL = 2**31 - 1  # NonMaxSuppression's limit of boxes
EMPTY = np.float32(-np.inf)  # score of a box that was suppressed


def _below(limit):
    """Returns the float before `limit`: ONNX keeps what is above a limit, YOLO also what is equal to it."""
    return np.nextafter(np.float32(limit), EMPTY)


def _overlap_limit(site, limit):
    if not 0 <= limit <= 1:
        site.refuse(f'nms_threshold: expected 0 to 1, found {limit:g}; ONNX Runtime takes no other')
    return limit


def _columns(g, x, first, last):
    return g.node('Slice', x, g.integers(first), g.integers(last), g.integers(-1))


def _decoded(g, p, targets, priors):
    """Returns corners of boxes. targets: [images][priors][classes or 1][4]. priors: [2][priors][4]: boxes, variances."""
    part = [g.reshape(g.node('Gather', priors, g.integers(i), axis=0), -1, 1, 4) for i in range(2)]
    if not p.variance_encoded_in_target:
        targets = g.node('Mul', targets, part[1])
    first, last = (_columns(g, part[0], *ends) for ends in ((0, 2), (2, 4)))
    size = g.node('Sub', last, first)
    if p.code_type == PriorBoxParameter.CORNER_SIZE:
        targets = g.node('Mul', targets, g.node('Concat', size, size, axis=-1))
    if p.code_type != PriorBoxParameter.CENTER_SIZE:
        return g.node('Add', part[0], targets)
    middle = g.affine(g.node('Add', first, last), 0.5)
    center = g.node('Add', g.node('Mul', _columns(g, targets, 0, 2), size), middle)
    return _corners(g, center, g.node('Mul', g.node('Exp', _columns(g, targets, 2, 4)), size))


def _corners(g, center, size):
    half = g.affine(size, 0.5)
    return g.node('Concat', g.node('Sub', center, half), g.node('Add', center, half), axis=-1)


def _kept(g, boxes, scores, overlap, score, **form):
    """Returns n and m of the kept among boxes [n][m][4] with scores [n][1][m], by n, then best first."""
    chosen = g.node('NonMaxSuppression', boxes, scores, g.integers(ALL), g.constant([overlap]), g.constant([score]), **form)
    group, place = (g.reshape(_columns(g, chosen, i, i + 1), -1) for i in (0, 2))
    return group, place


def _best_of_images(g, scores, kept, images, per_image, most):
    """Returns the `most` best of each image among `kept` indices of scores [images * per_image], in the order of indices."""
    nothing = g.constant(np.full(images * per_image, EMPTY))
    marked = g.node('ScatterND', nothing, g.reshape(kept, -1, 1), g.node('Gather', scores, kept))
    _, best = g.node('TopK', g.reshape(marked, images, per_image), g.integers(most), axis=1, n_outputs=2)
    ordered, _ = g.node('TopK', best, g.integers(most), axis=1, largest=0, n_outputs=2)
    first = g.constant(np.arange(images).reshape(-1, 1) * per_image, np.int64)
    flat = g.reshape(g.node('Add', ordered, first), -1)
    return g.node('Compress', flat, g.node('Greater', g.node('Gather', marked, flat), g.constant(EMPTY)), axis=0)


def _rows(g, columns, boxes, images):
    """Returns rows of `columns` [n] and boxes [n][4]; without any, a row of -1 behind its index for each image."""
    rows = g.node('Concat', *(g.reshape(column, -1, 1) for column in columns), boxes, axis=1)
    none = np.full((images, 7), -1, np.float32)
    none[:, 0] = range(images)
    n_none = g.node('Mul', g.to_integers(g.node('Equal', g.shape(rows, 0, 1), g.integers(0))), g.integers(images))
    shown = g.node('Slice', g.constant(none), g.integers(0), n_none, g.integers(0))
    return [g.reshape(g.node('Concat', rows, shown, axis=0), 1, 1, -1, 7)]


def _detection_output(g, site):
    """Every class of every image becomes an item of the batch, because only the best `top_k` of a class take part."""
    site.require_fixed('boxes depend on')
    p = site.message.detection_output_param
    nms = p.nms_param
    if len(site.x) != 3:
        site.refuse(f'expected 3 inputs, found {len(site.x)}')
    if nms.eta < 1 and nms.nms_threshold > 0.5:
        site.refuse('eta below 1 changes the threshold after each box, which ONNX cannot')
    overlap = _overlap_limit(site, nms.nms_threshold)
    images, priors, classes = site.shapes[0][0], site.shapes[2][2] // 4, p.num_classes
    labels = [label for label in range(classes) if label != p.background_label_id]
    n, k = len(labels), min(nms.top_k, priors) if nms.HasField('top_k') and nms.top_k >= 0 else priors
    if not n or not k:
        site.refuse('no class or no box can be detected')
    boxes = _decoded(g, p, g.reshape(site.x[0], images, priors, -1, 4), g.reshape(site.x[2], 2, priors, 4))
    if p.clip:
        boxes = g.node('Min', g.node('Max', boxes, g.constant([0])), g.constant([1]))
    boxes = g.node('Transpose', boxes, perm=[0, 2, 1, 3])
    scores = g.node('Transpose', g.reshape(site.x[1], images, priors, classes), perm=[0, 2, 1])
    if n < classes:
        scores = g.node('Gather', scores, g.integers(*labels), axis=1)
    scores, places = g.node('TopK', scores, g.integers(k), axis=2, n_outputs=2)
    if p.share_location:
        boxes = g.node('GatherND', g.reshape(boxes, images, priors, 4), g.reshape(places, images, n * k, 1), batch_dims=1)
    else:
        boxes = g.node('Gather', boxes, g.integers(*labels), axis=1) if n < classes else boxes
        boxes = g.node('GatherND', boxes, g.reshape(places, images, n, k, 1), batch_dims=2)
    limit = p.confidence_threshold if p.HasField('confidence_threshold') else np.finfo(np.float32).min
    group, place = _kept(g, g.reshape(boxes, images * n, k, 4), g.reshape(scores, images * n, 1, k), overlap, limit)
    kept = g.node('Add', g.node('Mul', group, g.integers(k)), place)
    flat = g.reshape(scores, -1)
    if 0 <= p.keep_top_k < n * k:
        kept = _best_of_images(g, flat, kept, images, n * k, p.keep_top_k)
    group = g.node('Div', kept, g.integers(k))
    image = g.to_float(g.node('Div', group, g.integers(n)))
    label = g.node('Gather', g.constant(labels), g.node('Mod', group, g.integers(n)))
    corners = g.node('Gather', g.reshape(boxes, -1, 4), kept)
    return _rows(g, (image, label, g.node('Gather', flat, kept)), corners, images)


def _yolo_map(g, x, shape, anchors, image, classes):
    """Returns boxes [n][4] (center, size), objectness [n][1] and class numbers [n][classes] of a map of `shape`.

    anchors: [anchor][2], in the unit of `image`, the height and width of the image.
    """
    rows, columns, n = *shape[2:], len(anchors)
    numbers = g.node('Transpose', g.reshape(x, n, 5 + classes, rows * columns), perm=[2, 0, 1])
    cells = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 1, 2)
    center = g.node('Div', g.node('Add', g.node('Sigmoid', _columns(g, numbers, 0, 2)), g.constant(cells)), g.constant([columns, rows]))
    scale = np.asarray(anchors, np.float32) / np.float32(image[::-1])
    size = g.node('Mul', g.node('Exp', _columns(g, numbers, 2, 4)), g.constant(scale))
    boxes = g.reshape(g.node('Concat', center, size, axis=-1), -1, 4)
    return boxes, *(g.reshape(_columns(g, numbers, *ends), -1, ends[1] - ends[0]) for ends in ((4, 5), (5, 5 + classes)))


def _yolo(g, site, p, anchors, images, score, limit):
    """Boxes suppress those of other classes, too. Only the best class of a box matters, because it suppresses the others."""
    site.require_fixed('boxes depend on')
    overlap = _overlap_limit(site, _below(p.nms_threshold))
    parts = [_yolo_map(g, *each, p.num_classes) for each in zip(site.x, site.shapes, anchors, images)]
    boxes, objects, classes = (part[0] if len(part) == 1 else g.node('Concat', *part, axis=0) for part in zip(*parts))
    values, label = g.node('TopK', g.node('Mul', g.node('Sigmoid', objects), score(classes)), g.integers(1), axis=1, n_outputs=2)
    values = g.reshape(values, -1)
    _, kept = _kept(g, g.reshape(boxes, 1, -1, 4), g.reshape(values, 1, 1, -1), overlap, limit, center_point_box=1)
    box, scores = g.node('Gather', boxes, kept), g.node('Gather', values, kept)
    corners = _corners(g, _columns(g, box, 0, 2), _columns(g, box, 2, 4))
    label = g.affine(g.to_float(g.node('Gather', g.reshape(label, -1), kept)), shift=1.0)
    return _rows(g, (g.affine(scores, 0.0), label, scores), corners, 1)


def _yolo_v2(g, site):
    p = site.message.yolo_detection_output_param
    anchors = np.reshape(p.biases[:2 * p.num_box], (-1, 2))
    return _yolo(g, site, p, [anchors] * len(site.x), [shape[2:] for shape in site.shapes],
                 lambda classes: g.node('Softmax', classes, axis=1), _below(p.confidence_threshold))


def _yolo_v3(g, site):
    p = site.message.yolov3_detection_output_param
    anchors = [[p.biases[2 * i:2 * i + 2] for i in p.mask[j * p.num_box:(j + 1) * p.num_box]] for j in range(len(site.x))]
    images = [np.multiply(shape[2:], scale) for shape, scale in zip(site.shapes, p.anchors_scale)]
    return _yolo(g, site, p, anchors, images, lambda classes: g.node('Sigmoid', classes), p.confidence_threshold)


EMIT = {'DetectionOutput': _detection_output, 'YoloDetectionOutput': _yolo_v2, 'Yolov3DetectionOutput': _yolo_v3}
