#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Every command, option, file and test that tools/ANSWERS.md names exists.

usage: answers_test.py SOURCE_TREE FOLDER_OF_PROGRAMS
"""

import pathlib
import re
import subprocess
import sys

TEST = re.compile(r"\bTEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\s*\)")


def tests_of(tree):
    names = set()
    for path in (tree / "tests").rglob("*.cc"):
        names.update(f"{suite}.{name}" for suite, name in TEST.findall(path.read_text()))
    return names


def command_problem(words, programs):
    """What is wrong with a command and the options behind it; nothing if nothing is."""
    options = [word for word in words[1:] if word.startswith("-")]
    names = [word for word in words[1:] if not word.startswith("-")]
    if not (programs / words[0]).is_file():
        return f"no program {words[0]}"
    call = [str(programs / words[0]), *names, "--help"]
    run = subprocess.run(call, capture_output=True, text=True, timeout=60, check=False)
    if run.returncode != 0:
        return f"{' '.join(words)}: {run.stderr.strip()}"
    missing = [o for o in options if not re.search(rf"{re.escape(o)}(?![\w-])", run.stdout)]
    return f"{' '.join(words[:2])}: no option {' '.join(missing)}" if missing else ""


def problem_of(name, tree, tests, programs):
    if name.startswith("shiftmap-"):
        return command_problem(name.split(), programs)
    if "/" in name:
        return "" if (tree / name).is_file() else f"no file {name}"
    if re.fullmatch(r"[A-Z]\w+\.\w+", name):
        return "" if name in tests else f"no test {name}"
    return ""


def main():
    tree, programs = map(pathlib.Path, sys.argv[1:])
    rows = [
        line
        for line in (tree / "tools/ANSWERS.md").read_text().splitlines()
        if line.startswith("|") and not line.startswith("| ---")
    ]
    tests = tests_of(tree)
    problems = []
    for row in rows[1:]:
        cells = row.strip("|").split("|")
        if len(cells) != 3:
            problems.append(f"{len(cells)} cells: {row}")
        names = re.findall(r"`([^`]+)`", row)
        problems += [p for p in (problem_of(n, tree, tests, programs) for n in names) if p]
        if not re.search(r"`[^`]+`", cells[-1]):
            problems.append(f"verified by nothing: {row}")
    print("\n".join(problems) or f"{len(rows)} rows")
    return 1 if problems or len(rows) < 20 else 0


sys.exit(main())
