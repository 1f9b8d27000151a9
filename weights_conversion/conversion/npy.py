"""Arrays in npy and npz files."""

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


FREE_BYTES, MOST_TIMES = 1 << 30, 100
"""What a file may become when it is unpacked: this many bytes, or this many times its size. Zeros become a thousand times more."""


def check_unpacked(path, size):
    """Ends with InputError when `size` bytes are what no trained weights become."""
    packed = path.stat().st_size
    if size > max(FREE_BYTES, MOST_TIMES * packed):
        raise InputError(f'{path}: {packed} bytes that become {size} or more when they are unpacked, over {MOST_TIMES} times as many: '
                         'a bomb; if it is none, store it without compression')


def read_npz(path):
    """Gives (key, array) for each entry of an npz file, in the order of the file."""
    path = existing(path)
    try:
        with path.open('rb') as opened, np.lib.npyio.NpzFile(opened, own_fid=False, allow_pickle=False) as file:
            check_unpacked(path, sum(entry.file_size for entry in file.zip.infolist()))
            seen = set()
            for key in file.files:
                if key in seen:
                    raise InputError(f"{path}: holds the entry '{key}' twice")
                seen.add(key)
                array = file[key]
                if not isinstance(array, np.ndarray):
                    raise InputError(f"{path}: the entry '{key}' is not an array in npy's form")
                yield key, array
    except InputError:
        raise
    except Exception as error:  # zipfile, its packers and NumPy have many
        raise InputError(f'{path}: not a readable npz file: {" ".join(str(error).split())[:200]}') from None
