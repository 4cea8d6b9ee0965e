-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 6: how far a vehicle is trusted is learned from what the others say after it.
-- Units as in 001_init.sql.

PRAGMA user_version = 6;

-- Filtered in another way. ledger_checkpoint.states now begins with the number of vehicles that were
-- judged, and for each, ascending, the first 64 bits of the SHA-256 of its name and the probability
-- that it is broken; then the groups as in schema 5, but for the logarithm of the odds of a mistake,
-- which is now that of the Bayes factor, without a prior.
DELETE FROM ledger_checkpoint;
UPDATE area SET rows_since_checkpoint =
  (SELECT count(*) FROM visit_evidence e WHERE e.area_id = area.area_id) +
  (SELECT count(*) FROM mapped_evidence e WHERE e.area_id = area.area_id);
