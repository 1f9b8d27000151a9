"""revisit-curve: metrics of matches in CSV files."""

import contextlib
import io
import unittest

from folders import FolderTest
from revisit import curve


def run(*arguments):
    out, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        code = curve.main([str(word) for word in arguments])
    return code, out.getvalue(), said.getvalue()


class Curve(FolderTest):
    def test_figures_are_those_computed_by_hand(self):
        file = self.folder / 'm.csv'
        # In the order of scores: correct, incorrect, correct. The last query has a match that was not found.
        file.write_text('score,correct,positive\n0.9,1,1\n0.8,0,0\n0.7,TRUE,\n0.1,0,1\n')
        code, out, said = run(file)
        self.assertEqual((code, said), (0, ''))
        figures = dict(zip('queries positives AP F1 recall_1 recall_100'.split(), out.splitlines()[1].split()[1:]))
        self.assertEqual((figures['queries'], figures['positives']), ('4', '3'))
        self.assertAlmostEqual(float(figures['AP']), 1 / 3 + 1 / 3 * 2 / 3, places=4)
        self.assertEqual(float(figures['recall_100']), 0.3333)
        self.assertEqual(float(figures['recall_1']), 0.6667)

    def test_it_draws(self):
        try:
            import matplotlib  # noqa: F401
        except ImportError:
            self.skipTest('without matplotlib')
        file, picture = self.folder / 'm.csv', self.folder / 'm.svg'
        file.write_text('correct,score,note\n1,2,x\n0,1,y\n')
        self.assertEqual(run(file, '-o', picture)[0], 0)
        self.assertIn('AP 1.000', picture.read_text())
        self.assertEqual(run(file, '-o', self.folder / 'none' / 'm.svg')[0], 1)

    def test_what_is_wrong_is_said_with_its_line(self):
        file = self.folder / 'm.csv'
        for text, says in (('', 'found nothing'), ('score\n1\n', 'score and correct'), ('score,correct\n', 'no matches'),
                           ('score,correct\n1,1\nx,0\n', ':3: score'), ('score,correct\nnan,1\n', ':2: score'),
                           ('score,correct\n1,maybe\n', ':2: correct'), ('score,correct\n1\n', ':2: correct')):
            file.write_text(text)
            code, _, said = run(file)
            self.assertEqual(code, 3, text)
            self.assertIn(says, said)
        self.assertEqual(run(self.folder / 'none.csv')[0], 3)


if __name__ == '__main__':
    unittest.main()
