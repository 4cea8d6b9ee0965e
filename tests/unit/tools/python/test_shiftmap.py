# SPDX-License-Identifier: Apache-2.0
"""The Python package against what the commands say of the same files.

Usage: test_shiftmap.py BIN EXAMPLE EXPECTED_OUTPUT [unittest's arguments]; exits 77, skipped,
where there is no NumPy.
"""

import ast
import csv
import hashlib
import inspect
import json
import pathlib
import random
import re
import subprocess
import sys
import tempfile
import threading
import time
import unittest

try:
    import numpy as np
except ImportError:
    print("skipped: no NumPy")
    sys.exit(77)
import shiftmap

BIN, EXAMPLE, EXPECTED = (pathlib.Path(argument) for argument in sys.argv[1:4])
HOSTILE = "<b>\x1b[2J\n=1+1\u009b'é"


def run(program, *arguments):
    """The JSON document of a command."""
    command = [str(BIN / program), *map(str, arguments), "--json"]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


class Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.world = pathlib.Path(cls.folder.name)
        run("shiftmap-sim", "open", cls.world, "--shifts", 4, "--groups", 12, "--modes", 2,
            "--duration-s", 120, "--seed", 7)
        cls.path = cls.world / "maps.db"
        runs = [cls.world / f"run_00{i}.mcap" for i in range(3)]
        run("shiftmap-mapper", "build", "--store", cls.path, "--area", "floor", *runs)
        cls.log = cls.world / "run_003.mcap"
        cls.at = shiftmap.read_run_log(str(cls.log)).odometry_ns[0] * 1e-9
        cls.store = shiftmap.Store(str(cls.path))

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def of_store(self, command, *more):
        return run("shiftmap-inspect", command, *more, "--store", self.path, "--area", "floor")

    def expect_error(self, category, exit_code, call, *arguments, **named):
        with self.assertRaises(shiftmap.ShiftmapError) as caught:
            call(*arguments, **named)
        self.assertEqual((caught.exception.category, caught.exception.exit_code),
                         (category, exit_code))
        self.assertNotIn("\n", str(caught.exception))
        return str(caught.exception)

    def test_a_map_holds_what_show_says(self):
        at = 1.7679e9
        floor = self.store.load("floor", at=at)
        shown = self.of_store("show", "--at", at)
        rows = [(group["signature"], mode) for group in shown["groups"]
                for mode in group["modes"] if mode["mode"] > 0]
        self.assertEqual(len(floor), len(rows))
        self.assertEqual(list(floor.signatures), [signature for signature, _ in rows])
        self.assertEqual(list(floor.modes), [mode["mode"] for _, mode in rows])
        np.testing.assert_array_equal(floor.positions, [(m["x_m"], m["y_m"]) for _, m in rows])
        np.testing.assert_array_equal(floor.probabilities, [m["probability"] for _, m in rows])
        np.testing.assert_array_equal(
            floor.covariances,
            [[[m["cov_m2"][0], m["cov_m2"][1]], [m["cov_m2"][1], m["cov_m2"][2]]] for _, m in rows])
        np.testing.assert_allclose(floor.last_seen_ns * 1e-9, [m["last_seen_s"] for _, m in rows])
        self.assertEqual(list(floor.landmarks), [g["signature"] for g in shown["groups"]])
        np.testing.assert_array_equal(
            floor.absent, [g["modes"][0]["probability"] for g in shown["groups"]])
        np.testing.assert_array_equal(
            floor.leave_rates_per_s, [g["leave_rate_per_s"] for g in shown["groups"]])
        self.assertEqual(floor.content_hash, shown["content_hash"])
        self.assertEqual((floor.area, floor.version), ("floor", 1))

    def test_what_a_shell_prints_of_an_object_says_what_it_holds(self):
        log = shiftmap.read_run_log(str(self.log))
        self.assertEqual(repr(log), f"<RunLog vehicle='{log.vehicle}' scans={len(log.scans_ns)} "
                                    f"observations={len(log.observations_ns)}>")
        shift = shiftmap.replay(self.store.load("floor"), str(self.log))
        self.assertEqual(repr(shift), f"<Replay poses={len(shift.poses)} "
                                      f"innovations={len(shift.innovations['nis'])}>")
        history = self.store.history("floor", "L01")
        self.assertEqual(repr(history), "<History signature='L01' version=1 "
                                        f"visits={len(history.visits['begin_ns'])}>")

    def test_the_joint_covariance_has_the_marginals_on_its_diagonal(self):
        floor = self.store.load("floor")
        joint = floor.joint_covariance()
        self.assertEqual(joint.shape, (2 * len(floor), 2 * len(floor)))
        np.testing.assert_array_equal(joint, joint.T)
        for i, covariance in enumerate(floor.covariances):
            np.testing.assert_array_equal(joint[2 * i : 2 * i + 2, 2 * i : 2 * i + 2], covariance)
        self.assertGreater(np.linalg.eigvalsh(joint).min(), 0.0)

    def test_transitions_obey_the_chain(self):
        floor = self.store.load("floor")
        name = floor.landmarks[0]
        rates = floor.rate_matrix(name)
        np.testing.assert_allclose(rates.sum(axis=1), 0.0, atol=1e-12)
        hour = floor.transition(name, 3600.0)
        np.testing.assert_allclose(hour.sum(axis=1), 1.0)
        np.testing.assert_allclose(hour @ hour, floor.transition(name, 7200.0), atol=1e-12)
        np.testing.assert_allclose(floor.transition(name, 1.0), np.eye(len(rates)) + rates, atol=1e-6)
        self.expect_error("bad_input", 3, floor.transition, name, -1.0)
        self.expect_error("not_found", 6, floor.transition, "none", 1.0)

    def test_areas_and_versions_are_those_of_the_store(self):
        self.assertEqual(self.store.areas(), [{"area": "floor", "published": 1, "versions": 1}])
        (version,) = self.store.versions("floor")
        (listed,) = self.of_store("versions")["versions"]
        for key in ("version", "parent", "content_hash", "published"):
            self.assertEqual(version[key], listed[key])

    def test_a_track_is_the_map_at_each_time(self):
        floor = self.store.load("floor")
        name = floor.signatures[np.flatnonzero(floor.modes == 2)[0]]
        times = [self.at - 3600.0, self.at, self.at + 86400.0]
        history = self.store.history("floor", name, track=times, at=max(times))
        self.assertEqual(history.track.shape, (3, len(history.modes)))
        for row, at in zip(history.track, times):
            then = self.store.load("floor", at=at)
            mine = then.signatures == name
            np.testing.assert_allclose(row[1:], then.probabilities[mine], atol=1e-9)
        np.testing.assert_allclose(history.track.sum(axis=1), 1.0)
        self.assertTrue((np.diff(history.visits["begin_ns"]) >= 0).all())

    def test_visits_are_those_of_the_runs(self):
        floor = self.store.load("floor")
        name = floor.landmarks[0]
        visits = self.store.history("floor", name).visits
        self.assertEqual(len({len(column) for column in visits.values()}), 1)
        self.assertEqual(set(visits["run_name"]), {"run_000", "run_001", "run_002"})
        for run, vehicle in zip(visits["run_name"], visits["vehicle"]):
            log = shiftmap.read_run_log(str(self.world / f"{run}.mcap"))
            self.assertEqual(vehicle, log.vehicle)
            seen = log.observations_ns[log.signatures == name]
            counted = visits["observations"][visits["run_name"] == run].sum()
            self.assertLessEqual(counted, len(seen))
            self.assertGreaterEqual(counted, 0.8 * len(seen))
        self.assertTrue((visits["version"] == 1).all())
        self.assertTrue(visits["mapped"].all())

    def test_a_replay_says_what_the_localizer_says(self):
        tum = self.world / "shift.tum"
        said = run("shiftmap-localizer", "run", "--store", self.path, "--area", "floor",
                   "--trajectory", tum, self.log)
        replay = shiftmap.replay(self.store.load("floor", at=self.at), str(self.log))
        rows = np.loadtxt(tum)
        self.assertEqual(len(replay.poses), len(rows))
        np.testing.assert_allclose(replay.stamps_ns * 1e-9, rows[:, 0], atol=1e-6)
        np.testing.assert_allclose(replay.poses[:, :2], rows[:, 1:3], atol=1e-6)
        np.testing.assert_allclose(
            np.sin(replay.poses[:, 2] - 2.0 * np.arctan2(rows[:, 6], rows[:, 7])), 0.0, atol=1e-6)
        self.assertEqual(list(replay.decisions["signature"]),
                         [decision["signature"] for decision in said["decisions"]])
        self.assertEqual(list(replay.decisions["mode"]),
                         [decision["mode"] for decision in said["decisions"]])
        self.assertEqual(list(replay.state_changes["to"]),
                         [change["to"] for change in said["state_changes"]])
        for state, seconds in said["states"].items():
            self.assertAlmostEqual(replay.seconds_in_state[state], seconds, places=6)
        for group in said["mode_probabilities"]:
            np.testing.assert_allclose(replay.mode_probabilities[group["signature"]],
                                       list(group["probabilities"].values()), atol=1e-6)
        self.assertEqual(replay.localized, said["localized"])
        innovations = replay.innovations
        nis = np.einsum("ni,nij,nj->n", innovations["nu"], np.linalg.inv(innovations["S"]),
                        innovations["nu"])
        np.testing.assert_allclose(innovations["nis"], nis, rtol=1e-6)
        self.assertEqual(replay.covariances.shape, (len(rows), 3, 3))
        self.assertEqual(len(replay.states), len(replay.quality))

    def test_a_log_as_arrays_agrees_with_the_truth(self):
        log = shiftmap.read_run_log(str(self.log))
        truth = np.loadtxt(self.world / "run_003.truth.tum")
        driven = np.hypot(*np.diff(truth[:, 1:3], axis=0).T).sum()
        elapsed = np.diff(log.odometry_ns) * 1e-9
        self.assertAlmostEqual(np.abs(log.odometry[:-1, 0]) @ elapsed, driven, delta=0.05 * driven)
        with open(self.world / "run_003.places.csv") as file:
            places = {row["signature"]: (float(row["x_m"]), float(row["y_m"]))
                      for row in csv.DictReader(file)}
        errors = []
        for stamp, name, p in zip(log.observations_ns, log.signatures, log.positions):
            if name not in places:
                continue
            row = truth[np.abs(truth[:, 0] - stamp * 1e-9).argmin()]
            yaw = 2.0 * np.arctan2(row[6], row[7])
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            errors.append(np.linalg.norm(row[1:3] + turn @ p - places[name]))
        self.assertGreater(len(errors), 100)
        self.assertLess(np.median(errors), 0.5)
        self.assertEqual(log.sha256, hashlib.sha256(self.log.read_bytes()).hexdigest())
        self.assertEqual((log.vehicle, log.truncation), ("vehicle-2", ""))

    def test_errors_have_a_category(self):
        self.expect_error("not_found", 6, shiftmap.Store, str(self.world / "none.db"))
        self.expect_error("bad_input", 3, shiftmap.Store, str(self.log))
        self.expect_error("not_found", 6, self.store.load, "roof")
        self.expect_error("not_found", 6, self.store.load, "floor", version=9)
        self.expect_error("bad_input", 3, self.store.load, "floor", at=float("nan"))
        self.expect_error("bad_input", 3, self.store.load, "floor", at=1e300)
        self.expect_error("not_found", 6, self.store.history, "floor", "none")
        self.expect_error("bad_input", 3, shiftmap.read_run_log, str(self.path))
        floor = self.store.load("floor")
        self.expect_error("bad_input", 3, shiftmap.replay, floor, str(self.log), alpha=2.0)
        self.expect_error("bad_input", 3, shiftmap.replay, floor, str(self.log), max_leaves=0)
        self.expect_error("bad_input", 3, shiftmap.replay, floor, str(self.log),
                          initial_pose=(float("inf"), 0.0, 0.0))
        with self.assertRaises(TypeError):
            self.store.load(3)

    def test_damaged_files_give_an_error_or_arrays(self):
        chance = random.Random(4)
        damaged = self.world / "damaged"
        calls = {
            self.path: lambda path: shiftmap.Store(path).load("floor").probabilities,
            self.log: lambda path: shiftmap.read_run_log(path).positions,
        }
        errors = 0
        for source, call in calls.items():
            good = source.read_bytes()
            for _ in range(40):
                data = bytearray(good)
                for _ in range(chance.choice([1, 20, 500])):
                    data[chance.randrange(len(data))] = chance.randrange(256)
                damaged.write_bytes(data[: chance.choice([len(data), chance.randrange(len(data))])])
                try:
                    call(str(damaged))
                except shiftmap.ShiftmapError as error:
                    self.assertIn(error.category, ("bad_input", "not_found"))
                    errors += 1
        self.assertGreater(errors, 40)

    def test_hostile_names_stay_as_they_are_and_errors_stay_one_line(self):
        survey = self.world / "survey.csv"
        survey.write_text("signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\n"
                          f'"{HOSTILE}",1,1,2,0.1,0.1,0.9\n')
        path = self.world / "hostile.db"
        run("shiftmap-mapper", "import", survey, "--store", path, "--area", HOSTILE)
        store = shiftmap.Store(str(path))
        map_ = store.load(HOSTILE)
        self.assertEqual(list(map_.signatures), [HOSTILE])
        self.assertEqual(store.areas()[0]["area"], HOSTILE)
        message = self.expect_error("not_found", 6, store.load, HOSTILE, version=7)
        self.assertFalse(re.search("[\x00-\x1f\x7f-\x9f]", message))

    def test_reading_changes_nothing(self):
        before = {file: file.read_bytes() for file in self.world.iterdir() if file.is_file()}
        store = shiftmap.Store(str(self.path))
        store.load("floor")
        store.trajectories("floor", 1)
        after = {file: file.read_bytes() for file in self.world.iterdir() if file.is_file()}
        self.assertEqual(before, after)

    def test_a_snapshot_is_a_store_too(self):
        path = self.world / "snapshot.db"
        self.of_store("export", "--snapshot", "--output", path)
        at = time.time()
        snapshot = shiftmap.Store(str(path)).load("floor", at=at)
        expected = self.store.load("floor", at=at)
        self.assertEqual(snapshot.content_hash, expected.content_hash)
        np.testing.assert_allclose(snapshot.probabilities, expected.probabilities, atol=1e-9)
        self.expect_error("bad_input", 3, shiftmap.Store(str(path)).load, "floor", known=at)

    def test_what_was_known_before_a_version_is_nothing(self):
        self.expect_error("not_found", 6, self.store.load, "floor", known=1.0)
        at = time.time() + 1.0
        np.testing.assert_array_equal(self.store.load("floor", known=at, at=at).probabilities,
                                      self.store.load("floor", at=at).probabilities)

    def test_trajectories_are_those_of_the_runs(self):
        runs = self.store.trajectories("floor", 1)
        self.assertEqual(sorted(runs), ["run_000", "run_001", "run_002"])
        folder = self.world / "tracks"
        self.of_store("export", "--tum", "--output", folder)
        for name, (stamps_ns, poses) in runs.items():
            rows = np.loadtxt(folder / f"{name}.tum")
            np.testing.assert_allclose(poses[:, :2], rows[:, 1:3])
            np.testing.assert_allclose(stamps_ns * 1e-9, rows[:, 0], atol=1e-6)

    def test_threads_share_a_store(self):
        expected = self.store.load("floor", at=self.at).probabilities
        results = []

        def load():
            for _ in range(10):
                results.append(self.store.load("floor", at=self.at).probabilities)

        threads = [threading.Thread(target=load) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(results), 40)
        for probabilities in results:
            np.testing.assert_array_equal(probabilities, expected)

    def test_other_threads_run_during_a_replay(self):
        floor = self.store.load("floor", at=self.at)
        count = 0
        done = False

        def tick():
            nonlocal count
            while not done:
                count += 1
                time.sleep(0)  # Lets the others run.

        thread = threading.Thread(target=tick)
        interval = sys.getswitchinterval()
        # From here on a thread runs only while the others let it.
        sys.setswitchinterval(1000.0)
        try:
            thread.start()
            moved = False
            for _ in range(20):
                before = count
                shiftmap.replay(floor, str(self.log))
                moved = moved or count > before
            self.assertTrue(moved)
        finally:
            done = True
            sys.setswitchinterval(interval)
            thread.join()

    def test_the_example_prints_what_it_says(self):
        printed = subprocess.run([sys.executable, str(EXAMPLE), str(self.world)], check=True,
                                 capture_output=True, text=True).stdout
        self.assertEqual(printed, EXPECTED.read_text())


