#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Example of a vehicle's VDA 5050 3.0 client that merges what the localizer knows.

It takes the instant actions on maps and pose from an MQTT broker, hands each to
`shiftmap-localizer ctl`, and publishes the state message. A vehicle's own client has the order,
the drive and the battery; here they are constants.
"""

import argparse
import datetime
import json
import queue
import subprocess

import paho.mqtt.client as mqtt

VERSION = "3.0.0"

# What the vehicle's own software knows.
VEHICLE = {
    "orderId": "",
    "orderUpdateId": 0,
    "lastNodeId": "",
    "lastNodeSequenceId": 0,
    "nodeStates": [],
    "edgeStates": [],
    "driving": False,
    "actionStates": [],
    "powerSupply": {"stateOfCharge": 100.0, "charging": False},
    "operatingMode": "AUTOMATIC",
    "safetyState": {"activeEmergencyStop": "NONE", "fieldViolation": False},
}


class Localizer:
    """The service behind a socket."""

    def __init__(self, program, socket):
        self.command = [program, "ctl", "--json", f"--socket={socket}"]

    def call(self, verb, *argument, **options):
        """Returns what the service says, or nothing and why."""
        words = [f"--{key.replace('_', '-')}={value}" for key, value in options.items() if value]
        run = subprocess.run(
            [*self.command, *words, "--", verb, *argument], capture_output=True, text=True
        )
        # With --json, an error is a document too.
        return (json.loads(run.stdout), "") if run.returncode == 0 else (None, run.stderr.strip())

    def act(self, action):
        """Does an instant action. Returns why it was not taken up, or nothing."""
        p = {entry["key"]: entry["value"] for entry in action.get("actionParameters", [])}
        name = {"action_id": action["actionId"], "map_id": p.get("mapId")}
        kind = action["actionType"]
        if kind == "downloadMap":
            link = str(p.get("mapDownloadLink", ""))
            name |= {"map_version": p.get("mapVersion"), "sha256": p.get("mapHash")}
            return self.call("download-map", link, **name)[1]
        if kind in ("enableMap", "deleteMap"):
            verb = kind.replace("Map", "-map")
            return self.call(verb, **name, map_version=p.get("mapVersion"))[1]
        if kind == "initializePosition":
            try:
                pose = ",".join(repr(float(p[key])) for key in ("x", "y", "theta"))
            except (KeyError, TypeError, ValueError):
                return "initializePosition needs the numbers x, y and theta"
            return self.call("initialize-position", pose, **name)[1]
        if kind == "clearInstantActions":
            return self.call("clear-actions")[1]
        return f"unknown action type {kind!r}"


class Client:
    """The vehicle's end of the broker."""

    def __init__(self, arguments):
        self.localizer = Localizer(arguments.localizer, arguments.socket)
        self.topic = f"{arguments.interface}/v3/{arguments.manufacturer}/{arguments.serial}"
        self.head = {
            "version": VERSION,
            "manufacturer": arguments.manufacturer,
            "serialNumber": arguments.serial,
        }
        self.period_s = arguments.period_s
        self.messages = queue.Queue()
        self.header_id = 0
        self.refused = {}  # Actions that never reached the localizer: their state by name.
        self.vehicle = dict(VEHICLE)
        host, port = arguments.broker.rsplit(":", 1)
        self.mqtt = mqtt.Client(client_id=f"{arguments.manufacturer}-{arguments.serial}")
        actions = self.topic + "/instantActions"
        self.mqtt.on_connect = lambda client, *_: client.subscribe(actions, 1)
        self.mqtt.on_message = lambda _client, _data, message: self.messages.put(message.payload)
        self.mqtt.connect(host, int(port))

    def take(self, payload):
        try:
            actions = json.loads(payload)["actions"]
            for action in actions:
                self.act(action)
        except (KeyError, TypeError, ValueError) as error:
            print(f"instantActions: not as the schema has it: {error!r}", flush=True)

    def act(self, action):
        why = self.localizer.act(action)
        state, _ = self.localizer.call("vda5050-state")
        known = {entry["actionId"] for entry in (state or {}).get("instantActionStates", [])}
        if action["actionType"] == "clearInstantActions":
            self.refused.clear()
            known.clear()
        if action["actionId"] not in known:
            self.refused[action["actionId"]] = {
                "actionId": action["actionId"],
                "actionType": action["actionType"],
                "actionStatus": "FAILED" if why else "FINISHED",
                "actionResult": why,
            }
        elif action["actionType"] == "initializePosition" and not why:
            parameters = {entry["key"]: entry["value"] for entry in action["actionParameters"]}
            self.vehicle["lastNodeId"] = str(parameters.get("lastNodeId", ""))

    def state(self):
        fragment, why = self.localizer.call("vda5050-state")
        if fragment is None:
            fragment = {
                "maps": [],
                "errors": [
                    {
                        "errorType": "LOCALIZATION_ERROR",
                        "errorLevel": "FATAL",
                        "errorDescription": why,
                    }
                ],
                "instantActionStates": [],
            }
        fragment["instantActionStates"] += self.refused.values()
        for refused in self.refused.values():
            if refused["actionStatus"] == "FAILED":
                fragment["errors"].append(
                    {
                        "errorType": "INVALID_INSTANT_ACTION",
                        "errorLevel": "WARNING",
                        "errorDescription": refused["actionResult"],
                        "errorReferences": [
                            {"referenceKey": "actionId", "referenceValue": refused["actionId"]}
                        ],
                    }
                )
        self.header_id += 1
        now = datetime.datetime.now(datetime.timezone.utc)
        stamp = now.isoformat(timespec="milliseconds").replace("+00:00", "Z")
        head = {"headerId": self.header_id, "timestamp": stamp, **self.head}
        return {**head, **self.vehicle, **fragment}

    def run(self):
        self.mqtt.loop_start()
        while True:
            try:
                self.take(self.messages.get(timeout=self.period_s))
            except queue.Empty:
                pass
            self.mqtt.publish(self.topic + "/state", json.dumps(self.state()))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--broker", default="127.0.0.1:1883", help="MQTT broker, HOST:PORT")
    parser.add_argument("--socket", required=True, help="Unix socket of `shiftmap-localizer serve`")
    parser.add_argument("--localizer", default="shiftmap-localizer", help="the program")
    parser.add_argument("--interface", default="uagv", help="first level of the topics")
    parser.add_argument("--manufacturer", default="shiftmap")
    parser.add_argument("--serial", default="1")
    parser.add_argument("--period-s", type=float, default=1.0, help="between two states")
    Client(parser.parse_args()).run()


if __name__ == "__main__":
    main()
