"""caffe.io: conversion of images and messages to arrays, and preprocessing.

Images are float32 arrays [h][w][c], usually in [0, 1], with channels in RGB order.
"""

import numpy as np

from .proto import caffe_pb2


def blobproto_to_array(blob, return_diff=False):
    """Returns the values or gradients of a BlobProto in its shape, which may be given as num, channels, height, width."""
    values = np.array(blob.diff if return_diff else blob.data)
    if any(blob.HasField(name) for name in ('num', 'channels', 'height', 'width')):
        return values.reshape(blob.num, blob.channels, blob.height, blob.width)
    return values.reshape(tuple(blob.shape.dim))


def array_to_blobproto(arr, diff=None):
    """Converts an array of any shape, and gradients of the same shape, to a BlobProto."""
    blob, arr = caffe_pb2.BlobProto(), np.asarray(arr, float)
    blob.shape.dim.extend(arr.shape)
    blob.data.extend(arr.ravel())
    if diff is not None:
        blob.diff.extend(np.asarray(diff, float).ravel())
    return blob


def arraylist_to_blobprotovector_str(arraylist):
    """Serializes arrays as a BlobProtoVector."""
    return caffe_pb2.BlobProtoVector(blobs=map(array_to_blobproto, arraylist)).SerializeToString()


def blobprotovector_str_to_arraylist(str):
    """Parses the arrays of a serialized BlobProtoVector."""
    return [blobproto_to_array(blob) for blob in caffe_pb2.BlobProtoVector.FromString(str).blobs]


def array_to_datum(arr, label=None):
    """Converts an array [c][h][w] to a Datum, with bytes for uint8, else floats."""
    arr = np.asarray(arr)
    if arr.ndim != 3:
        raise ValueError(f'array_to_datum: expected an array of 3 axes (channels, height, width), found shape {arr.shape}')
    datum = caffe_pb2.Datum(channels=arr.shape[0], height=arr.shape[1], width=arr.shape[2])
    if arr.dtype == np.uint8:
        datum.data = arr.tobytes()
    else:
        datum.float_data.extend(arr.astype(float).flat)
    if label is not None:
        datum.label = label
    return datum


def datum_to_array(datum):
    """Returns the array [c][h][w] of a Datum: uint8 for bytes, else float64. The label is datum.label."""
    if datum.encoded:
        raise ValueError('datum_to_array: the Datum has an encoded image; decode datum.data with an image library')
    if datum.data:
        values = np.frombuffer(datum.data, np.uint8).copy()
    else:
        values = np.array(datum.float_data, float)
    return values.reshape(datum.channels, datum.height, datum.width)


