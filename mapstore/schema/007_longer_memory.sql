-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 7: what was known at a time can be asked for later. An exclusion that is taken back stays,
-- with its end; `audit` has the publications. A run may be held instead of excluded. From where runs
-- saw landmarks is kept.
-- Units as in 001_init.sql.

PRAGMA user_version = 7;

-- What an operator took out of an area's memory: a run, or the runs of a vehicle.
ALTER TABLE exclusion RENAME TO exclusion_of_schema_6;
CREATE TABLE exclusion (
  exclusion_id INTEGER PRIMARY KEY,
  area_id      INTEGER NOT NULL REFERENCES area,
  run          TEXT NOT NULL,     -- run.identity, or shift_report.identity without a log; or empty
  vehicle      TEXT NOT NULL,     -- empty if it is about a run
  since_ns     INTEGER NOT NULL,  -- of a vehicle: runs that begin then or later; else 0
  held         INTEGER NOT NULL,  -- 1: until somebody decides; versions that mapped it stay good
  reason       TEXT NOT NULL,
  excluded_ns  INTEGER NOT NULL,  -- clock of the machine that wrote
  included_ns  INTEGER            -- when it was taken back; NULL while it holds
) STRICT;
INSERT INTO exclusion (area_id, run, vehicle, since_ns, held, reason, excluded_ns)
  SELECT area_id, run, vehicle, since_ns, 0, reason, excluded_ns FROM exclusion_of_schema_6
  ORDER BY excluded_ns;
DROP TABLE exclusion_of_schema_6;
CREATE UNIQUE INDEX exclusion_that_holds ON exclusion (area_id, run, vehicle)
  WHERE included_ns IS NULL;

-- The scans of a mapped run that had a landmark well in view while it stood at a mode of the version,
-- by the direction from the landmark to the vehicle in the map frame.
CREATE TABLE mapped_visibility (
  version_id INTEGER NOT NULL REFERENCES version,
  run_id     INTEGER NOT NULL REFERENCES run,
  signature  TEXT NOT NULL,
  mode       INTEGER NOT NULL,
  -- Per eighth of a turn from -180 degrees on, 16 bytes: scans that saw it, scans that did not.
  scans      BLOB NOT NULL,
  PRIMARY KEY (version_id, run_id, signature, mode)
) STRICT, WITHOUT ROWID;
