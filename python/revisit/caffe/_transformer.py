"""Preprocessing of images for nets."""

import numpy as np

from ._resizing import resize_image


class Transformer:
    """Converts images to inputs of a net.

    Args:
        inputs: input name -> shape (n, c, h, w).
    """

    def __init__(self, inputs):
        self.inputs = inputs
        self.transpose = {}
        self.channel_swap = {}
        self.raw_scale = {}
        self.mean = {}
        self.input_scale = {}

    def _check(self, in_):
        if in_ not in self.inputs:
            raise ValueError(f"Transformer: expected one of the inputs {sorted(self.inputs)}, found '{in_}'")

    def preprocess(self, in_, data):
        """Converts an image [h][w][c] of any size for the input `in_`, usually to [c][h][w]; returns a new float32 array.

        Steps: resize, transpose, swap channels, multiply by raw_scale, subtract the mean, multiply by input_scale.
        """
        self._check(in_)
        size = tuple(self.inputs[in_][2:])
        image = np.asarray(data).astype(np.float32)
        if image.shape[:2] != size:
            image = resize_image(image, size)
        if in_ in self.transpose:
            image = image.transpose(self.transpose[in_])
        if in_ in self.channel_swap:
            order = list(self.channel_swap[in_])
            if len(image) <= max(order, default=-1):
                raise ValueError(f"input '{in_}': expected an image with the channels {order}, found {len(image)} channels")
            image = image[order]
        if self.raw_scale.get(in_) is not None:
            image *= self.raw_scale[in_]
        if in_ in self.mean:
            image -= self.mean[in_]
        if self.input_scale.get(in_) is not None:
            image *= self.input_scale[in_]
        return image

    def deprocess(self, in_, data):
        """Inverse of preprocess() without resizing. Removes axes of size 1."""
        self._check(in_)
        image = np.array(data).squeeze()
        if self.input_scale.get(in_) is not None:
            image /= self.input_scale[in_]
        if in_ in self.mean:
            image += self.mean[in_]
        if self.raw_scale.get(in_) is not None:
            image /= self.raw_scale[in_]
        if in_ in self.channel_swap:
            image = image[np.argsort(self.channel_swap[in_])]
        if in_ in self.transpose:
            image = image.transpose(np.argsort(self.transpose[in_]))
        return image

    def set_transpose(self, in_, order):
        """Sets the order of axes: (2, 0, 1) converts [h][w][c] to [c][h][w]."""
        self._check(in_)
        n_axes = len(self.inputs[in_]) - 1
        if len(order) != n_axes:
            raise ValueError(f"set_transpose: expected an order of the {n_axes} axes of '{in_}', found {tuple(order)}")
        self.transpose[in_] = order

    def set_channel_swap(self, in_, order):
        """Sets the order of channels (first axis after transposing): (2, 1, 0) converts RGB to BGR."""
        self._check(in_)
        if len(order) != self.inputs[in_][1]:
            raise ValueError(
                f"set_channel_swap: expected an order of the {self.inputs[in_][1]} channels of '{in_}', found {tuple(order)}"
            )
        self.channel_swap[in_] = order

    def set_raw_scale(self, in_, scale):
        """Sets the factor before mean subtraction: 255 for a net trained on images of 0 to 255."""
        self._check(in_)
        self.raw_scale[in_] = scale

    def set_mean(self, in_, mean):
        """Sets the mean to subtract: one number per channel, or an image [c][h][w], which is resized if needed."""
        self._check(in_)
        channels, *size = self.inputs[in_][1:]
        mean = np.asarray(mean)
        if mean.ndim == 1:
            if len(mean) != channels:
                raise ValueError(f"set_mean: expected a mean of the {channels} channels of '{in_}', found {len(mean)}")
            mean = mean[:, np.newaxis, np.newaxis]
        elif mean.ndim not in (2, 3):
            raise ValueError(f'set_mean: expected 1 to 3 axes, found shape {mean.shape}')
        elif mean.shape[-2:] != tuple(size) or (mean.ndim == 3 and mean.shape[0] != channels):
            mean = self._resized_mean(mean[np.newaxis] if mean.ndim == 2 else mean, size)
        self.mean[in_] = mean

    @staticmethod
    def _resized_mean(mean, size):
        low, high = mean.min(), mean.max()
        scale = high - low if high > low else 1
        image = ((mean - low) / scale).transpose(1, 2, 0)
        return resize_image(image, tuple(size)).transpose(2, 0, 1) * scale + low

    def set_input_scale(self, in_, scale):
        """Sets the factor after mean subtraction."""
        self._check(in_)
        self.input_scale[in_] = scale