def load_image(filename, color=True):
    """Reads an image file as float32 in [0, 1]: [h][w][3] in RGB, or [h][w][1] with color=False. Needs the package pillow.

    Drops transparency, as pycaffe does.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError('load_image() needs the package pillow: pip install pillow') from error
    with Image.open(filename) as file:
        pixels = _pixels(file)
    values = pixels.astype(np.float32) / np.float32(65535 if pixels.dtype == np.uint16 else 255)
    if values.ndim == 2:
        return np.repeat(values[:, :, np.newaxis], 3 if color else 1, axis=2)
    if color:
        return values
    return (values @ np.float32([0.2125, 0.7154, 0.0721]))[:, :, np.newaxis]  # ITU-R BT.709 luminance


def _pixels(image):
    """Returns uint8 or uint16, [h][w] for grayscale or [h][w][3]."""
    if image.mode.startswith('I'):
        return np.asarray(image).astype(np.uint16)
    if image.mode in ('1', 'L', 'LA'):
        return np.asarray(image.convert('L'))
    if image.mode == 'RGBA':
        return np.asarray(image)[:, :, :3]
    return np.asarray(image.convert('RGB'))


def _line_weights(n_in, n_out):
    """Returns two indices and two weights per pixel of a resized line; weights are 0 outside the line.

    Pixels are areas: the center of pixel i is at i + 0.5.
    """
    place = (np.arange(n_out) + 0.5) * (n_in / n_out) - 0.5
    low = np.floor(place).astype(int)
    fraction = place - low
    inside = lambda index: (index >= 0) & (index < n_in)
    return (
        np.clip(low, 0, n_in - 1),
        np.clip(low + 1, 0, n_in - 1),
        (1 - fraction) * inside(low),
        fraction * inside(low + 1),
    )


def _corner_weights(n_in, n_out):
    """Like _line_weights(), with fixed first and last pixels."""
    place = np.arange(n_out) * ((n_in - 1) / (n_out - 1) if n_out > 1 else 0)
    low = np.minimum(place.astype(int), max(n_in - 2, 0))
    fraction = place - low
    return low, np.minimum(low + 1, n_in - 1), 1 - fraction, fraction


def _resampled(image, size, weights):
    rows, columns = weights(image.shape[0], size[0]), weights(image.shape[1], size[1])
    low, high, a, b = columns
    image = image[:, low] * a[:, np.newaxis] + image[:, high] * b[:, np.newaxis]
    low, high, a, b = rows
    return image[low] * a[:, np.newaxis, np.newaxis] + image[high] * b[:, np.newaxis, np.newaxis]


def _nearest_corner(image, size):
    """Nearest-neighbor version of _corner_weights(); ties go to the second pixel."""
    rows, columns = (
        np.floor(np.arange(n_out) * ((n_in - 1) / (n_out - 1) if n_out > 1 else 0) + 0.5).astype(int)
        for n_in, n_out in zip(image.shape, size)
    )
    return image[rows][:, columns]


def _nearest(image, size):
    rows, columns = (
        np.clip(np.rint((np.arange(n_out) + 0.5) * (n_in / n_out) - 0.5).astype(int), 0, n_in - 1)
        for n_in, n_out in zip(image.shape, size)
    )
    return image[rows][:, columns]


def _by_splines(image, size, order, **mode):
    try:
        from scipy.ndimage import zoom
    except ImportError as error:
        raise ImportError(
            f'resize_image() with interp_order={order} needs the package scipy: pip install scipy (orders 0 and 1 do not)'
        ) from error
    scale = (size[0] / image.shape[0], size[1] / image.shape[1], 1)
    return zoom(image, scale, order=order, **mode)


def _with_corners(image, size, order):
    if order == 0:
        return _nearest_corner(image, size)
    if order == 1:
        return _resampled(image, size, _corner_weights)
    return _by_splines(image, size, order)


def resize_image(im, new_dims, interp_order=1):
    """Resizes an image [h][w][c] to new_dims = (h, w), float32, without antialiasing.

    With 1 or 3 channels, pixels are areas and the image is padded with its minimum, which darkens the edges of an enlarged
    image. With other numbers of channels, corner pixels stay at the corners. Both match pycaffe with the scikit-image of
    its time.
    """
    im = np.asarray(im)
    size = (int(new_dims[0]), int(new_dims[1]))
    if im.ndim != 3 or 0 in im.shape or min(size) < 1:
        raise ValueError(f'resize_image: expected an image of 3 axes and a size of at least 1 x 1, found {im.shape} and {size}')
    if im.shape[2] not in (1, 3):
        return _with_corners(im.astype(float), size, interp_order).astype(np.float32)
    low, high = float(im.min()), float(im.max())
    if high <= low:
        return np.full((*size, im.shape[2]), low, np.float32)
    image = (im.astype(float) - low) / (high - low)
    if interp_order == 0:
        image = _nearest(image, size)
    elif interp_order == 1:
        image = _resampled(image, size, _line_weights)
    else:
        image = _by_splines(image, size, interp_order, mode='grid-constant', grid_mode=True)
        image = np.clip(image, 0, 1)
    return (image * (high - low) + low).astype(np.float32)


def oversample(images, crop_dims):
    """Returns ten crops per image [h][w][c]: four corners and center, and their mirror images; [10 n][h][w][c].

    Args:
        images: must have one size.
        crop_dims: (h, w) of the crops.
    """
    crop_h, crop_w = (int(size) for size in crop_dims)
    h, w = images[0].shape[:2]
    if crop_h > h or crop_w > w:
        raise ValueError(f'oversample: expected crops of at most {h} x {w} (the image), found {crop_h} x {crop_w}')
    begins = [(y, x) for y in (0, h - crop_h) for x in (0, w - crop_w)]
    begins.append((int(h / 2 - crop_h / 2), int(w / 2 - crop_w / 2)))
    crops = []
    for image in images:
        upright = [image[y : y + crop_h, x : x + crop_w] for y, x in begins]
        crops += upright + [crop[:, ::-1] for crop in upright]
    return np.array(crops, np.float32)


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
