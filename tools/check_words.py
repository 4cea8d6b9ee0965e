#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that words which gave way to standard terms have not come back.

tests/words.txt has a word a line: where it must not be (code, docs or all), the word, and what to
say instead. In code a word is looked for in file names, identifiers, options and JSON keys, as a
part of a name: `stray_runs` is in FindStrayRunsOf(). In documents it is looked for in prose, not in
code spans and indented lines. Prints one line per occurrence and exits with 1 if there is any.

Usage: check_words.py [--words FILE] [ROOT]
"""

import argparse
import functools
import pathlib
import re
import sys

TOPS = ["proto", "mapstore", "localizer", "mapper", "tools", "tests"]
CODE = {".h", ".cc", ".proto", ".sql", ".py", ".ts", ".mjs"}
LINE = re.compile(r"(code|docs|all)\s+(\S+)\s+->\s+(\S.*)")
COMMENT = re.compile(r'("(?:[^"\\\n]|\\.)*")|//[^\n]*|/\*.*?\*/|^\s*(?:--|#(?!\s*(?:include|define))).*?$', re.S | re.M)
STRING = re.compile(r'"((?:[^"\\\n]|\\.)*)"')
OPTION = re.compile(r"--([a-z][a-z0-9-]+)")
KEY = re.compile(r"^[A-Za-z][A-Za-z0-9_.]*$")
IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
SPAN = re.compile(r"`[^`]*`|\[[^\]]*\]\([^)]*\.(?:h|cc)\)|\]\([^)]*\)|<https?:[^>]*>")


@functools.lru_cache(maxsize=None)
def parts(name):
    """'FindStrayRuns', 'find-stray-runs' and 'find_stray_runs' are all '_find_stray_runs_'."""
    name = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name)
    name = re.sub(r"([A-Z]+)([A-Z][a-z])", r"\1_\2", name)
    return "_" + re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") + "_"


def names(text):
    """The identifiers, options and keys of a source, with their lines."""
    keep = COMMENT.sub(lambda m: m.group(1) or "\n" * m.group(0).count("\n"), text)
    for number, line in enumerate(keep.splitlines(), start=1):
        for literal in STRING.findall(line):
            for option in OPTION.findall(literal):
                yield number, option
            if KEY.match(literal):
                yield number, literal
        for identifier in IDENTIFIER.findall(STRING.sub(" ", line)):
            yield number, identifier


def prose(text):
    fenced = False
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("```"):
            fenced = not fenced
        elif not fenced and not line.startswith("    "):
            yield number, SPAN.sub(" ", line)


def read_words(path):
    words = {"code": {}, "docs": {}}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        match = LINE.fullmatch(line.strip())
        if not match:
            raise ValueError(f"{path}:{number}: not 'code|docs|all WORD -> INSTEAD': {line}")
        where, word, instead = match.groups()
        for kind in words:
            if where in (kind, "all"):
                words[kind][word] = instead
    return words


def occurrences(root, words):
    """Yields (place, word, instead)."""
    in_code = {parts(word).strip("_"): word for word in words["code"]}
    # Names overlap in their underscores.
    any_of = re.compile("|".join(f"(?<=_)(?:{needle})(?=_)" for needle in in_code) or r"(?!)")
    in_docs = {word: re.compile(rf"\b{re.escape(word.replace('_', ' '))}\b", re.I) for word in words["docs"]}
    documents = sorted(root.glob("*.md"))
    for top in TOPS:
        for path in sorted((root / top).rglob("*")):
            if path.suffix == ".md":
                documents.append(path)
            if path.suffix not in CODE or not path.is_file() or "node_modules" in path.parts:
                continue
            place = path.relative_to(root).as_posix()
            found = [(place, name) for name in place.split("/")]
            text = path.read_text(encoding="utf-8")
            found += [(f"{place}:{line}", name) for line, name in names(text)]
            for where, name in found:
                for needle in any_of.findall(parts(name)):
                    yield f"{where}: {name}", in_code[needle], words["code"][in_code[needle]]
    for path in documents:
        place = path.relative_to(root).as_posix()
        for number, line in prose(path.read_text(encoding="utf-8")):
            for word, pattern in in_docs.items():
                if pattern.search(line):
                    yield f"{place}:{number}", word, words["docs"][word]


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--words", type=pathlib.Path)
    parser.add_argument("root", nargs="?", type=pathlib.Path, default=root)
    arguments = parser.parse_args()
    words = read_words(arguments.words or arguments.root / "tests" / "words.txt")
    count = 0
    for place, word, instead in occurrences(arguments.root, words):
        print(f"{place}: '{word}' is now '{instead}'")
        count += 1
    print(f"words: {len(words['code'])} in code, {len(words['docs'])} in documents, {count} occurrences")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
