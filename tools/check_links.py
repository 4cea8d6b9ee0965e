#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks what the documents refer to: links, anchors, paths in code spans, names of tests.

A path in a code span is looked for from the document's folder, from its module and from the root.
A document that a source names has to be there too. Prints one line per broken reference and exits
with 1 if there is any.

Usage: check_links.py [ROOT]
"""

import pathlib
import re
import sys

TOPS = ["proto", "mapstore", "localizer", "mapper", "tools", "tests"]
SOURCES = {".h", ".cc", ".proto", ".sql", ".py", ".sh", ".txt", ".json"}
LINK = re.compile(r"\]\(([^)\s]+)\)")
SPAN = re.compile(r"`([^`]+)`")
PATH = re.compile(r"[A-Za-z0-9_.-]+(?:/[A-Za-z0-9_.-]+)*\.(?:h|cc|md|py|sh|mjs|ts|proto|json|sql|txt|in)")
FOLDER = re.compile(r"(?:[a-z0-9_]+/){2,}")
TEST = re.compile(r"([A-Z]\w+)\.([A-Z]\w+)")
DOCUMENT = re.compile(r"(?<![\w/.-])((?:\.\./)*[\w./-]*(?:README|METHOD|FORMATS|DECISIONS|MEASURED|OPERATIONS|TUTORIAL|ANSWERS)\.md)\b")
CASE = re.compile(r"^TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)", re.M)
HEADING = re.compile(r"#{1,6}\s+(.*)")


def anchor(heading):
    heading = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def lines_of(path):
    return path.read_text(encoding="utf-8").splitlines()


def anchors(path):
    return {anchor(match.group(1)) for match in map(HEADING.match, lines_of(path)) if match}


def files(root, suffixes):
    found = sorted(path for path in root.glob("*") if path.suffix in suffixes)
    for top in TOPS:
        found += sorted(path for path in (root / top).rglob("*") if path.suffix in suffixes)
    return [path for path in found if path.is_file() and "node_modules" not in path.parts]


def resolves(name, path, root):
    """Whether a path in a document or comment is there, seen from one of three folders."""
    module = root / path.relative_to(root).parts[0]
    return any((base / name).exists() for base in (path.parent, module, root))


def problems_of_document(path, root, tests, every_name):
    for number, line in enumerate(lines_of(path), start=1):
        for target in LINK.findall(line):
            if re.match(r"[a-z]+:", target):
                continue
            name, _, fragment = target.partition("#")
            file = path.parent / name if name else path
            if not file.exists():
                yield number, f"link to {target}: no such file"
            elif fragment and file.suffix == ".md" and fragment not in anchors(file):
                yield number, f"link to {target}: no such heading"
        if line.startswith("    "):
            continue
        for span in SPAN.findall(line):
            if PATH.fullmatch(span) or FOLDER.fullmatch(span):
                anywhere = span in every_name or not span.endswith((".h", ".cc"))
                if not resolves(span, path, root) and ("/" in span or not anywhere):
                    yield number, f"`{span}`: no such path"
            match = TEST.fullmatch(span)
            if match and match.group(1) in tests and match.group(2) not in tests[match.group(1)]:
                yield number, f"`{span}`: no such test"


def problems_of_source(path, root):
    for number, line in enumerate(lines_of(path), start=1):
        for name in DOCUMENT.findall(line):
            if not resolves(name.lstrip("/"), path, root):
                yield number, f"{name}: no such document"


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parent.parent).resolve()
    documents = files(root, {".md"})
    tests = {}
    for path in sorted((root / "tests").rglob("*.cc")):
        for suite, name in CASE.findall(path.read_text(encoding="utf-8")):
            tests.setdefault(suite, set()).add(name)
    every_name = {path.name for top in TOPS for path in (root / top).rglob("*")}
    count = 0
    for path in documents:
        for number, problem in problems_of_document(path, root, tests, every_name):
            print(f"{path.relative_to(root)}:{number}: {problem}")
            count += 1
    for path in files(root, SOURCES):
        if path.relative_to(root).parts[:3] in (("tests", "unit", "tools"), ("tests", "data")):
            continue  # Documents of tests' own making.
        for number, problem in problems_of_source(path, root):
            print(f"{path.relative_to(root)}:{number}: {problem}")
            count += 1
    print(f"links: {len(documents)} documents, {count} broken references")
    return 1 if count or not documents else 0


if __name__ == "__main__":
    sys.exit(main())
