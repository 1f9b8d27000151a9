"""Reading of PyTorch's state dicts without running code from the file."""

from pathlib import Path

from .errors import Error, InputError
from .files import existing
from .npy import read_npz


def read(path):
    """Reads {key: array} from a .safetensors, .npz or PyTorch file (.pth, .pt; needs torch)."""
    path = existing(path)
    ending = path.suffix.lower()
    readers = {'.safetensors': _safetensors, '.npz': lambda file: dict(read_npz(file))}
    state = readers.get(ending, _torch)(path)
    if not state:
        raise InputError(f'{path}: expected arrays, found none')
    return state


def _safetensors(path):
    from safetensors import SafetensorError
    from safetensors.numpy import load_file
    try:
        return load_file(str(path))
    except (SafetensorError, OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f'{path}: not a readable safetensors file: {error}') from None


def _torch(path):
    try:
        import torch
    except ImportError:
        raise Error(f'{path}: reading it needs PyTorch (pip install torch); .safetensors and .npz do not') from None
    major, minor = torch.__version__.split('.')[:2]
    if (int(major), int(minor)) < (2, 6):  # CVE-2025-32434: weights_only runs code
        raise Error(f'{path}: expected PyTorch 2.6 or later, because older versions may run code from the file, found '
                    f'{torch.__version__} (pip install -U torch); .safetensors and .npz do not need PyTorch')
    try:
        state = torch.load(path, map_location='cpu', weights_only=True)  # rejects everything but numbers
    except Exception as error:  # pickle, zip and torch raise many types
        raise InputError(f'{path}: expected a state dict with numbers only: {" ".join(str(error).split())[:200]}') from None
    if isinstance(state, dict) and isinstance(state.get('state_dict'), dict):
        state = state['state_dict']  # a training checkpoint
    if not isinstance(state, dict) or not all(isinstance(value, torch.Tensor) for value in state.values()):
        raise InputError(f'{path}: expected a state dict (names and tensors), found {type(state).__name__}')
    return {key.removeprefix('module.'): value.detach().to('cpu').float().numpy()
            if value.is_floating_point() else value.cpu().numpy() for key, value in state.items()}
