"""Images to blobs and back, with the values that OpenCV computes."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import UsageError

CV_8U, CV_32F = 0, 5  # OpenCV's numbers of types


def _taps(n_to, step, n_from):
    """Returns the indices of the two pixels that each output pixel interpolates, and the weight of the second, float32."""
    at = ((np.arange(n_to) + 0.5) * step - 0.5).astype(np.float32)
    first = np.floor(at).astype(np.int64)
    return first.clip(0, n_from - 1), (first + 1).clip(0, n_from - 1), at - first.astype(np.float32)


def _halved(image):
    """Returns the means of blocks of 2 x 2 pixels, which OpenCV computes for half the size."""
    parts = image if image.dtype != np.uint8 else image.astype(np.int32)
    total = parts[::2, ::2] + parts[::2, 1::2] + parts[1::2, ::2] + parts[1::2, 1::2]
    return ((total + 2) >> 2).astype(np.uint8) if image.dtype == np.uint8 else total * np.float32(0.25)


def resize(image, size, step=None):
    """Returns the image [height][width][channels], of 8 or 16 bits or float32, in another size (width, height), interpolated linearly.

    step: distance of two output pixels in the input; None: as the sizes are. uint8 is computed in OpenCV's fixed-point numbers.
    """
    height, width = image.shape[:2]
    if (width, height) == tuple(size):
        return image
    if image.dtype not in (np.uint8, np.float32):
        return np.rint(resize(image.astype(np.float32), size, step))
    steps = (step, step) if step else (1 / (size[0] / width), 1 / (size[1] / height))
    if steps == (2, 2) and (width, height) == (2 * size[0], 2 * size[1]):
        return _halved(image)
    left, right, x = _taps(size[0], steps[0], width)
    x[left == right] = 0  # only in this axis
    upper, lower, y = _taps(size[1], steps[1], height)
    rows, where = np.unique(np.concatenate([upper, lower]), return_inverse=True)
    used = image[rows]
    if image.dtype != np.uint8:
        x, y = x[None, :, None], y[:, None, None]
        across = used[:, left] * (1 - x) + used[:, right] * x
        return across[where[: size[1]]] * (1 - y) + across[where[size[1]:]] * y
    fixed = [np.rint(weights * np.float32(2048)).astype(np.int32) for weights in (1 - x, x, 1 - y, y)]
    across = used[:, left] * fixed[0][None, :, None] + used[:, right] * fixed[1][None, :, None] >> 4
    above, below = (across[part] * weights[:, None, None] >> 16 for part, weights in
                    ((where[: size[1]], fixed[2]), (where[size[1]:], fixed[3])))
    return ((above + below + 2) >> 2).clip(0, 255).astype(np.uint8)


def _checked(image):
    image = np.asarray(image)
    if image.ndim not in (2, 3) or image.size == 0:
        raise UsageError(f'blobFromImage: expected an image [height][width] or [height][width][channels], found the shape '
                         f'{image.shape} (an empty image is a file that was not read)')
    if image.ndim == 2:
        image = image[:, :, None]
    return image if image.dtype in (np.uint8, np.uint16, np.int16) else image.astype(np.float32)


def _fitted(image, size, crop):
    """Returns the image in the size (width, height); `crop`: scaled alike in both axes, then cut about its center."""
    height, width = image.shape[:2]
    if not crop or (width, height) == size:
        return resize(image, size)
    factor = max(size[0] / width, size[1] / height)
    image = resize(image, (round(width * factor), round(height * factor)), 1 / factor)
    left, top = int(0.5 * (image.shape[1] - size[0])), int(0.5 * (image.shape[0] - size[1]))
    return image[top : top + size[1], left : left + size[0]]


def scalar(values):
    """Returns OpenCV's Scalar as four numbers: missing values are 0, as is the rest of a single number; None has none."""
    given = np.asarray(() if values is None else values, np.float64).ravel()
    if given.size > 4:
        raise UsageError(f'mean: expected up to 4 values, found {given.size}')
    return np.concatenate([given, np.zeros(4 - given.size)])


def blobFromImages(images: Iterable[ArrayLike], scalefactor: float = 1.0, size: Sequence[int] = (0, 0), mean: ArrayLike = (),
                   swapRB: bool = False, crop: bool = False, ddepth: int = CV_32F) -> NDArray[Any]:
    """Returns images as a blob [n][channels][height][width]: resized, (image - mean) * scalefactor. None stands for a default.

    Args:
        images: arrays [height][width] or [height][width][channels] of 1, 3 or 4 channels; all get one size.
        size: (width, height); (0, 0): that of the first image.
        mean: of the channels of the blob, thus R first with swapRB and BGR images.
        swapRB: exchanges the first and the third channel.
        crop: keeps the aspect ratio and cuts what exceeds the size, else the image is stretched.
        ddepth: CV_32F (5), or CV_8U (0) for a blob of uint8, which takes no mean and scalefactor.
    Raises UsageError for images of other shapes or a size below 1.
    """
    checked = [_checked(image) for image in images]
    if not checked:
        raise UsageError('blobFromImages: expected at least one image, found none')
    if ddepth not in (-1, CV_8U, CV_32F):
        raise UsageError(f'blobFromImage: expected ddepth {CV_32F} (float32) or {CV_8U} (uint8), found {ddepth}')
    size = (0, 0) if size is None else tuple(int(n) for n in size)
    if size == (0, 0):
        size = checked[0].shape[1::-1]
    if min(size) < 1:
        raise UsageError(f'blobFromImage: expected a size (width, height) of at least 1, found {size}')
    channels = {image.shape[2] for image in checked}
    if channels - {1, 3, 4} and np.any(mean) or len(channels) > 1:
        raise UsageError(f'blobFromImages: expected images of 1, 3 or 4 channels, as many in each, found {sorted(channels)}')
    stack = np.stack([_fitted(image, size, crop) for image in checked])
    if swapRB and stack.shape[3] > 2:
        stack = stack[..., [2, 1, 0, 3][: stack.shape[3]]]
    mean = scalar(mean)[: stack.shape[3]]
    if ddepth == CV_8U:
        if stack.dtype != np.uint8 or scalefactor not in (None, 1) or mean.any():
            raise UsageError('blobFromImage: a blob of uint8 needs images of uint8, without mean and scalefactor')
        return np.ascontiguousarray(stack.transpose(0, 3, 1, 2))
    blob = stack.transpose(0, 3, 1, 2).astype(np.float32, order='C')
    if mean.any():
        blob -= mean.astype(np.float32)[None, :, None, None]
    if scalefactor not in (None, 1):
        blob *= np.float32(scalefactor)
    return blob


def blobFromImage(image: ArrayLike, scalefactor: float = 1.0, size: Sequence[int] = (0, 0), mean: ArrayLike = (),
                  swapRB: bool = False, crop: bool = False, ddepth: int = CV_32F) -> NDArray[Any]:
    """Returns one image as a blob [1][channels][height][width]; see blobFromImages()."""
    return blobFromImages([image], scalefactor, size, mean, swapRB, crop, ddepth)


def imagesFromBlob(blob_: ArrayLike, images_: Any = None) -> tuple[NDArray[Any], ...]:
    """Returns the images [height][width][channels] of a blob [n][channels][height][width]; without the axis of one channel."""
    images = [np.ascontiguousarray(image.transpose(1, 2, 0)) for image in np.asarray(blob_)]
    return tuple(image[:, :, 0] if image.shape[2] == 1 else image for image in images)
