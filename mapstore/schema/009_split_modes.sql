-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 9: a mode can be split into two. Units as in 001_init.sql.

PRAGMA user_version = 9;

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
