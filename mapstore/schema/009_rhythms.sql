-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 9: the rates of a chain may depend on the hour of the day or of the week.
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
