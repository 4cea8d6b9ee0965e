-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 4: the ledger is the only memory. What visits of mapped runs say is in it, as what shifts
-- report is, and the probabilities of a version are derived from it. Probabilities that somebody
-- claims, for a time, are a statement. Units as in 001_init.sql.

PRAGMA user_version = 4;

-- Probabilities that an import, or the build of an older schema, states: at version.stamp_ns, before
-- any report. A version without rows has derived ones.
CREATE TABLE stated_probability (
  version_id  INTEGER NOT NULL REFERENCES version,
  signature   TEXT NOT NULL,
  mode        INTEGER NOT NULL,  -- mode number, 0 is 'absent'
  probability REAL NOT NULL,
  PRIMARY KEY (version_id, signature, mode)
) STRICT, WITHOUT ROWID;
INSERT INTO stated_probability
  SELECT version_id, signature, 0, absent_probability FROM landmark_group;
INSERT INTO stated_probability
  SELECT version_id, signature, number, probability
  FROM mode JOIN landmark_group USING (version_id, group_index);
ALTER TABLE landmark_group DROP COLUMN absent_probability;
ALTER TABLE mode DROP COLUMN probability;

-- The version whose statement holds for this one: itself, or the nearest ancestor that makes one;
-- NULL if none does. ledger_position tells what a version that makes one accounts for.
ALTER TABLE version ADD COLUMN statement_version_id INTEGER REFERENCES version;
UPDATE version SET statement_version_id = version_id;

-- What the visits of a mapped run say, by the version that maps it: as visit_evidence.
CREATE TABLE mapped_evidence (
  area_id           INTEGER NOT NULL,
  begin_ns          INTEGER NOT NULL,
  end_ns            INTEGER NOT NULL,
  version_id        INTEGER NOT NULL REFERENCES version,
  run_id            INTEGER NOT NULL REFERENCES run,
  signature         TEXT NOT NULL,
  observation_count INTEGER NOT NULL,
  log_likelihoods   BLOB NOT NULL,
  PRIMARY KEY (area_id, begin_ns, end_ns, version_id, run_id, signature)
) STRICT, WITHOUT ROWID;

-- What an operator took out of an area's memory: a run, or the runs of a vehicle. It is deleted when
-- it is taken back; `audit` tells of both.
CREATE TABLE exclusion (
  area_id     INTEGER NOT NULL REFERENCES area,
  run         TEXT NOT NULL,     -- SHA-256 of the log, or UUID of a report without one; or empty
  vehicle     TEXT NOT NULL,     -- empty if it is about a run
  since_ns    INTEGER NOT NULL,  -- of a vehicle: runs that begin then or later; else 0
  reason      TEXT NOT NULL,
  excluded_ns INTEGER NOT NULL,  -- clock of the machine that wrote
  PRIMARY KEY (area_id, run, vehicle)
) STRICT, WITHOUT ROWID;

-- A report is about a run of its vehicle: one about another vehicle's log stands for itself.
UPDATE shift_report SET superseded = 0;
UPDATE shift_report SET superseded = 1
WHERE run_hash <> '' AND EXISTS (
  SELECT 1 FROM shift_report o
  JOIN version ov ON ov.version_id = o.version_id
  JOIN version v ON v.version_id = shift_report.version_id
  WHERE o.run_hash = shift_report.run_hash AND o.vehicle = shift_report.vehicle
    AND ov.area_id = v.area_id AND (ov.number, o.uuid) < (v.number, shift_report.uuid));

-- Whether a report counts is looked up report by report.
DROP INDEX shift_report_position;
DROP INDEX shift_report_superseded;

-- Filtered in another way.
DELETE FROM ledger_checkpoint;
UPDATE area SET rows_since_checkpoint =
  (SELECT count(*) FROM visit_evidence e WHERE e.area_id = area.area_id);
