"""What `revisit net inspect|profile --format json` prints matches docs/data/schemas/net.json."""

import json
import os
import subprocess
import unittest

import caffe_needs  # noqa: F401  exits without protobuf
import net_schema
from folders import FolderTest

try:
    import jsonschema
except ImportError:
    jsonschema = None

NET = net_schema.ROOT / 'weights_conversion' / 'nets' / 'ring16.prototxt'


class Schema(FolderTest):
    def report(self, *words):
        done = subprocess.run([os.environ['REVISIT_PROGRAM'], 'net', *words[:1], NET, *words[1:], '--format', 'json'],
                              capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    def test_is_that_of_the_messages(self):
        self.assertEqual(net_schema.FILE.read_text(), net_schema.text(), f'run {net_schema.__doc__}')

    @unittest.skipUnless(jsonschema, 'needs the package jsonschema')
    def test_every_report_matches(self):
        check = jsonschema.Draft202012Validator(net_schema.schema())
        shape = ('--input-shape', '1,1,16,64')
        profile = self.report('profile', '--repeat', '10', *shape)
        baseline = self.folder / 'old.json'
        baseline.write_text(json.dumps(profile))
        for report in (self.report('inspect', '--memory', *shape), profile,
                       self.report('profile', '--repeat', '10', '--baseline', baseline, *shape)):
            check.validate(report)
            for key in ('macs', 'layers'):
                with self.assertRaises(jsonschema.ValidationError):
                    check.validate({name: value for name, value in report.items() if name != key} | {'other': 1})
            with self.assertRaises(jsonschema.ValidationError):
                check.validate(report | {'threads': 'two'})


if __name__ == '__main__':
    unittest.main()
