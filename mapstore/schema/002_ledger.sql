-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 2: the ledger in the order of time with checkpoints, so that years of reports stay fast;
-- which reports a version accounts for; merged modes; chains with a general rate matrix. Units as in
-- 001_init.sql.

PRAGMA user_version = 2;

-- How much of the ledger the version's probabilities account for: of the visits that began up to
-- stamp_ns those whose report_id is at most this.
ALTER TABLE version ADD COLUMN ledger_position INTEGER NOT NULL DEFAULT 0;
UPDATE version SET ledger_position = (
  SELECT coalesce(max(report_id), 0) FROM shift_report r WHERE r.received_ns <= version.created_ns
    AND NOT EXISTS (SELECT 1 FROM shift_report o WHERE o.version_id = version.version_id
                    AND o.report_id <= r.report_id));

CREATE INDEX version_parent ON version (parent_version_id);
CREATE INDEX version_stamp ON version (area_id, stamp_ns);

-- Evidence rows added since the checkpoints of the published version were last extended.
ALTER TABLE area ADD COLUMN rows_since_checkpoint INTEGER NOT NULL DEFAULT 0;
UPDATE area SET rows_since_checkpoint =
  (SELECT count(*) FROM visit_evidence e WHERE e.area_id = area.area_id);

-- Mode numbers that are retired because the mode was found to be the same position as another.
CREATE TABLE merged_mode (
  version_id  INTEGER NOT NULL,
  group_index INTEGER NOT NULL,
  number      INTEGER NOT NULL,  -- no mode of this landmark gets it again
  into_number INTEGER NOT NULL,  -- the mode that stands for it
  PRIMARY KEY (version_id, group_index, number),
  FOREIGN KEY (version_id, group_index) REFERENCES landmark_group
) STRICT, WITHOUT ROWID;

-- Rates of chains that are not uniform; a group without rows has the uniform chain of its
-- leave_rate_per_s, which otherwise is the mean over the states. States: 0 is 'absent', then the
-- modes by number. Pairs without a row have rate 0.
CREATE TABLE mode_rate (
  version_id  INTEGER NOT NULL,
  group_index INTEGER NOT NULL,
  from_state  INTEGER NOT NULL,
  to_state    INTEGER NOT NULL,
  rate_per_s  REAL NOT NULL,
  PRIMARY KEY (version_id, group_index, from_state, to_state),
  FOREIGN KEY (version_id, group_index) REFERENCES landmark_group
) STRICT, WITHOUT ROWID;

-- Begin of the report's first visit; NULL if it has no evidence.
ALTER TABLE shift_report ADD COLUMN first_visit_ns INTEGER;
UPDATE shift_report SET first_visit_ns =
  (SELECT min(begin_ns) FROM visit_evidence e WHERE e.report_id = shift_report.report_id);

-- 1: another report about the same run log comes before it: that against the lowest version, then
-- of the lowest UUID. Of those about a run the first counts that is of a version's line.
ALTER TABLE shift_report ADD COLUMN superseded INTEGER NOT NULL DEFAULT 0;
CREATE INDEX shift_report_run ON shift_report (run_hash) WHERE run_hash <> '';
UPDATE shift_report SET superseded = 1
WHERE run_hash <> '' AND EXISTS (
  SELECT 1 FROM shift_report o
  JOIN version ov ON ov.version_id = o.version_id
  JOIN version v ON v.version_id = shift_report.version_id
  WHERE o.run_hash = shift_report.run_hash AND ov.area_id = v.area_id
    AND (ov.number, o.uuid) < (v.number, shift_report.uuid));
CREATE INDEX shift_report_superseded ON shift_report (report_id) WHERE superseded = 1;
CREATE INDEX shift_report_position ON shift_report (report_id, version_id, first_visit_ns);

-- Reports about a log that a version was built from.
CREATE INDEX version_run_run ON version_run (run_id);
CREATE TABLE mapped_report (
  report_id  INTEGER NOT NULL REFERENCES shift_report,
  version_id INTEGER NOT NULL REFERENCES version,
  PRIMARY KEY (report_id, version_id)
) STRICT, WITHOUT ROWID;
INSERT INTO mapped_report
  SELECT DISTINCT r.report_id, vr.version_id FROM shift_report r
  JOIN run ON run.sha256 = r.run_hash JOIN version_run vr USING (run_id) WHERE r.run_hash <> '';

-- The ledger. The key is in the order of time, in which reports append and the chains are filtered.
-- area_id and version_id repeat what the report says, for readers that come by time.
ALTER TABLE visit_evidence RENAME TO visit_evidence_by_landmark;
DROP INDEX visit_evidence_report;
CREATE TABLE visit_evidence (
  area_id           INTEGER NOT NULL,
  begin_ns          INTEGER NOT NULL,  -- first and last scan of the visit
  end_ns            INTEGER NOT NULL,
  report_id         INTEGER NOT NULL REFERENCES shift_report,
  signature         TEXT NOT NULL,
  version_id        INTEGER NOT NULL,  -- the version driven on
  observation_count INTEGER NOT NULL,  -- scans of the visit in which the landmark was seen
  -- Prior excluded, up to a constant; by ascending mode number, 'absent' (0) first; 16 bytes a mode:
  -- mode number (integer), log-likelihood in nat (IEEE 754).
  log_likelihoods   BLOB NOT NULL,
  PRIMARY KEY (area_id, begin_ns, end_ns, report_id, signature)
) STRICT, WITHOUT ROWID;
INSERT INTO visit_evidence
  SELECT e.area_id, e.begin_ns, e.end_ns, e.report_id, e.signature, r.version_id,
         e.observation_count, e.log_likelihoods
  FROM visit_evidence_by_landmark e JOIN shift_report r USING (report_id)
  ORDER BY e.area_id, e.begin_ns, e.end_ns, e.report_id, e.signature;
DROP TABLE visit_evidence_by_landmark;

-- Where filtering a version's probabilities over the ledger had come to. Derived: may be deleted.
CREATE TABLE ledger_checkpoint (
  area_id       INTEGER NOT NULL REFERENCES area,
  version_id    INTEGER NOT NULL REFERENCES version,
  before_ns     INTEGER NOT NULL,  -- visits that began before this are in it, later ones are not
  newest_end_ns INTEGER,           -- of the visits that count; NULL if none does
  rows_stored   INTEGER NOT NULL,  -- 0: the rows before it are not in this file, which is a snapshot
  -- Per group that any evidence is about, ascending, 8-byte numbers: group_index, stamp in ns, 1 if
  -- a visit was filtered or else 0, then per state the logarithm of its probability (IEEE 754).
  states        BLOB NOT NULL,
  PRIMARY KEY (area_id, before_ns, version_id)
) STRICT;

-- Writes about the whole store have no area.
ALTER TABLE audit RENAME TO audit_of_areas;
CREATE TABLE audit (
  audit_id   INTEGER PRIMARY KEY,
  written_ns INTEGER NOT NULL,  -- clock of the machine that wrote
  area_id    INTEGER REFERENCES area,
  action     TEXT NOT NULL,     -- 'commit', 'publish', 'rollback', 'return', 'compact', 'migrate'
  subject    TEXT NOT NULL      -- version number, UUID of the report, or what was done
) STRICT;
INSERT INTO audit SELECT * FROM audit_of_areas;
DROP TABLE audit_of_areas;
