"""caffe.Classifier: classification of images."""

import numpy as np

from . import io
from ._net import Net
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
