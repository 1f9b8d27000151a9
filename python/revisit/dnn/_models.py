"""Nets with their preparation of images, as the classes of cv2.dnn."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import UnsupportedError, UsageError
from ._images import blobFromImage, scalar
from ._net import Net, readNet


def _setter(name):
    def set_value(self, *value, **named):
        """Sets an argument of blobFromImage(), or calls the function of Net; returns the model."""
        value, = (*value, *named.values())
        getattr(self._net, name)(value) if hasattr(Net, name) else setattr(self, name, value)
        return self

    return set_value


class Model:
    """A net and how images become its input. Model(net), or Model(model, config) with paths."""

    def __init__(self, network: Any = None, config: Any = '', *, model: Any = ''):
        self._net = network if isinstance(network, Net) else readNet(model if network is None else network, config)
        shape = self._net._shape()
        self.setInputParams(size=shape[:1:-1] if len(shape) == 4 else (0, 0))
        self._outputs = self._net.getUnconnectedOutLayersNames()

    def setInputParams(self, scale: ArrayLike = 1.0, size: Sequence[int] = (0, 0), mean: ArrayLike = (), swapRB: bool = False,
                       crop: bool = False) -> None:
        """Sets the arguments of blobFromImage()."""
        self._scale, self._size = scale, (0, 0) if size is None else tuple(size)
        self._mean, self._swap, self._crop = mean, swapRB, crop

    def setInputSize(self, *size: Any) -> 'Model':
        """Sets (width, height), also as two arguments."""
        self._size = tuple(size[0] if len(size) == 1 else size)
        return self

    setInputScale, setInputMean, setInputSwapRB, setInputCrop = map(_setter, ('_scale', '_mean', '_swap', '_crop'))

    def setOutputNames(self, outNames: Sequence[str]) -> 'Model':
        """Sets the layers that predict() returns; before: those of which no layer reads an output."""
        self._outputs = tuple(outNames)
        return self

    setPreferableBackend, setPreferableTarget, enableWinograd = map(
        _setter, ('setPreferableBackend', 'setPreferableTarget', 'enableWinograd'))

    def predict(self, frame: ArrayLike, outs: Any = None) -> tuple[NDArray[np.float32], ...]:
        """Returns the outputs for an image, as a tuple."""
        if min(self._size) < 1:
            raise UsageError('Model: the prototxt has no size of images; call setInputSize((width, height))')
        blob = blobFromImage(frame, 1.0, self._size, self._mean, self._swap, self._crop)
        factors = scalar(1.0 if self._scale is None else self._scale)
        if factors[1:].any():
            blob *= factors[: blob.shape[1]].astype(np.float32)[None, :, None, None]
        elif factors[0] != 1:
            blob *= np.float32(factors[0])
        self._net.setInput(blob)
        if self._reads_size():  # Faster R-CNN
            self._net.setInput(np.array([[self._size[1], self._size[0], 1.6]], np.float32), 'im_info')
        return self._net.forward(self._outputs)

    def _reads_size(self):
        return 'im_info' in self._net._inputs

    def _only_output(self, frame):
        outputs = self.predict(frame)
        if len(outputs) != 1:
            raise UsageError(f'expected a net with one output, found {len(outputs)}: {", ".join(self._outputs)}')
        return outputs[0]


class ClassificationModel(Model):
    """Model that classifies images."""

    _softmax = False
    setEnableSoftmaxPostProcessing = _setter('_softmax')

    def getEnableSoftmaxPostProcessing(self) -> bool:
        """Returns whether classify() computes a softmax of the output, for nets that end without one."""
        return bool(self._softmax)

    def classify(self, frame: ArrayLike) -> tuple[int, float]:
        """Returns the best class and its value."""
        values = self._only_output(frame).ravel()
        if self._softmax:
            values = np.exp(values - values.max())
            values /= values.sum()
        return int(values.argmax()), float(values.max())


class DetectionModel(Model):
    """Model whose net ends with a DetectionOutput: SSD, Faster R-CNN. setNmsAcrossClasses() does nothing, as in cv2.dnn for such nets."""

    _across = False
    setNmsAcrossClasses = _setter('_across')

    def getNmsAcrossClasses(self) -> bool:
        """Returns what setNmsAcrossClasses() has set."""
        return bool(self._across)

    def detect(self, frame: ArrayLike, confThreshold: float = 0.5, nmsThreshold: float = 0.0) -> tuple[Any, Any, Any]:
        """Returns classes, confidences, and boxes (left, top, width, height) [pixels]; () if there is none."""
        last = self._net.getLayer(self._net.getLayerNames()[-1])
        if last.type != 'DetectionOutput':
            raise UnsupportedError(f'detect: expected a net that ends with a DetectionOutput, found {last.type}; use predict()')
        image = np.asarray(frame)
        rows = np.concatenate([output.reshape(-1, 7) for output in self.predict(image)])
        rows = rows[rows[:, 2] >= np.float32(confThreshold)]
        if not len(rows):
            return (), (), ()
        size = np.array(self._size if self._reads_size() else image.shape[1::-1], np.int32)
        corners = rows[:, 3:].astype(np.int32)
        small = (corners[:, 2:] - corners[:, :2] + 1 <= 2).any(axis=1)  # fractions of the image
        scaled = (rows[:, 3:] * np.tile(size, 2).astype(np.float32)).astype(np.int32)
        corners[small] = scaled[small]
        sides = corners[:, 2:] - corners[:, :2] + 1
        low = corners[:, :2].clip(0, size - 1)
        return rows[:, 1].astype(np.int32), rows[:, 2].copy(), np.hstack([low, sides.clip(1, size - low)]).astype(np.int32)


class SegmentationModel(Model):
    """Model with a value of each class for each pixel."""

    def segment(self, frame: ArrayLike, mask: Any = None) -> NDArray[np.uint8]:
        """Returns the class of the greatest value of each pixel of the output, uint8."""
        return self._only_output(frame)[0].argmax(axis=0).astype(np.uint8)


class KeypointsModel(Model):
    """Model with a map for each point, the last for the background, or with the points."""

    def estimate(self, frame: ArrayLike, thresh: float = 0.5) -> NDArray[np.float32]:
        """Returns (x, y) of each point [pixels of the frame], float32; (-1, -1) where no value is beyond `thresh`."""
        output = self._only_output(frame)
        if output.ndim != 4:
            return output[0].reshape(-1, 2)
        maps = output[0, :-1]
        flat = maps.reshape(len(maps), -1)
        rows, columns = np.unravel_index(flat.argmax(axis=1), maps.shape[1:])
        height, width = np.shape(frame)[:2]
        points = np.stack([columns * np.float32(width / maps.shape[2]), rows * np.float32(height / maps.shape[1])], axis=1)
        points[flat.max(axis=1) <= thresh] = -1
        return points.astype(np.float32)
