"""Places seen before, in any recording that revisit.recordings reads: the command revisit-loops."""

from revisit.loops.recognise import Visit, recognise

__all__ = ['Visit', 'recognise']
