"""Places seen before, in any recording that revisit.recordings reads: the command revisit-loops."""

from revisit.loops.recognise import Exclusion, Visit, recognise

__all__ = ['Exclusion', 'Visit', 'recognise']
