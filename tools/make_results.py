#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the results in tests/results, and the page that lists them.

A result is a folder with what its command wrote, and source.json: command, commit, processors and
load. Files above 50 kB are left out. Without names only the page is written anew. The papers' runs
are made by the commands in papers.md, of which only the values that the page needs are kept.

Usage: make_results.py [--bin DIR]... [--data DIR] [--list] [NAME...]
"""

import argparse
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
RESULTS = ROOT / "tests" / "results"
MAX_BYTES = 50_000
BENCH = "--benchmark_out=OUT/{0}.json --benchmark_out_format=json"

# Name: (what it shows, command; OUT is the folder, WORK a scratch folder, DATA recorded data).
EXPERIMENTS = {
    "alignments": ("how often a transform between maps with moved landmarks is right, four methods", "shiftmap-experiment alignments --pairs 10000 --output OUT"),
    "chain": ("time to learn the chains of a map", "shiftmap_chain_bench " + BENCH.format("chain_bench")),
    "displaced": ("recorded runs on a map with four displaced landmarks, IJRR 8.2: build, oracle, static map, Cauchy loss", "shiftmap-experiment ijrr-utias --data DATA/utias --methods ours oracle static static-cauchy --output OUT"),
    "displaced-starts": ("the same for 12 robots from four starts: as good as the oracle, ambiguous, or wrong", "shiftmap-experiment ijrr-utias --data DATA/utias --datasets 1 2 3 6 --robots 1 2 3 4 --start-s 0 340 680 1020 --methods ours oracle --output OUT"),
    "engines": ("maps of the graph and of the tree engine on the same sites", "shiftmap-experiment engines --sites 2 --output OUT"),
    "fleet-links": ("200 vehicles over links that are cut", "SHIFTMAP_LONG_TESTS=1 SHIFTMAP_RESULTS=OUT shiftmap_fleet_links_test"),
    "fleet-nights": ("thirty nights of ten areas", "shiftmap-experiment fleet-nights --output OUT --work WORK --nights 30 --worlds 10 --groups 16 --size-m 22 --duration-s 60"),
    "fleet-nights-frame": ("nights of one area with and without control points", "shiftmap-experiment fleet-nights --worlds 1 --nights 60 --vehicles 1 --groups 10 --size-m 16 --duration-s 30 --control-points 3 --output OUT --work WORK"),
    "fleet-nights-long": ("300 nights of one area with and without control points, each judged by one shift of earlier days", "shiftmap-experiment fleet-nights --worlds 1 --nights 300 --vehicles 1 --groups 10 --size-m 16 --duration-s 30 --control-points 3 --judge-shifts 1 --seed 2 --output OUT --work WORK"),
    "fleet-nights-one-area": ("300 nights of one area: its frame stays", "shiftmap-experiment fleet-nights --output OUT --work WORK --worlds 1 --nights 300 --vehicles 2"),
    "groupings": ("the same days built every night, every few, or in one batch", "shiftmap-experiment groupings --worlds 2 --groups 20 --size-m 25 --duration-s 60 --output OUT --work WORK"),
    "incremental": ("time of a step of the frame-by-frame mapper", "shiftmap_incremental_bench " + BENCH.format("incremental_bench")),
    "layout-pairs": ("recorded runs of two layouts: search against a sum over all explanations", "shiftmap-experiment layout-pairs --data DATA/utias --output OUT"),
    "ledger": ("a year of 20 vehicles in one store: time and bytes of a report", "SHIFTMAP_LONG_TESTS=1 shiftmap_ledger_bench " + BENCH.format("ledger_bench")),
    "ledger-years": ("size and time of a ledger over ten years of 1,000 landmarks", "shiftmap-experiment ledger-years --years 10 --vehicles 5 --visits-per-day 0.3 --output OUT --work WORK"),
    "lidar-run": ("buildings mapped by corners that a lidar sees", "shiftmap-experiment lidar-run --data DATA/lidar --output OUT"),
    "localizer-bodies": ("recorded robots among landmarks that moved together", "shiftmap-experiment localizer-bodies --data DATA/utias --output OUT"),
    "localizer-consistency": ("error of the pose against its covariance on uncertain maps", "shiftmap-experiment localizer-consistency --output OUT"),
    "localizer-decisions": ("share of wrong decisions, and their delay", "shiftmap-experiment localizer-decisions --output OUT"),
    "localizer-decisions-blind": ("the same after 5 to 60 s without a sighting", "shiftmap-experiment localizer-decisions --blind --output OUT"),
    "localizer-decisions-slip": ("the same, wheels slip on every tenth of these ways", "shiftmap-experiment localizer-decisions --blind --slip-share 0.1 --output OUT"),
    "localizer-recorded": ("recorded robots on maps of one layout, with stretches without sightings, and with their own calibration", "shiftmap-experiment localizer-recorded --data DATA/utias --output OUT"),
    "localizer-starts": ("starts of shifts on a crowded site that changes every other day", "shiftmap-experiment nights --worlds 10 --nights 15 --groups 10 --size-m 12 --duration-s 60 --layout-days 2 --layout-share 0.9 --output OUT --work WORK"),
    "localizer-states": ("states that are reported, by known causes", "shiftmap-experiment localizer-states --output OUT --shifts 200 --seed 5001"),
    "localizer-step": ("time of a step of the localizer", "shiftmap_localizer_bench " + BENCH.format("localizer_bench")),
    "localizer-utias": ("recorded robots with four layouts known, the wrong one believed", "shiftmap-experiment localizer-utias --data DATA/utias --output OUT"),
    "map-consistency": ("error of maps of one run, two and more against their covariance", "shiftmap-experiment map-consistency --data DATA/utias --output OUT"),
    "map-consistency-340s": ("the same, the first 340 s of recorded runs", "shiftmap-experiment map-consistency --data DATA/utias --duration-s 340 --worlds 0 --output OUT"),
    "nights": ("days and nights of sites whose layout changes", "shiftmap-experiment nights --worlds 1 --layout-days 4 --output OUT --work WORK"),
    "recurring-chains": ("learned chains on a real door and a person's rooms, held out", "shiftmap-experiment recurring-chains --data DATA/recurring --output OUT"),
    "scale": ("time, memory and error of builds over the size of a site", "shiftmap-experiment scale --max-key-frames 100000 --output OUT"),
    "scale-million": ("a site of a million key frames: an hour, 10 GiB", "shiftmap-experiment scale --min-key-frames 1000000 --max-key-frames 1000000 --output OUT"),
    "scale-misread": ("a site with 0.3 misread signatures a scan", "shiftmap-experiment scale --min-key-frames 10000 --misread 0.3 --output OUT"),
    "scale-odometry": ("a site with five times the noise of odometry", "shiftmap-experiment scale --min-key-frames 10000 --odometry-noise 5 --output OUT"),
    "selectors": ("time of a selection by each selector", "shiftmap_selector_bench " + BENCH.format("selector_bench")),
    "server": ("time until a report is durable at the server", "shiftmap_server_bench --benchmark_min_time=2 " + BENCH.format("server_bench")),
    "solver": ("the graph's own solver, Ceres, Eigen and CHOLMOD", "shiftmap_solver_bench " + BENCH.format("solver_bench")),
    "store": ("time of a commit, a load, an export, a return", "shiftmap_store_bench " + BENCH.format("store_bench")),
    "vehicle-faults": ("what a broken or lying vehicle does to the map", "shiftmap-experiment vehicle-faults --worlds 1 --groups 20 --size-m 25 --duration-s 90 --output OUT --work WORK"),
    "victoria-park": ("4 km between trees without identity, against GPS", "shiftmap-experiment victoria-park --data DATA/victoria_park --output OUT"),
}

HEAD = """# Results

