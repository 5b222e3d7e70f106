//! Tables of a measured track, as text.
#![allow(clippy::unwrap_used, dead_code, reason = "each test that includes this module uses a part of it")]

use std::fmt::Write;

pub const CABLE: &str = include_str!("../../../../../launch_configs/models/measured_cable.yaml");
pub const BAR: &str = include_str!("../../../../../launch_configs/models/soft_bar.yaml");

/// CSV text of a swinging cable at 30 Hz, from `start_s` on.
pub fn track(start_s: f64, rows: usize) -> String {
    let mut csv = "t_s,grip_x_m,grip_z_m,grip_pitch_rad,p1_x_m,p1_z_m,p2_x_m,p2_z_m,p3_x_m,p3_z_m,p4_x_m,p4_z_m,\
                   grip_fx_n,grip_fz_n,grip_ty_nm\n"
        .to_owned();
    for i in 0..rows {
        let t = i as f64 / 30.0;
        let (x, z, pitch) = (0.45 + 0.05 * (2.0 * t).sin(), 0.41, 0.1 * (3.0 * t).cos());
        write!(csv, "{},{x},{z},{pitch}", start_s + t).unwrap();
        for k in 1..=4 {
            let angle = 0.3 * (5.0 * t).cos() * f64::from(k) / 4.0;
            write!(csv, ",{},{}", x + 0.05 * f64::from(k) * angle.sin(), z - 0.05 * f64::from(k) * angle.cos())
                .unwrap();
        }
        writeln!(csv, ",{},{},{}", t.sin(), -4.0, 0.01 * t).unwrap();
    }
    csv
}

pub fn numbers(csv: &str) -> Vec<Vec<f64>> {
    csv.lines().skip(1).map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect()
}
