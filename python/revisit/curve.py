"""revisit-curve: precision and recall of your own matches from a CSV file."""

import argparse
import csv
import sys

from revisit import evaluation
from revisit.errors import Error, InputError

EXAMPLES = """\
the file has a header and one line per query:
  score      confidence in the best match
  correct    1 if that match is correct, else 0
  positive   1 if the query has a correct match in the database (default: equal to correct)
  ignored    1 if the match counts as neither (default: 0)

examples:
  revisit-curve matches.csv -o curve.png
  revisit-curve rings.csv scan_context.csv -o both.svg     # one curve each

exit codes: 0 ok; 1 failed; 2 usage; 3 a file is unreadable or malformed.
"""
TRUTH = {'1': True, 'true': True, '0': False, 'false': False}


def read_matches(file):
    """Returns one label per line. Raises InputError with the line."""
    try:
        with open(file, newline='', encoding='utf-8-sig') as lines:
            rows = csv.DictReader(lines)
            columns = rows.fieldnames or []
            for name in ('score', 'correct'):
                if name not in columns:
                    raise InputError(f'{file}: expected the columns score and correct, found {", ".join(columns) or "nothing"}')
            found = [label_of(file, rows.line_num, row) for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f'{file}: {getattr(error, "strerror", None) or error}') from None
    if not found:
        raise InputError(f'{file}: no matches after the header')
    return found


def label_of(file, number, row):
    def truth(name, default):
        text = (row.get(name) or '').strip().lower()
        if text not in TRUTH and (text or default is None):
            raise InputError(f'{file}:{number}: {name}: expected 0 or 1, found {text!r}')
        return TRUTH.get(text, default)
    try:
        score = float(row['score'])
    except (TypeError, ValueError):
        raise InputError(f'{file}:{number}: score: expected a number, found {row["score"]!r}') from None
    if score != score:
        raise InputError(f'{file}:{number}: score: expected a number, found {row["score"]!r}')
    correct = truth('correct', None)
    return evaluation.MatchLabel(score, correct, truth('positive', correct), truth('ignored', False))


def draw(curves, file):
    from revisit.loops.show import need_matplotlib
    need_matplotlib()
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(figsize=(6, 5), layout='constrained')
    for name, (curve, summary) in curves.items():
        axes.plot(curve['recall'], curve['precision'], drawstyle='steps-pre', label=f'{name}: AP {summary.average_precision:.3f}')
    axes.set(xlabel='recall', ylabel='precision', xlim=(0, 1.02), ylim=(0, 1.02))
    axes.grid(alpha=0.3)
    axes.legend(loc='lower left')
    try:
        figure.savefig(file)
    except (OSError, ValueError) as error:
        raise Error(f'{file}: cannot be written: {error}') from None


def work(o):
    curves = {}
    width = max(8, *(len(file) for file in o.matches))
    print(f'{"matches":{width}}  queries  positives      AP  F1 max  recall@1  recall@100%P')
    for file in o.matches:
        found = read_matches(file)
        s = evaluation.summarize(found)
        curves[file] = evaluation.precision_recall(found), s
        print(f'{file:{width}}  {s.n_queries:7}  {s.n_positives:9}  {s.average_precision:6.4f}  {s.f1_max:6.4f}  {s.recall_at_1:8.4f}'
              f'  {s.max_recall_at_precision_1:12.4f}', flush=True)
    if o.output:
        draw(curves, o.output)


def main(arguments=None) -> int:
    """The command. Returns the exit code; argparse exits itself for --help and unknown options."""
    parser = argparse.ArgumentParser('revisit-curve', formatter_class=argparse.RawDescriptionHelpFormatter, epilog=EXAMPLES,
                                     description='Precision and recall of your own matches: average precision, F1, a figure.')
    parser.add_argument('matches', nargs='+', metavar='MATCHES.csv')
    parser.add_argument('-o', '--output', metavar='FILE', help='figure of the precision-recall curves: .png, .svg or .pdf (needs matplotlib)')
    try:
        work(parser.parse_args(arguments))
        return 0
    except Error as error:
        print(f'revisit-curve: {error}', file=sys.stderr)
        return getattr(error, 'code', 1)


if __name__ == '__main__':
    raise SystemExit(main())
