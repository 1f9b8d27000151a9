"""What a net wants of an image."""

import numpy as np

from ._resizing import resize_image


class Transformer:
    """Makes what a net wants of an image.

    Args:
        inputs: the shapes of the net's inputs (n, c, h, w), by name.
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
            raise ValueError(f"'{in_}' is not one of the inputs {sorted(self.inputs)}")

    def preprocess(self, in_, data):
        """An image [h][w][c] of any size as the input `in_` wants it, mostly [c][h][w]; float32, a new array.

        In this order: resized, transposed, channels swapped, times raw_scale, minus the mean, times input_scale.
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
                raise ValueError(f"input '{in_}': the channels {order} of an image of {len(image)}")
            image = image[order]
        if self.raw_scale.get(in_) is not None:
            image *= self.raw_scale[in_]
        if in_ in self.mean:
            image -= self.mean[in_]
        if self.input_scale.get(in_) is not None:
            image *= self.input_scale[in_]
        return image

    def deprocess(self, in_, data):
        """preprocess() backwards, except for the size. Axes of size 1 go."""
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
        """The order of the axes: (2, 0, 1) makes [c][h][w] of [h][w][c]."""
        self._check(in_)
        n_axes = len(self.inputs[in_]) - 1
        if len(order) != n_axes:
            raise ValueError(f"expected an order of the {n_axes} axes of an image of '{in_}', found {tuple(order)}")
        self.transpose[in_] = order

    def set_channel_swap(self, in_, order):
        """The order of the channels, which are the first axis by then: (2, 1, 0) makes BGR of RGB."""
        self._check(in_)
        if len(order) != self.inputs[in_][1]:
            raise ValueError(
                f"expected an order of {self.inputs[in_][1]} channels of '{in_}', found {tuple(order)}"
            )
        self.channel_swap[in_] = order

    def set_raw_scale(self, in_, scale):
        """A factor before the mean is subtracted: 255 for a net trained on images of 0 to 255."""
        self._check(in_)
        self.raw_scale[in_] = scale

    def set_mean(self, in_, mean):
        """What is subtracted: a number for each channel, or an image [c][h][w], which is resized where needed."""
        self._check(in_)
        channels, *size = self.inputs[in_][1:]
        mean = np.asarray(mean)
        if mean.ndim == 1:
            if len(mean) != channels:
                raise ValueError(f"expected a mean of the {channels} channels of '{in_}', found {len(mean)}")
            mean = mean[:, np.newaxis, np.newaxis]
        elif mean.ndim not in (2, 3):
            raise ValueError(f'expected a mean of 1 to 3 axes, found the shape {mean.shape}')
        elif mean.shape[-2:] != tuple(size) or (mean.ndim == 3 and mean.shape[0] != channels):
            mean = self._resized_mean(mean[np.newaxis] if mean.ndim == 2 else mean, size)
        self.mean[in_] = mean

    @staticmethod
    def _resized_mean(mean, size):
        low, high = mean.min(), mean.max()
        spread = high - low if high > low else 1
        image = ((mean - low) / spread).transpose(1, 2, 0)
        return resize_image(image, tuple(size)).transpose(2, 0, 1) * spread + low

    def set_input_scale(self, in_, scale):
        """A factor after the mean was subtracted."""
        self._check(in_)
        self.input_scale[in_] = scale
