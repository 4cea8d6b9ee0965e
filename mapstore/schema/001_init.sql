-- SPDX-License-Identifier: Apache-2.0
--
-- Schema version 1 of the map store. Units are in the names: _m metres, _m2 square metres, _rad
-- radians, _s seconds, _ns nanoseconds (stamps: since the Unix epoch, UTC). Positions are in the
-- area's map frame; covariances are over (x, y). Numbers in BLOBs are 8 bytes, big-endian. The model
-- behind the tables: mapstore/METHOD.md.

PRAGMA application_id = 1399344496;  -- 0x53684D70, "ShMp"
PRAGMA user_version = 1;

-- A named map in one coordinate frame.
CREATE TABLE area (
  area_id              INTEGER PRIMARY KEY,
  name                 TEXT NOT NULL UNIQUE,
  -- The version that vehicles get; NULL if none. Moved by compare-and-swap.
  published_version_id INTEGER REFERENCES version DEFERRABLE INITIALLY DEFERRED
) STRICT;

-- One immutable build of an area.
CREATE TABLE version (
  version_id        INTEGER PRIMARY KEY,
  area_id           INTEGER NOT NULL REFERENCES area,
  number            INTEGER NOT NULL,            -- counts from 1 within the area
  parent_version_id INTEGER REFERENCES version,  -- the version it was made from; NULL without a prior
  content_hash      TEXT NOT NULL,               -- SHA-256 over the canonical rows, 64 hex digits
  content_stored    INTEGER NOT NULL,            -- 0: a snapshot's ancestor, of which only this row is kept
  stamp_ns          INTEGER NOT NULL,            -- the time at which the modes' probabilities hold
  created_ns        INTEGER NOT NULL,            -- clock of the machine that committed it
  tool              TEXT NOT NULL,               -- name and version of what built it
  configuration     TEXT NOT NULL,               -- effective options of the build, JSON
  seed              INTEGER NOT NULL,            -- of its random numbers
  -- Odometry calibration: true over measured, and what is left.
  odometry_scale_v      REAL NOT NULL,           -- true over measured speed
  odometry_scale_omega  REAL NOT NULL,           -- true over measured yaw rate
  odometry_lag_s        REAL NOT NULL,           -- the motion at t is what odometry says of t - lag
  odometry_sd_log_scale REAL NOT NULL,           -- standard deviation of log(scale) between vehicles
  odometry_noise_v_m_per_sqrt_s       REAL NOT NULL,  -- random walk of the motion, along
  odometry_noise_omega_rad_per_sqrt_s REAL NOT NULL,  -- and of the yaw
  -- Sensor calibration.
  sensor_sd_range_m                  REAL NOT NULL,
  sensor_sd_bearing_rad              REAL NOT NULL,
  sensor_sd_position_m               REAL NOT NULL,  -- of each coordinate of a Cartesian observation
  sensor_range_curvature_per_rad2    REAL NOT NULL,  -- r is read as r (1 + curvature (b² - mean squared bearing))
  sensor_mean_squared_bearing_rad2   REAL NOT NULL,
  sensor_max_range_m                 REAL NOT NULL,  -- sector field of view
  sensor_max_bearing_rad             REAL NOT NULL,
  sensor_detection_probability       REAL NOT NULL,  -- of a landmark in the field of view
  sensor_occluded_visit_probability  REAL NOT NULL,  -- of a visit in which a landmark that is there stays unseen
  sensor_clutter_density_per_m2      REAL NOT NULL,  -- Poisson, per m² of the vehicle frame and scan
  sensor_new_landmark_density_per_m2 REAL NOT NULL,
  UNIQUE (area_id, number)
) STRICT;

-- One physical landmark with a signature, and its mode chain.
CREATE TABLE landmark_group (
  version_id         INTEGER NOT NULL REFERENCES version,
  group_index        INTEGER NOT NULL,  -- from 0, by ascending bytes of the signature
  signature          TEXT NOT NULL,
  leave_rate_per_s   REAL NOT NULL,     -- rate at which the chain leaves each state, to all others alike
  absent_probability REAL NOT NULL,     -- of the state 'absent' at version.stamp_ns
  PRIMARY KEY (version_id, group_index),
  UNIQUE (version_id, signature)
) STRICT, WITHOUT ROWID;

-- One position that a landmark of a group can be at.
CREATE TABLE mode (
  version_id   INTEGER NOT NULL,
  group_index  INTEGER NOT NULL,
  number       INTEGER NOT NULL,  -- from 1, stable along a chain of parents, never reused; 0 is 'absent'
  x_m          REAL NOT NULL,
  y_m          REAL NOT NULL,
  cov_xx_m2    REAL NOT NULL,     -- marginal covariance
  cov_xy_m2    REAL NOT NULL,
  cov_yy_m2    REAL NOT NULL,
  last_seen_ns INTEGER NOT NULL,  -- newest observation that built the mode; 0 for a surveyed one
  probability  REAL NOT NULL,     -- at version.stamp_ns, before any report
  PRIMARY KEY (version_id, group_index, number),
  FOREIGN KEY (version_id, group_index) REFERENCES landmark_group
) STRICT, WITHOUT ROWID;

-- Blocks above the diagonal of the joint covariance of all modes; blocks without a row are zero.
-- Modes are counted from 0 in the order of (group_index, number). Block: E[e_row e_columnᵀ].
CREATE TABLE mode_covariance (
  version_id   INTEGER NOT NULL REFERENCES version,
  row_index    INTEGER NOT NULL,  -- row_index < column_index
  column_index INTEGER NOT NULL,
  cov_xx_m2    REAL NOT NULL,     -- x of the row's mode with x of the column's
  cov_xy_m2    REAL NOT NULL,     -- x of the row's mode with y of the column's
  cov_yx_m2    REAL NOT NULL,
  cov_yy_m2    REAL NOT NULL,
  PRIMARY KEY (version_id, row_index, column_index)
) STRICT, WITHOUT ROWID;

