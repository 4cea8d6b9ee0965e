#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Counts test cases: count_tests.py CTEST_JUNIT_XML GTEST_XML_DIR

A test that ctest ran counts as the cases that it wrote to GTEST_XML_DIR/<name>.xml, or as one case
if it is no GoogleTest program. One that broke off counts as one failure more. Prints
`passed failed skipped`.
"""

import pathlib
import sys
import xml.etree.ElementTree as tree


def count_cases(path):
    """Returns (passed, failed, skipped) of a GoogleTest report."""
    cases = list(tree.parse(path).getroot().iter("testcase"))
    failed = sum(1 for case in cases if case.find("failure") is not None)
    skipped = sum(
        1
        for case in cases
        if case.find("failure") is None
        and (case.get("result") in ("skipped", "suppressed") or case.get("status") == "notrun")
    )
    return len(cases) - failed - skipped, failed, skipped


def count_test(test, reports):
    """Returns (passed, failed, skipped) of one test as ctest ran it."""
    status = test.get("status")
    report = reports / f"{test.get('name')}.xml"
    if status == "fail":
        counts = count_cases(report) if report.exists() else (0, 0, 0)
        return counts if counts[1] else (counts[0], 1, counts[2])
    if status != "run":
        return 0, 0, 1
    return count_cases(report) if report.exists() else (1, 0, 0)


def main():
    tests = tree.parse(sys.argv[1]).getroot().iter("testcase")
    reports = pathlib.Path(sys.argv[2])
    counts = [count_test(test, reports) for test in tests]
    print(*(sum(count[i] for count in counts) for i in range(3)))


if __name__ == "__main__":
    main()
