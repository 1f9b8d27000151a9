"""Online loop detection in any recording that revisit.recordings reads: the command revisit-loops."""

from revisit import _former
from revisit.loops.recognize import Visit, recognize

__all__ = ['Visit', 'recognize']

__getattr__ = _former.module_getattr(__name__, recognise='recognize')
