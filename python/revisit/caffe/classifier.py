"""caffe.Classifier and caffe.Detector: classification of images and of their windows."""

import numpy as np

from . import io
from ._caffe import Net
from .proto.caffe_pb2 import TEST


def transformer_for(net, mean, input_scale, raw_scale, channel_swap):
    """Returns a Transformer of images [h][w][c] for the first input of a net."""
    name = net.inputs[0]
    transformer = io.Transformer({name: net.blobs[name].data.shape})
    transformer.set_transpose(name, (2, 0, 1))
    for set_value, value in ((transformer.set_mean, mean), (transformer.set_input_scale, input_scale),
                             (transformer.set_raw_scale, raw_scale), (transformer.set_channel_swap, channel_swap)):
        if value is not None:
            set_value(name, value)
    return transformer


class Classifier(Net):
    """A net that classifies images.

    Args:
        model_file, pretrained_file: prototxt and weights.
        image_dims: (h, w) of images before cropping; None: the net's input size.
        mean, input_scale, raw_scale, channel_swap: see io.Transformer.
    """

    def __init__(self, model_file, pretrained_file, image_dims=None, mean=None, input_scale=None, raw_scale=None,
                 channel_swap=None):
        super().__init__(model_file, TEST, weights=pretrained_file)
        self.transformer = transformer_for(self, mean, input_scale, raw_scale, channel_swap)
        self.crop_dims = np.array(self.blobs[self.inputs[0]].data.shape[2:])
        self.image_dims = self.crop_dims if image_dims is None or not len(image_dims) else image_dims

    def predict(self, inputs, oversample=True):
        """Returns the net's output for every image, [n][classes].

        Args:
            inputs: images [h][w][c].
            oversample: average over ten crops (io.oversample) instead of using the center crop.
        """
        images = np.array([io.resize_image(image, self.image_dims) for image in inputs])
        if oversample:
            images = io.oversample(images, self.crop_dims)
        else:
            middle = np.array(self.image_dims) / 2
            (top, left), (bottom, right) = ((middle + sign * self.crop_dims / 2).astype(int) for sign in (-1, 1))
            images = images[:, top:bottom, left:right]
        name = self.inputs[0]
        batch = np.array([self.transformer.preprocess(name, image) for image in images], np.float32)
        predictions = self.forward_all(**{name: batch})[self.outputs[0]]
        if oversample:
            predictions = predictions.reshape(len(predictions) // 10, 10, -1).mean(1)
        return predictions


class Detector(Net):
    """A net that classifies windows of images, as in R-CNN.

    Args:
        model_file, pretrained_file: prototxt and weights.
        mean, input_scale, raw_scale, channel_swap: see io.Transformer.
        context_pad: border of context around the window, in pixels of the net's input.
    """

    def __init__(self, model_file, pretrained_file, mean=None, input_scale=None, raw_scale=None, channel_swap=None,
                 context_pad=None):
        super().__init__(model_file, TEST, weights=pretrained_file)
        self.transformer = transformer_for(self, mean, input_scale, raw_scale, channel_swap)
        self.configure_crop(context_pad)

    def detect_windows(self, images_windows):
        """Classifies windows.

        Args:
            images_windows: pairs of an image file and its windows (ymin, xmin, ymax, xmax) [pixels].
        Returns:
            One dict per window: `window`, `prediction` (the net's output) and `filename`.
        """
        found = []
        name = self.inputs[0]
        batch = []
        for filename, windows in images_windows:
            image = io.load_image(filename)
            for window in windows:
                batch.append(self.transformer.preprocess(name, self.crop(image, np.asarray(window))))
                found.append({'window': window, 'filename': filename})
        if not found:
            return found
        predictions = self.forward_all(**{name: np.array(batch, np.float32)})[self.outputs[0]]
        for entry, prediction in zip(found, predictions):
            entry['prediction'] = prediction
        return found

    def crop(self, im, window):
        """Returns the pixels of a window; with context_pad, resized to the net's input with its context.

        Pixels outside the image have the mean value.
        """
        ymin, xmin, ymax, xmax = (int(edge) for edge in window)
        if not self.context_pad:
            return im[ymin:ymax, xmin:xmax]
        size = self.blobs[self.inputs[0]].width  # the input is square
        scale = size / (size - 2.0 * self.context_pad)
        half = np.array([ymax - ymin + 1, xmax - xmin + 1]) / 2
        middle = np.array([ymin, xmin]) + half
        begin, end = np.round(middle - scale * half), np.round(middle + scale * half)
        zoom = size / (end - begin + 1)
        pad = np.round(np.maximum(0, -begin) * zoom).astype(int)
        begin, end = np.clip(begin, 0, im.shape[:2]), np.clip(end, 0, im.shape[:2])
        inside = np.minimum(np.round((end - begin + 1) * zoom).astype(int), size - pad)
        (y, x), (bottom, right) = begin.astype(int), end.astype(int)
        crop = np.ones(self.crop_dims, np.float32) * self.crop_mean
        crop[pad[0] : pad[0] + inside[0], pad[1] : pad[1] + inside[1]] = io.resize_image(im[y:bottom, x:right], inside)
        return crop

    def configure_crop(self, context_pad):
        """Sets context_pad and the mean image for pixels outside images."""
        name = self.inputs[0]
        order = np.argsort(self.transformer.transpose[name])  # back to [h][w][c]
        self.crop_dims = np.array(self.blobs[name].data.shape[1:])[order]
        self.context_pad = context_pad
        self.crop_mean = np.zeros(self.crop_dims, np.float32)
        if not context_pad or name not in self.transformer.mean:
            return
        mean = np.array(self.transformer.mean[name], float).transpose(order)
        if name in self.transformer.channel_swap:
            mean = mean[:, :, np.argsort(self.transformer.channel_swap[name])]
        if self.transformer.raw_scale.get(name) is not None:
            mean = mean / self.transformer.raw_scale[name]
        self.crop_mean = mean