-- Static landmarks without a signature.
CREATE TABLE anonymous_landmark (
  version_id     INTEGER NOT NULL REFERENCES version,
  landmark_index INTEGER NOT NULL,  -- from 0, in the order of the content
  number         INTEGER NOT NULL,
  x_m            REAL NOT NULL,
  y_m            REAL NOT NULL,
  cov_xx_m2      REAL NOT NULL,
  cov_xy_m2      REAL NOT NULL,
  cov_yy_m2      REAL NOT NULL,
  last_seen_ns   INTEGER NOT NULL,
  PRIMARY KEY (version_id, landmark_index)
) STRICT, WITHOUT ROWID;

-- A recorded log that versions were built from.
CREATE TABLE run (
  run_id   INTEGER PRIMARY KEY,
  sha256   TEXT NOT NULL,     -- of the log file, 64 hex digits
  name     TEXT NOT NULL,     -- the log file's stem
  vehicle  TEXT NOT NULL,
  begin_ns INTEGER NOT NULL,  -- first and last stamp of the log
  end_ns   INTEGER NOT NULL,
  UNIQUE (sha256, name, vehicle, begin_ns, end_ns)
) STRICT;

CREATE TABLE version_run (
  version_id INTEGER NOT NULL REFERENCES version,
  run_id     INTEGER NOT NULL REFERENCES run,
  -- T_map_vehicle as this version estimates it, 32 bytes a pose: stamp in ns (integer), x in m, y in
  -- m, yaw in rad (IEEE 754).
  trajectory BLOB NOT NULL,
  PRIMARY KEY (version_id, run_id)
) STRICT, WITHOUT ROWID;

-- What one vehicle reported after one shift.
CREATE TABLE shift_report (
  report_id   INTEGER PRIMARY KEY,
  uuid        TEXT NOT NULL UNIQUE,  -- RFC 4122, lower case; a report counts once
  version_id  INTEGER NOT NULL REFERENCES version,  -- the version driven on
  vehicle     TEXT NOT NULL,
  run_hash    TEXT NOT NULL,         -- SHA-256 of the run log, 64 hex digits; empty for a live stream
  software    TEXT NOT NULL,         -- name and version of what made the report
  begin_ns    INTEGER NOT NULL,      -- first and last stamp of the shift
  end_ns      INTEGER NOT NULL,
  received_ns INTEGER NOT NULL       -- clock of the machine that took it
) STRICT;

CREATE INDEX shift_report_version ON shift_report (version_id);

-- The ledger. The key is in the order in which the chain is filtered, so that an area is one scan.
CREATE TABLE visit_evidence (
  area_id           INTEGER NOT NULL REFERENCES area,
  signature         TEXT NOT NULL,
  begin_ns          INTEGER NOT NULL,  -- first and last scan of the visit
  end_ns            INTEGER NOT NULL,
  report_id         INTEGER NOT NULL REFERENCES shift_report,
  observation_count INTEGER NOT NULL,  -- scans of the visit in which the landmark was seen
  -- Prior excluded, up to a constant; by ascending mode number, 'absent' (0) first; 16 bytes a mode:
  -- mode number (integer), log-likelihood in nat (IEEE 754).
  log_likelihoods   BLOB NOT NULL,
  PRIMARY KEY (area_id, signature, begin_ns, end_ns, report_id)
) STRICT, WITHOUT ROWID;

CREATE INDEX visit_evidence_report ON visit_evidence (report_id);

-- The sequential test decided, onboard, that a mode holds.
CREATE TABLE decision (
  report_id      INTEGER NOT NULL REFERENCES shift_report,
  decision_index INTEGER NOT NULL,  -- from 0, in the order of the report
  signature      TEXT NOT NULL,
  mode           INTEGER NOT NULL,  -- mode number, 0 is 'absent'
  stamp_ns       INTEGER NOT NULL,  -- of the scan that decided
  log_odds       REAL NOT NULL,     -- smallest log-ratio to any other mode, nat
  PRIMARY KEY (report_id, decision_index)
) STRICT, WITHOUT ROWID;

-- Observations that gate with no known mode, condensed.
CREATE TABLE sighting (
  report_id      INTEGER NOT NULL REFERENCES shift_report,
  sighting_index INTEGER NOT NULL,  -- from 0, in the order of the report
  area_id        INTEGER NOT NULL REFERENCES area,
  signature      TEXT NOT NULL,     -- empty if it has none
  x_m            REAL NOT NULL,
  y_m            REAL NOT NULL,
  cov_xx_m2      REAL NOT NULL,
  cov_xy_m2      REAL NOT NULL,
  cov_yy_m2      REAL NOT NULL,
  count          INTEGER NOT NULL,  -- observations condensed
  first_ns       INTEGER NOT NULL,  -- stamps of the first and last of them
  last_ns        INTEGER NOT NULL,
  PRIMARY KEY (report_id, sighting_index)
) STRICT, WITHOUT ROWID;

CREATE INDEX sighting_area ON sighting (area_id, last_ns);

-- Every write, in the same transaction as what it did.
CREATE TABLE audit (
  audit_id   INTEGER PRIMARY KEY,
  written_ns INTEGER NOT NULL,  -- clock of the machine that wrote
  area_id    INTEGER NOT NULL REFERENCES area,
  action     TEXT NOT NULL,     -- 'commit', 'publish' or 'return'
  subject    TEXT NOT NULL      -- version number, or UUID of the report
) STRICT;
