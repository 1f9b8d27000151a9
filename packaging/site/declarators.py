"""Filter of Doxygen, which documents one name of `double a = 0, b = 0;  ///< text`: writes a declaration for each name.

Removes defaulted and deleted functions without a comment. Lines keep their numbers.
"""

import re
import sys
from pathlib import Path

NAME = r'\w+(?: = [^,;{}]+|\{\})?'
DECLARATION = re.compile(rf'( *)((?:inline |static |constexpr )*[\w:]+(?:<[^;=]*>)?) ({NAME}(?:, {NAME})+); *(?:///<)?(.*)')
DEFAULTED = re.compile(r'[^/]*\)[ \w]* = (default|delete);')


def filtered(lines):
    before, begun = [], ''
    for line in lines:
        if re.fullmatch(r' *[\w:]+(<[^(]*>)? [\w, =]+,', line):  # a list of names that goes on
            begun = line
            yield ''
            continue
        line, begun = f'{begun} {line.strip()}' if begun else line, ''
        declaration = DECLARATION.fullmatch(line)
        if declaration:
            indent, kind, names, text = declaration.groups()
            yield ' '.join(f'{indent}/** {text or " ".join(before)} */ {kind} {name};' for name in names.split(', '))
        else:
            yield '' if DEFAULTED.fullmatch(line) and not before else line
        comment = re.fullmatch(r' */// ?(.*)', line)
        before = [*before, comment[1]] if comment else []


print('\n'.join(filtered(Path(sys.argv[1]).read_text().splitlines())))
