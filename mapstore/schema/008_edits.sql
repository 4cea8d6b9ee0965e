-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 8: what a surveyor edits in a map is a row of its own, and can be taken back.
-- Units as in 001_init.sql.

PRAGMA user_version = 8;

-- A prior statement of a person about a landmark or a vehicle. Columns that its kind does not use
-- are empty, or 0.
CREATE TABLE map_edit (
  edit_id      INTEGER PRIMARY KEY,
  area_id      INTEGER NOT NULL REFERENCES area,
  kind         TEXT NOT NULL,     -- 'position', 'new_mode', 'control', 'retire', 'rename', 'merge',
                                  -- 'rate' or 'calibration'
  author       TEXT NOT NULL,
  reason       TEXT NOT NULL,
  made_ns      INTEGER NOT NULL,  -- clock of the machine that wrote
  signature    TEXT NOT NULL,     -- the landmark, by its name then
  landmark     TEXT NOT NULL,     -- the same by its name before all renames that held then
  mode         INTEGER NOT NULL,  -- 'position', 'new_mode', 'control'; of 'merge' the one that goes
  into_mode    INTEGER NOT NULL,  -- 'merge': the mode that stands for it
  new_name     TEXT NOT NULL,     -- 'rename'
  x_m          REAL NOT NULL,     -- 'position', 'new_mode', 'control'
  y_m          REAL NOT NULL,
  sd_m         REAL NOT NULL,     -- per axis
  rate_per_s   REAL NOT NULL,     -- 'rate'
  weight       REAL NOT NULL,     -- 'rate': jumps that it counts as
  evidence_s   REAL NOT NULL,     -- 'rate': time that the ledger told of the landmark then
  vehicle      TEXT NOT NULL,     -- 'calibration'
  since_ns     INTEGER NOT NULL,  -- 'calibration': what runs tell that end then or later is forgotten
  kept_version_id INTEGER REFERENCES version,  -- 'calibration': whose values hold instead, or NULL
  undone_ns    INTEGER,           -- when it was taken back; NULL while it is in force
  undone_by    TEXT NOT NULL,
  undo_reason  TEXT NOT NULL
) STRICT;
CREATE INDEX map_edit_area ON map_edit (area_id);

-- Where a line of versions takes an edit in, or leaves it again. Other versions are as their parents.
CREATE TABLE version_edit (
  version_id INTEGER NOT NULL REFERENCES version,
  edit_id    INTEGER NOT NULL REFERENCES map_edit,
  holds      INTEGER NOT NULL,  -- 1: the version is made with it, 0: without it
  PRIMARY KEY (version_id, edit_id)
) STRICT, WITHOUT ROWID;

-- A version whose content is that of another one with other edits; NULL: a build or an import.
ALTER TABLE version ADD COLUMN edited_version_id INTEGER REFERENCES version;