Commands wrote all files here, and `tools/make_results.py` this page. `tools/make_results.py engines` makes a
result anew. OUT is the folder of the result, WORK a scratch folder, DATA the recorded data
(`$SHIFTMAP_DATA`). Times are comparable within one file only. Figures of the two papers, item by item:
[papers.md](papers.md).

| result | shows | command | commit |
| --- | --- | --- | --- |
"""


def git(*arguments):
    return subprocess.run(["git", "-C", ROOT, *arguments], capture_output=True, text=True, check=True).stdout.strip()


def without_host(text):
    """A benchmark's document without the name of the machine and of the program's folder."""
    return re.sub(r'^ *"(?:host_name|executable)": .*\n', "", text, flags=re.M)


def make(name, bins, data):
    """Runs one command and keeps what it wrote."""
    with tempfile.TemporaryDirectory() as scratch:
        out, work = pathlib.Path(scratch, "out"), pathlib.Path(scratch, "work")
        out.mkdir()
        command = EXPERIMENTS[name][1]
        words = shlex.split(command.replace("OUT", str(out)).replace("WORK", str(work)).replace("DATA", str(data)))
        environment = dict(os.environ, PATH=os.pathsep.join([*bins, os.environ["PATH"]]))
        while "=" in words[0]:
            key, _, value = words.pop(0).partition("=")
            environment[key] = value
        load = os.getloadavg()[0]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 8):
            print(f"{name}: exit {done.returncode}: {done.stderr.strip()[-400:]}")
            return False
        if not any(out.iterdir()):
            (out / f"{name}.txt").write_text(done.stdout, encoding="utf-8")
        folder = RESULTS / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for path in sorted(out.rglob("*")):
            if path.is_file() and path.stat().st_size <= MAX_BYTES:
                text = path.read_text(encoding="utf-8")
                for place, word in ((str(out), "OUT"), (str(work), "WORK"), (data, "DATA")):
                    text = text.replace(place, word) if place else text
                (folder / path.name).write_text(without_host(text), encoding="utf-8")
        source = {"command": command, "commit": git("rev-parse", "--short=7", "HEAD"), "processors": os.cpu_count(), "load": round(load, 1)}
        (folder / "source.json").write_text(json.dumps(source, indent=2) + "\n", encoding="utf-8")
        print(f"{name}: {', '.join(path.name for path in sorted(folder.iterdir()))}")
        return True


def source_of(name):
    """Command and commit of a result: as noted when it was made, else of the commit that has it."""
    noted = RESULTS / name / "source.json"
    if noted.exists():
        source = json.loads(noted.read_text(encoding="utf-8"))
        return source["command"], source["commit"]
    return EXPERIMENTS[name][1], git("log", "-1", "--abbrev=7", "--format=%h", "--", str(RESULTS / name)) or "–"


def write_page():
    rows = []
    for name, (shows, _) in sorted(EXPERIMENTS.items()):
        if not (RESULTS / name).is_dir():
            continue
        files = [path for path in sorted((RESULTS / name).iterdir()) if path.name != "source.json"]
        links = ", ".join(f"[{path.suffix[1:]}]({name}/{path.name})" for path in files)
        command, commit = source_of(name)
        rows.append(f"| {name}: {links} | {shows} | `{command}` | {commit} |\n")
    (RESULTS / "README.md").write_text(HEAD + "".join(rows), encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bin", action="append", default=[], help="folder of programs; default: build/dev")
    parser.add_argument("--data", default=os.environ.get("SHIFTMAP_DATA", ""), help="recorded data")
    parser.add_argument("--list", action="store_true", help="names and commands")
    parser.add_argument("names", nargs="*")
    arguments = parser.parse_args()
    if arguments.list:
        for name, (shows, command) in sorted(EXPERIMENTS.items()):
            print(f"{name}: {shows}\n    {command}")
        return 0
    unknown = sorted(set(arguments.names) - set(EXPERIMENTS))
    if unknown:
        print(f"no such result: {', '.join(unknown)}; --list has all")
        return 2
    if not arguments.data and any("DATA/" in EXPERIMENTS[name][1] for name in arguments.names):
        print("recorded data is needed: --data or SHIFTMAP_DATA")
        return 2
    build = ROOT / "build" / "dev"
    bins = arguments.bin or [str(build / "bin"), str(build / "tests" / "bench"), str(build / "tests" / "scenario")]
    made = [make(name, bins, arguments.data) for name in arguments.names]
    write_page()
    return 0 if all(made) else 1


if __name__ == "__main__":
    sys.exit(main())
