#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of check_words.py and check_links.py on trees of their own, and of make_results.py.

Usage: checks_test.py ROOT
"""

import pathlib
import subprocess
import sys
import tempfile
import unittest

TOOLS = pathlib.Path(sys.argv[1]) / "tools"


class CheckTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)

    def write(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def run_check(self, script):
        return subprocess.run([sys.executable, TOOLS / script, self.root], capture_output=True, text=True, check=False)

    def words_found(self, name, text):
        self.write("tests/words.txt", "# none\ncode stray_runs -> misregistered runs\ndocs told_apart -> distinguishable\n")
        self.write("README.md", "# Clean\n")
        self.write(name, text)
        result = self.run_check("check_words.py")
        self.assertEqual(result.returncode, 1 if result.stdout.count("' is now '") else 0, result.stderr)
        return result.stdout.count("' is now '")

    def test_a_name_has_the_word_in_any_case(self):
        for text in ("void FindStrayRunsOf();", "int stray_runs = 0;", 'Option("--stray-runs");', 'json["stray_runs"];'):
            self.assertEqual(self.words_found("mapper/a.h", text), 1, text)

    def test_comments_messages_and_parts_of_words_are_free(self):
        for text in ("// stray runs", 'Error("the stray runs are gone");', "void AstrayRunsOf();", "int stray; int runs;"):
            self.assertEqual(self.words_found("mapper/a.h", text), 0, text)

    def test_a_file_name_counts(self):
        self.assertEqual(self.words_found("mapper/stray_runs.h", ""), 1)

    def test_prose_counts_and_code_in_documents_does_not(self):
        self.assertEqual(self.words_found("mapper/README.md", "Modes are Told apart.\n"), 1)
        self.assertEqual(self.words_found("mapper/README.md", "`told apart`\n\n    told apart\n"), 0)

    def test_a_line_that_is_no_word_is_an_error(self):
        self.write("tests/words.txt", "stray\n")
        self.assertNotEqual(self.run_check("check_words.py").returncode, 0)

    def broken(self, text):
        self.write("mapper/graph/solve.h", "")
        self.write("mapper/METHOD.md", "# Method\n\n## 1. `Key` frames, visits\n")
        self.write("tests/unit/a_test.cc", "TEST(Suite, IsThere) {}\n")
        self.write("README.md", text)
        result = self.run_check("check_links.py")
        self.assertEqual(result.returncode, 1 if "broken references" not in result.stdout else int(" 0 broken" not in result.stdout))
        return result.returncode == 1

    def test_links_anchors_paths_and_tests_are_followed(self):
        for good in ("[a](mapper/METHOD.md)", "[a](mapper/METHOD.md#1-key-frames-visits)", "`mapper/graph/solve.h`", "`Suite.IsThere`", "[a](https://a.b)"):
            self.assertFalse(self.broken(good), good)
        for bad in ("[a](mapper/NONE.md)", "[a](mapper/METHOD.md#2)", "`mapper/graph/gone.h`", "`gone.h`", "`Suite.IsGone`"):
            self.assertTrue(self.broken(bad), bad)

    def test_a_comment_that_names_a_document_is_followed(self):
        self.write("mapper/a.h", "// See mapper/METHOD.md.\n")
        self.assertFalse(self.broken("# Clean"))
        self.write("mapper/a.h", "// See graph/README.md.\n")
        self.assertTrue(self.broken("# Clean"))

    def test_an_unknown_result_is_a_mistake(self):
        def run(*arguments):
            return subprocess.run([sys.executable, TOOLS / "make_results.py", *arguments], capture_output=True, text=True, check=False)

        self.assertEqual(run("no-such-result").returncode, 2)
        self.assertIn("shiftmap-experiment engines", run("--list").stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
