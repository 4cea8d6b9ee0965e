-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 10: damage to any stored value shows. Of the reports about a log and about copies of it
-- that were cut off, the longest counts. Units as in 001_init.sql.

PRAGMA user_version = 10;

-- Reports and runs that begin at one time are looked up.
CREATE INDEX shift_report_begin ON shift_report (begin_ns);
CREATE INDEX run_begin ON run (begin_ns);

-- 1: another report about the same run comes before it: the one that ends last, then that against
-- the lowest version, then of the lowest UUID. Copies of a log without a UUID have the vehicle and
-- the begin of the log.
UPDATE shift_report SET superseded = EXISTS (
  SELECT 1 FROM shift_report o
  JOIN version ov ON ov.version_id = o.version_id
  JOIN version v ON v.version_id = shift_report.version_id
  WHERE o.vehicle = shift_report.vehicle AND ov.area_id = v.area_id
    AND (o.end_ns > shift_report.end_ns OR (o.end_ns = shift_report.end_ns
         AND (ov.number, o.uuid) < (v.number, shift_report.uuid)))
    AND (o.identity = shift_report.identity
         OR (o.begin_ns = shift_report.begin_ns
             AND o.begin_ns >= 946684800000000000  -- 2000: the clock was set
             AND o.run_hash <> '' AND shift_report.run_hash <> ''
             AND (o.identity = o.run_hash OR shift_report.identity = shift_report.run_hash)
             AND o.first_visit_ns <= shift_report.end_ns
             AND shift_report.first_visit_ns <= o.end_ns)));
INSERT INTO mapped_report
  SELECT report_id, vr.version_id FROM shift_report r
  JOIN version rv ON rv.version_id = r.version_id
  JOIN run ON run.begin_ns = r.begin_ns AND run.vehicle = r.vehicle
  JOIN version_run vr USING (run_id) JOIN version v ON v.version_id = vr.version_id
  WHERE v.area_id = rv.area_id AND r.run_hash <> '' AND r.begin_ns >= 946684800000000000
    AND (r.identity = r.run_hash OR run.identity = run.sha256)
  ON CONFLICT DO NOTHING;

-- They may be of other reports than count now. A snapshot has none but its own.
DELETE FROM ledger_checkpoint WHERE rows_stored <> 0;
UPDATE area SET rows_since_checkpoint =
  (SELECT count(*) FROM visit_evidence e WHERE e.area_id = area.area_id) +
  (SELECT count(*) FROM mapped_evidence e WHERE e.area_id = area.area_id);

-- Of the row's other columns, as mapstore/sqlite/row_checksum.h has it. Tables without it hold what
-- version.content_hash is of.
ALTER TABLE area ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE audit ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE decision ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE exclusion ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE ledger_checkpoint ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE ledger_summary ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE map_edit ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE mapped_evidence ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE mapped_report ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE mapped_visibility ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE run ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE shift_report ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE sighting ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE split_run ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE stated_probability ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE vehicle_calibration ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE version ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE version_edit ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE version_run ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
ALTER TABLE visit_evidence ADD COLUMN checksum INTEGER NOT NULL DEFAULT 0;
