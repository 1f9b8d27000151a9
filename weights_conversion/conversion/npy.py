"""Arrays in npy files."""

import numpy as np

from .errors import InputError
from .files import existing


def read_npy(path):
    """A float32 array of an npy file of numbers."""
    try:
        array = np.load(existing(path), allow_pickle=False)
    except InputError:
        raise
    except Exception as error:  # NumPy parses the header as Python, which can fail in many ways
        raise InputError(f'{path}: not a readable npy file: {" ".join(str(error).split())[:200]}') from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in 'fiu':
        raise InputError(f'{path}: not a readable npy file: holds {getattr(array, "dtype", "several arrays")}, expected numbers')
    return array.astype(np.float32)
