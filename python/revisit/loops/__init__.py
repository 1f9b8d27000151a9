"""Online loop detection in any recording that revisit.recordings reads: the command revisit-loops."""

from revisit.loops.recognize import Visit, recognize

__all__ = ['Visit', 'recognize']
