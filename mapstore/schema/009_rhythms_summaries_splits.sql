-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 9: the rates of a chain may depend on the hour of the day or of the week. Rows of the
-- ledger that say the same may be summed up in one. A mode can be split into two.
-- Units as in 001_init.sql.

PRAGMA user_version = 9;

-- The rhythm of a group's chain, if it has one; its rates of all hours together are in
-- landmark_group and mode_rate.
CREATE TABLE mode_rhythm (
  version_id  INTEGER NOT NULL REFERENCES version,
  group_index INTEGER NOT NULL,
  period_s    INTEGER NOT NULL,  -- 86400, a day, or 604800, a week from Monday; UTC
  phase       INTEGER NOT NULL,  -- from 0; the period has as many equal parts as there are rows
  -- Rates from each state to each other one, by rows, IEEE 754 [1/s]. The states are 'absent' and
  -- the group's modes.
  rates       BLOB NOT NULL,
  PRIMARY KEY (version_id, group_index, phase)
) STRICT, WITHOUT ROWID;

-- Which rows of visit_evidence and mapped_evidence stand for several visits that said the same of a
-- landmark, the first of which began and the last of which ended when the row does. The row has the
-- log-likelihoods of the least sure one, and is of the report or run of the first one.
CREATE TABLE ledger_summary (
  area_id    INTEGER NOT NULL REFERENCES area,
  begin_ns   INTEGER NOT NULL,
  end_ns     INTEGER NOT NULL,
  report_id  INTEGER NOT NULL,  -- 0: of the version
  version_id INTEGER NOT NULL,
  run_id     INTEGER NOT NULL,  -- and the run; else 0
  signature  TEXT NOT NULL,
  visits     INTEGER NOT NULL,  -- at least 2
  steps      INTEGER NOT NULL,  -- as many equal gaps tell of rates what those of the visits do
  gap_s      REAL NOT NULL,     -- sum of the times between successive visits
  PRIMARY KEY (area_id, begin_ns, end_ns, report_id, version_id, run_id, signature)
) STRICT, WITHOUT ROWID;

-- Of an edit of kind 'split': 'mode' stays at (x_m, y_m), 'into_mode' is made at the second place;
-- sd_m is of both.
ALTER TABLE map_edit ADD COLUMN second_x_m REAL NOT NULL DEFAULT 0;
ALTER TABLE map_edit ADD COLUMN second_y_m REAL NOT NULL DEFAULT 0;

-- The runs of which the author of a split says at which of the two places they met the landmark.
-- What other runs told of the mode before counts for both.
CREATE TABLE split_run (
  edit_id INTEGER NOT NULL REFERENCES map_edit,
  run     TEXT NOT NULL,     -- run.identity, or shift_report.identity without a log
  second  INTEGER NOT NULL,  -- 1: at the second place, 0: at the first
  PRIMARY KEY (edit_id, run)
) STRICT, WITHOUT ROWID;
