# SPDX-License-Identifier: Apache-2.0
"""The whole way of VDA 5050: broker, example client, service, downloads by HTTPS.

Usage: vda5050_test.py BIN CLIENT; exits 77, skipped, where a program or module is absent.
"""

import hashlib
import http.server
import json
import os
import queue
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import uuid

try:
    import jsonschema
    import paho.mqtt.client as mqtt
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

MOSQUITTO = shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin")
SCHEMAS = os.path.join(os.environ.get("SHIFTMAP_DATA", ""), "vda5050")
TOPIC = "uagv/v3/shiftmap/7"
DEADLINE_S = 30.0


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def schema(name):
    path = os.path.join(SCHEMAS, name)
    if not os.path.exists(path):
        return None
    with open(path, encoding="utf-8") as file:
        return jsonschema.Draft202012Validator(json.load(file))


class Maps(http.server.BaseHTTPRequestHandler):
    """Files by ranges. What begins with /cut/ ends half way, the first time; /whole/ knows none."""

    folder = ""
    cut = set()
    ranges = []

    def do_GET(self):
        cuts = self.path.startswith("/cut/") and self.path not in self.cut
        whole = "/whole/" in self.path
        path = os.path.join(self.folder, os.path.basename(self.path))
        if self.path.startswith("/plain/"):
            self.send_response(302)
            self.send_header("Location", "http://127.0.0.1:1/" + os.path.basename(path))
            self.end_headers()
            return
        if not os.path.exists(path):
            self.send_error(404)
            return
        with open(path, "rb") as file:
            body = file.read()
        begin = 0
        asked = self.headers.get("Range")
        if whole:
            asked = None
        if asked:
            self.ranges.append(asked)
            begin = int(asked.removeprefix("bytes=").split("-")[0])
        self.send_response(206 if asked else 200)
        if asked:
            self.send_header("Content-Range", f"bytes {begin}-{len(body) - 1}/{len(body)}")
        self.send_header("Content-Length", str(len(body) - begin))
        self.end_headers()
        if cuts:
            self.cut.add(self.path)
            self.wfile.write(body[begin : len(body) // 2])
            self.wfile.flush()
            self.connection.shutdown(socket.SHUT_RDWR)
            self.close_connection = True
        else:
            self.wfile.write(body[begin:])

    def log_message(self, *_):
        pass


class Site:
    """The programs of a vehicle and of its site, and what they say."""

    def __init__(self, work):
        self.work = work
        self.processes = {}
        self.states = queue.Queue()
        self.state_schema = schema("state.schema")
        self.action_schema = schema("instantActions.schema")
        self.seen = []
        if self.state_schema is None or self.action_schema is None:
            print("without the schemas: messages are not validated")

    def file(self, name):
        return os.path.join(self.work, name)

    def run(self, program, *words):
        command = [f"{BIN}/{program}", *words]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        assert run.returncode == 0, (program, words, run.stdout, run.stderr)
        return run.stdout

    def ctl(self, *words):
        options = [f"--socket={self.file('s')}", "--json"]
        return json.loads(self.run("shiftmap-localizer", "ctl", *options, *words))

    def start(self, name, *command):
        with open(self.file(name + ".log"), "ab") as log:
            self.processes[name] = subprocess.Popen(command, stdout=log, stderr=log)

    def stop(self, name, how=signal.SIGTERM):
        process = self.processes.pop(name)
        process.send_signal(how)
        process.wait(DEADLINE_S)

    def make_maps(self):
        world = self.file("world")
        self.run(
            "shiftmap-sim", "open", world, "--shifts", "3", "--groups", "15", "--modes", "2",
            "--size-m", "20", "--duration-s", "60", "--seed", "7", "--quiet",
        )
        store = ["--store", self.file("maps.db"), "--area", "floor"]
        self.names = {}
        self.hashes = {}
        for night, name in enumerate(("first.db", "second.db")):
            self.run("shiftmap-mapper", "build", *store, "--quiet", f"{world}/run_00{night}.mcap")
            export = ["export", *store, "--snapshot", "--output", self.file(name), "--json"]
            self.names[name] = json.loads(self.run("shiftmap-inspect", *export))["map_version"]
            with open(self.file(name), "rb") as file:
                self.hashes[name] = hashlib.sha256(file.read()).hexdigest()

    def certify(self, name):
        subprocess.run(
            [
                "openssl", "req", "-x509", "-nodes", "-days", "2",
                "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
                "-keyout", self.file(name + ".key"), "-out", self.file(name + ".pem"),
                "-subj", "/CN=maps", "-addext", "subjectAltName=IP:127.0.0.1",
            ],
            check=True,
            capture_output=True,
        )

    def serve_maps(self):
        self.certify("ca")
        self.certify("others")
        Maps.folder = self.work
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Maps)
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(self.file("ca.pem"), self.file("ca.key"))
        server.socket = tls.wrap_socket(server.socket, server_side=True)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.link = f"https://127.0.0.1:{server.server_address[1]}"

    def start_all(self):
        port = free_port()
        with open(self.file("mosquitto.conf"), "w", encoding="utf-8") as conf:
            conf.write(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
        self.start("mosquitto", MOSQUITTO, "-c", self.file("mosquitto.conf"))
        self.start_serve()
        self.start_sync("ca.pem")
        self.mqtt = mqtt.Client()
        self.mqtt.on_connect = lambda client, *_: client.subscribe(TOPIC + "/state")
        self.mqtt.on_message = lambda _c, _d, message: self.states.put(json.loads(message.payload))
        until = time.monotonic() + DEADLINE_S
        while True:
            try:
                self.mqtt.connect("127.0.0.1", port)
                break
            except OSError:
                assert time.monotonic() < until, "no broker"
                time.sleep(0.05)
        self.mqtt.loop_start()
        self.start(
            "client", sys.executable, CLIENT, "--broker", f"127.0.0.1:{port}",
            "--socket", self.file("s"), "--localizer", f"{BIN}/shiftmap-localizer",
            "--serial", "7", "--period-s", "0.1",
        )
        self.wait(lambda state: True)

    def start_serve(self):
        self.start(
            "serve", f"{BIN}/shiftmap-localizer", "serve", "--maps", self.file("maps"),
            "--area", "floor", "--socket", self.file("s"), "--state-dir", self.file("state"),
            "--start", "--max-delay-s", "0", "--map-source", "vda5050",
        )

    def start_sync(self, authority):
        self.start(
            "sync", f"{BIN}/shiftmap-transfer", "sync", "--map-source", "vda5050",
            "--maps", self.file("maps"), "--socket", self.file("s"),
            "--state-dir", self.file("state"), "--outbox", self.file("outbox"),
            "--map-ca", self.file(authority), "--give-up-s", "2",
        )
        # Until serve takes a download of it: one that fails at once, by its link.
        until = time.monotonic() + DEADLINE_S
        while True:
            words = ["download-map", "--map-id=floor", "--map-version=1-0-0", "file:///x"]
            command = [f"{BIN}/shiftmap-localizer", "ctl", f"--socket={self.file('s')}", *words]
            run = subprocess.run(command, capture_output=True, text=True, check=False)
            if run.returncode == 0:
                break
            assert time.monotonic() < until, run.stderr
            time.sleep(0.05)

    def wait(self, condition):
        until = time.monotonic() + DEADLINE_S
        while time.monotonic() < until:
            try:
                state = self.states.get(timeout=1.0)
            except queue.Empty:
                continue
            if self.state_schema:
                self.state_schema.validate(state)
            self.seen.append(state)
            if condition(state):
                return state
        raise AssertionError(f"in vain: {json.dumps(self.seen[-1:], indent=1)}")

    def tell(self, kind, **parameters):
        """Publishes an instant action; returns its name."""
        name = str(uuid.uuid4())
        message = {
            "headerId": 1,
            "timestamp": "2026-01-02T03:04:05.678Z",
            "version": "3.0.0",
            "manufacturer": "shiftmap",
            "serialNumber": "7",
            "actions": [{
                "actionId": name,
                "actionType": kind,
                "blockingType": "NONE",
                "actionParameters": [{"key": k, "value": v} for k, v in parameters.items()],
            }],
        }
        if self.action_schema:
            self.action_schema.validate(message)
        self.mqtt.publish(TOPIC + "/instantActions", json.dumps(message), qos=1)
        return name

    def ended(self, name):
        """The state in which an action has ended, and the action."""
        def is_ended(state):
            return action_of(state, name).get("actionStatus") in ("FINISHED", "FAILED")
        state = self.wait(is_ended)
        return state, action_of(state, name)

    def download(self, name, link, **more):
        return self.ended(
            self.tell(
                "downloadMap",
                mapId="floor",
                mapVersion=self.names[name],
                mapDownloadLink=link,
                **more,
            )
        )

    def close(self):
        for name in list(self.processes):
            self.stop(name)


def action_of(state, name):
    return next((a for a in state["instantActionStates"] if a["actionId"] == name), {})


def maps_of(state):
    return {entry["mapVersion"]: entry["mapStatus"] for entry in state["maps"]}


def errors_of(state):
    return {(error["errorType"], error["errorLevel"]) for error in state["errors"]}


class Vda5050Test(unittest.TestCase):
    def test_fleet_control_brings_maps_to_a_vehicle_and_sets_its_pose(self):
        site = self.site
        first, second = site.names["first.db"], site.names["second.db"]
        state = site.wait(lambda _: True)
        self.assertEqual(state["maps"], [])
        self.assertIn(("LOCALIZATION_ERROR", "FATAL"), errors_of(state))
        self.assertFalse(state["mobileRobotPosition"]["localized"])

        # What is no map, or not to be had, says why and leaves no map.
        for link, text in (
            ("file://" + site.file("first.db"), "https"),
            ("http://127.0.0.1:1/first.db", "https"),
            (site.link + "/plain/first.db", "https"),
            (site.link + "/none.db", "404"),
            (site.link + "/second.db", "expected"),
            ("https://127.0.0.1:1/first.db", "onnect"),
        ):
            state, action = site.download("first.db", link)
            self.assertEqual(action["actionStatus"], "FAILED", link)
            self.assertIn(text, action["actionResult"], link)
            self.assertEqual(state["maps"], [], link)
            self.assertIn(("INSTANT_ACTION_FAILED", "WARNING"), errors_of(state))
        _, action = site.download("first.db", site.link + "/first.db", mapHash="0" * 64)
        self.assertEqual(action["actionStatus"], "FAILED")
        self.assertIn("hash", action["actionResult"])

        # Cut half way, it goes on from there; no other map changes.
        Maps.ranges.clear()
        sha256 = site.hashes["first.db"]
        state, action = site.download("first.db", site.link + "/cut/first.db", mapHash=sha256)
        self.assertEqual(action["actionStatus"], "FINISHED", action)
        self.assertEqual(maps_of(state), {first: "DISABLED"})
        size = os.path.getsize(site.file("first.db"))
        self.assertEqual(len(Maps.ranges), 1)
        self.assertGreater(int(Maps.ranges[0].removeprefix("bytes=").rstrip("-")), size // 4)
        state, action = site.download("first.db", site.link + "/first.db")
        self.assertEqual(action["actionStatus"], "FAILED")
        self.assertIn(("DUPLICATE_MAP", "WARNING"), errors_of(state))

        # Enabled, the service begins its shift on it.
        state, action = site.ended(site.tell("enableMap", mapId="floor", mapVersion=first))
        self.assertEqual(action["actionStatus"], "FINISHED", action)
        self.assertEqual(maps_of(state), {first: "ENABLED"})
        self.assertNotIn(("DUPLICATE_MAP", "WARNING"), errors_of(state))
        site.ctl("feed", site.file("world/run_002.mcap"))
        state = site.wait(lambda s: s["mobileRobotPosition"]["localized"])
        position = state["mobileRobotPosition"]
        self.assertEqual(position["mapId"], "floor")
        self.assertGreater(position["deviationRange"], 0.0)
        self.assertLess(position["deviationRange"], 1.0)
        self.assertNotIn(("LOCALIZATION_ERROR", "FATAL"), errors_of(state))

        # Another version waits while the vehicle drives, and is taken once the shift ends.
        _, action = site.download("second.db", site.link + "/cut/whole/second.db")
        self.assertEqual(action["actionStatus"], "FINISHED", action)
        name = site.tell("enableMap", mapId="floor", mapVersion=second)
        state = site.wait(lambda s: action_of(s, name).get("actionStatus") == "WAITING")
        self.assertEqual(maps_of(state), {first: "ENABLED", second: "DISABLED"})
        _, action = site.ended(site.tell("deleteMap", mapId="floor", mapVersion=first))
        self.assertEqual(action["actionStatus"], "FAILED")
        site.ctl("stop")
        state, action = site.ended(name)
        self.assertEqual(action["actionStatus"], "FINISHED")
        self.assertEqual(maps_of(state), {first: "DISABLED", second: "ENABLED"})
        state, action = site.ended(site.tell("deleteMap", mapId="floor", mapVersion=first))
        self.assertEqual(action["actionStatus"], "FINISHED", action)
        self.assertEqual(maps_of(state), {second: "ENABLED"})

        # A pose, on a map that is here and on one that is not; names that obey nobody.
        site.ctl("start")
        hostile = "--version\x1b[31m$(reboot)<script>"
        state, action = site.ended(
            site.tell("initializePosition", x=1.0, y=2.0, theta=0.5, mapId=hostile, lastNodeId="n")
        )
        self.assertEqual(action["actionStatus"], "FAILED")
        self.assertIn(("UNKNOWN_MAP_ID", "WARNING"), errors_of(state))
        state, action = site.ended(
            site.tell(
                "initializePosition", x=-1.0, y=2.0, theta=0.5, mapId="floor", lastNodeId="n7"
            )
        )
        self.assertEqual(action["actionStatus"], "FINISHED", action)
        site.wait(lambda s: s["lastNodeId"] == "n7")
        no_pose = {"x": "one", "mapId": "floor"}
        for kind, parameters in (("reboot", {}), ("initializePosition", no_pose)):
            state, action = site.ended(site.tell(kind, **parameters))
            self.assertEqual(action["actionStatus"], "FAILED", kind)
            self.assertIn(("INVALID_INSTANT_ACTION", "WARNING"), errors_of(state))

        # Actions are remembered over a restart, until somebody clears them. A download fails
        # without a downloader, and with another authority.
        time.sleep(1.5)  # Within a second they are on disk.
        site.stop("serve", signal.SIGKILL)
        site.start_serve()
        site.wait(lambda s: action_of(s, name).get("actionStatus") == "FINISHED" and s["maps"])
        site.stop("sync")
        _, action = site.download("first.db", site.link + "/first.db")
        self.assertIn("downloader", action["actionResult"])
        site.start_sync("others.pem")
        _, action = site.download("first.db", site.link + "/first.db")
        self.assertEqual(action["actionStatus"], "FAILED")
        self.assertIn("certificate", action["actionResult"])
        site.tell("clearInstantActions")
        site.wait(lambda s: not action_of(s, name))

        statuses = {a["actionStatus"] for s in site.seen for a in s["instantActionStates"]}
        self.assertGreaterEqual(statuses, {"WAITING", "FINISHED", "FAILED"})

    def setUp(self):
        self.work = tempfile.TemporaryDirectory()
        self.site = Site(self.work.name)
        self.addCleanup(self.work.cleanup)
        self.addCleanup(self.site.close)
        self.site.make_maps()
        self.site.serve_maps()
        self.site.start_all()


if __name__ == "__main__":
    BIN, CLIENT = sys.argv[1:3]
    for program in (MOSQUITTO, shutil.which("openssl")):
        if program is None:
            print("skipped: no mosquitto or openssl")
            sys.exit(77)
    unittest.main(argv=sys.argv[:1])