class Stubs(unittest.TestCase):
    """The stubs and the module have the same names and arguments."""

    @classmethod
    def setUpClass(cls):
        stub = pathlib.Path(shiftmap.__file__).with_name("__init__.pyi")
        cls.tree = ast.parse(stub.read_text())

    @staticmethod
    def arguments_of(function):
        """Names of arguments as the first line of the documentation of a function has them."""
        signature = function.__doc__.splitlines()[0]
        return re.findall(r"[(,] ?(\w+):", signature)

    def test_every_public_name_has_a_stub(self):
        stubbed = {node.name for node in self.tree.body
                   if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name[0] != "_"}
        self.assertEqual(stubbed | {"__version__"}, set(shiftmap.__all__))

    def test_classes_have_the_members_of_their_stubs(self):
        for node in self.tree.body:
            if not isinstance(node, ast.ClassDef) or node.name[0] == "_":
                continue
            if node.name == "ShiftmapError":
                continue
            with self.subTest(node.name):
                class_ = getattr(shiftmap, node.name)
                stubbed = {member.name: member for member in node.body}
                actual = {name: value for name, value in vars(class_).items()
                          if name[0] != "_" or name == "__len__"}
                self.assertEqual({name for name in stubbed if name != "__init__"}, set(actual))
                for name, member in stubbed.items():
                    if any(getattr(d, "id", "") == "property" for d in member.decorator_list):
                        self.assertIsInstance(actual[name], property)
                        continue
                    names = [argument.arg for argument in member.args.args]
                    self.assertEqual(self.arguments_of(getattr(class_, name)), names, name)

    def test_functions_have_the_arguments_and_defaults_of_their_stubs(self):
        for node in self.tree.body:
            if not isinstance(node, ast.FunctionDef):
                continue
            function = getattr(shiftmap, node.name)
            self.assertEqual(self.arguments_of(function),
                             [argument.arg for argument in node.args.args])
            for default in node.args.defaults:
                self.assertIn(f"= {ast.unparse(default)}", function.__doc__)

    def test_everything_is_documented(self):
        for name in shiftmap.__all__:
            if name != "__version__":
                self.assertTrue(inspect.getdoc(getattr(shiftmap, name)), name)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[4:])
