"""Reading of npy and npz files."""

import numpy as np

from .errors import InputError
from .files import existing


def read_npy(path):
    """Reads an npy file of numbers as float32."""
    try:
        array = np.load(existing(path), allow_pickle=False)
    except InputError:
        raise
    except Exception as error:  # NumPy parses the header as Python, which raises many types
        raise InputError(f'{path}: not a readable npy file: {" ".join(str(error).split())[:200]}') from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in 'fiu':
        raise InputError(f'{path}: expected an npy file of numbers, found {getattr(array, "dtype", "several arrays")}')
    return array.astype(np.float32)


FREE_BYTES, MAX_RATIO = 1 << 30, 100
"""Decompressed size that is always allowed, and allowed compression ratio beyond it. Zeros have a ratio of a thousand."""


def check_unpacked(path, size):
    """Raises InputError if the decompressed size is implausible for trained weights."""
    packed = path.stat().st_size
    if size > max(FREE_BYTES, MAX_RATIO * packed):
        raise InputError(f'{path}: {packed} compressed bytes expand to {size} or more, over {MAX_RATIO} times as many '
                         '(decompression bomb); store valid content without compression')


def read_npz(path):
    """Yields (key, array) for each entry of an npz file, in the order of the file."""
    path = existing(path)
    try:
        with path.open('rb') as opened, np.lib.npyio.NpzFile(opened, own_fid=False, allow_pickle=False) as file:
            check_unpacked(path, sum(entry.file_size for entry in file.zip.infolist()))
            seen = set()
            for key in file.files:
                if key in seen:
                    raise InputError(f"{path}: duplicate entry '{key}'")
                seen.add(key)
                array = file[key]
                if not isinstance(array, np.ndarray):
                    raise InputError(f"{path}: entry '{key}' is not an array in npy format")
                yield key, array
    except InputError:
        raise
    except Exception as error:  # zipfile, its decompressors and NumPy raise many types
        raise InputError(f'{path}: not a readable npz file: {" ".join(str(error).split())[:200]}') from None
