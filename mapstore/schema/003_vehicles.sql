-- SPDX-License-Identifier: Apache-2.0
--
-- Schema 3: the calibration of each vehicle. Units as in 001_init.sql.

PRAGMA user_version = 3;

-- What a version knows of a vehicle, from its runs and those of its ancestors. Localizers on vehicles
-- without a row use the fleet's calibration, which is in `version`.
CREATE TABLE vehicle_calibration (
  version_id INTEGER NOT NULL REFERENCES version,
  vehicle    TEXT NOT NULL,     -- as its logs name it
  runs       INTEGER NOT NULL,  -- that tell of it
  stamp_ns   INTEGER NOT NULL,  -- end of the newest of them

  -- Systematic errors, each with the standard deviation of what remains unknown.
  log_scale_v                 REAL NOT NULL,  -- log of true over measured speed
  log_scale_v_sd              REAL NOT NULL,
  log_scale_omega             REAL NOT NULL,  -- log of true over measured yaw rate
  log_scale_omega_sd          REAL NOT NULL,
  lag_s                       REAL NOT NULL,
  lag_sd_s                    REAL NOT NULL,
  bearing_offset_rad          REAL NOT NULL,  -- bearings are read too large by this
  bearing_offset_sd_rad       REAL NOT NULL,
  range_curvature_per_rad2    REAL NOT NULL,
  range_curvature_sd_per_rad2 REAL NOT NULL,
  mean_squared_bearing_rad2   REAL NOT NULL,

  -- Standard deviations of noise, each with its degrees of freedom; fewer than 2: not known.
  noise_v_m_per_sqrt_s       REAL NOT NULL,
  noise_v_dof                REAL NOT NULL,
  noise_omega_rad_per_sqrt_s REAL NOT NULL,
  noise_omega_dof            REAL NOT NULL,
  sd_range_m                 REAL NOT NULL,
  sd_range_dof               REAL NOT NULL,
  sd_bearing_rad             REAL NOT NULL,
  sd_bearing_dof             REAL NOT NULL,
  sd_position_m              REAL NOT NULL,
  sd_position_dof            REAL NOT NULL,

  detection_probability REAL NOT NULL,  -- share of the pairs (scan, landmark in view) with a detection
  detection_trials      REAL NOT NULL,  -- number of such pairs

  PRIMARY KEY (version_id, vehicle)
) STRICT, WITHOUT ROWID;
