"""Check of the wheels."""

import re
import sys
from pathlib import Path

import numpy as np

import revisit


def stands_alone():
    everywhere = re.compile(r'lib(c|m|dl|rt|util|pthread|resolv|stdc\+\+|gcc_s|python[\d.]+|ssl|crypto|z|bz2|lzma|ffi|expat|uuid)[.-]')
    loaded = {Path(line.split()[-1]) for line in Path('/proc/self/maps').read_text().splitlines() if '.so' in line}
    own = Path(sys.prefix).resolve()
    ours = [own, Path(np.__file__).resolve().parents[1]]  # numpy may be a link to another environment
    foreign = [str(file) for file in loaded if file.name.startswith('lib') and not everywhere.match(file.name)
               and not any(folder in file.resolve().parents for folder in ours)]
    assert not foreign, f'the wheel takes these from the machine: {foreign}'
    assert own in Path(revisit.__file__).resolve().parents, revisit.__file__
