#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that includes follow the layers: proto <- mapstore <- localizer <- mapper <- tools.

Third-party types stop at one place each, and a module's internal/ folders are its own. Prints one
line per violation and exits with 1 if there is any.
"""

import pathlib
import re
import sys

LAYERS = ["proto", "mapstore", "localizer", "mapper", "tools"]
EVERYWHERE = LAYERS + ["tests"]
SOURCES = {".h", ".cc"}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')

# (what is included, where it may be, what to say)
CONFINED = [
    (re.compile(r"^sqlite3\.h$"), re.compile(r"^mapstore/sqlite/"), "mapstore/sqlite"),
    (re.compile(r"^grpc(pp)?/|\.grpc\.pb\.h$"), re.compile(r"^(mapstore/server|localizer/transfer)/"), "the server and its client"),
    (re.compile(r"(?<!\.grpc)\.pb\.h$"), re.compile(r"^proto/|(^|/)codec/"), "proto and codec folders"),
    (re.compile(r"^curl/"), re.compile(r"^localizer/transfer/"), "localizer/transfer"),
    (re.compile(r"^ceres/"), re.compile(r"^mapper/graph/"), "mapper/graph"),
    (re.compile(r"^absl/"), re.compile(r"^proto/core/status\.h$"), "proto/core/status.h"),
    (re.compile(r"^CLI/"), re.compile(r"^mapstore/cli/"), "mapstore/cli"),
    (
        re.compile(r"^microhttpd\.h$"),
        re.compile(r"^mapstore/http/"),
        "mapstore/http",
    ),
    (re.compile(r"^cairo\.h$|^librsvg/"), re.compile(r"^tools/plot/png\.cc$"), "tools/plot/png.cc"),
    (re.compile(r"^toml\+\+/"), re.compile(r"^mapstore/cli/"), "mapstore/cli"),
    (re.compile(r"^pybind11/"), re.compile(r"^tools/python/"), "tools/python"),
]


def project_files(root):
    for top in EVERYWHERE:
        for path in sorted((root / top).rglob("*")):
            if path.suffix in SOURCES and path.is_file():
                yield path.relative_to(root).as_posix()


def includes(path):
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        match = INCLUDE.match(line)
        if match:
            yield number, match.group(1), match.group(2)


def violations(file, bracket, included):
    """Yields what is wrong with one include of one file."""
    top = file.split("/")[0]
    target = included.split("/")[0]
    for what, where, name in CONFINED:
        if what.search(included) and not where.search(file) and top != "tests":
            yield f"may be included in {name} only"
    if target in EVERYWHERE and "/" in included:
        if bracket == "<":
            yield "project headers are included with quotes"
        if target == "tests" and top != "tests":
            yield "only tests use tests"
        if top in LAYERS and target in LAYERS and LAYERS.index(target) > LAYERS.index(top):
            yield f"{top} is below {target}"
        folders = included.split("/")
        if "internal" in folders:
            owner = "/".join(folders[: folders.index("internal")])
            if top != "tests" and not file.startswith(owner + "/"):
                yield f"internal to {owner}"
    elif bracket == '"' and not included.endswith(".pb.h"):
        yield "project headers are included from the project root"


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    count = 0
    files = list(project_files(root))
    for file in files:
        for number, bracket, included in includes(root / file):
            for problem in violations(file, bracket, included):
                print(f"{file}:{number}: {included}: {problem}")
                count += 1
    if not files:
        print("no source files found")
        return 1
    print(f"layering: {len(files)} files, {count} violations")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
