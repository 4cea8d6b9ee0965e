-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 5: what one vehicle can say of a landmark is bounded, and a run has an identity of its own.
-- Units as in 001_init.sql.

PRAGMA user_version = 5;

-- What tells runs apart, and which report is about which log: the UUID that was drawn when the log
-- began (lower case), or else the SHA-256 of the log, or else the UUID of the report of a shift that
-- left no log.
ALTER TABLE run ADD COLUMN identity TEXT NOT NULL DEFAULT '';
UPDATE run SET identity = sha256;
ALTER TABLE shift_report ADD COLUMN identity TEXT NOT NULL DEFAULT '';
UPDATE shift_report SET identity = iif(run_hash = '', uuid, run_hash);
CREATE INDEX run_identity ON run (identity);
CREATE INDEX shift_report_identity ON shift_report (identity);

-- Filtered in another way. In ledger_checkpoint.states a group is now: group_index, stamp in ns, 1 if
-- a visit was filtered or else 0, 1 if a vehicle's turn is open or else 0. Without a turn, per state
-- the logarithm of its probability follows; with one, the vehicle (the first 64 bits of the SHA-256
-- of its name), the logarithm of the odds of a mistake, and three distributions: if the visits are
-- right and by the visits alone, both logarithms, and if they are mistakes, probabilities.
DELETE FROM ledger_checkpoint;
UPDATE area SET rows_since_checkpoint =
  (SELECT count(*) FROM visit_evidence e WHERE e.area_id = area.area_id) +
  (SELECT count(*) FROM mapped_evidence e WHERE e.area_id = area.area_id);
