#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes a SQLite file of a ROS 2 bag, in the schema of a distribution.

Usage: write_db3.py FILE humble|iron|jazzy, with lines on standard input, fields between tabs:
`topic NAME TYPE DEFINITION` and `message NAME TIME DATA`, definition and data in hexadecimal.
"""

import sqlite3
import sys


def create(db, distro):
    db.execute("PRAGMA journal_mode=WAL")
    db.execute("CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)")
    db.execute("CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, "
               "metadata TEXT NOT NULL)")
    hashed = "" if distro == "humble" else ", type_description_hash TEXT NOT NULL"
    db.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
               f"serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL{hashed})")
    if hashed:
        db.execute("CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT "
                   "NULL, encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL, "
                   "type_description_hash TEXT NOT NULL)")
    db.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
               "timestamp INTEGER NOT NULL, data BLOB NOT NULL)")
    db.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    db.execute("INSERT INTO schema VALUES (?, ?)", (3 if distro == "humble" else 4, distro))
    return bool(hashed)


def main():
    path, distro = sys.argv[1:]
    db = sqlite3.connect(path)
    defined = create(db, distro)
    topics = {}
    for line in sys.stdin:
        kind, name, second, third = line.rstrip("\n").split("\t")
        if kind == "message":
            db.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
                       (topics[name], int(second), bytes.fromhex(third)))
            continue
        topics[name] = len(topics) + 1
        row = (topics[name], name, second, "cdr", "")
        db.execute(f"INSERT INTO topics VALUES ({','.join('?' * (5 + defined))})",
                   row + ("",) * defined)
        if defined:
            text = bytes.fromhex(third).decode()
            db.execute("INSERT INTO message_definitions (topic_type, encoding, "
                       "encoded_message_definition, type_description_hash) VALUES (?, ?, ?, '')",
                       (second, "ros2msg", text))
    db.commit()
    db.close()


if __name__ == "__main__":
    main()
