//! Parameters that choose and set the transport to the arm.

use super::settings::fixed;
use crate::compliance::Compliance;
use crate::fci::{Collision, DEFAULT_PRIORITY, FciSettings, Generation, Load};
use crate::kinematics::{JOINTS, LIMITS_RAD, READY_RAD};
use crate::law::LawSettings;
use anyhow::{Result, bail, ensure};
use catenary_shell::NodeBuilder;
use std::ops::RangeInclusive;

/// Declares `transport` and `fci.*`. Returns the settings of FCI, or `None` for the relay.
///
/// # Errors
/// An invalid value.
pub fn declare(b: &NodeBuilder) -> Result<Option<FciSettings>> {
    let text = "Transport to the arm: relay (a ROS 2 controller drives it) or fci (this node drives it).";
    let transport = b.declare_string("transport", "relay", fixed(text).choices(&["relay", "fci"]))?.get();
    let settings = fci(b)?;
    if transport == "relay" {
        if !settings.host.is_empty() {
            tracing::warn!(
                "parameter fci.host: {}: transport relay does not read it; set transport to fci",
                settings.host
            );
        }
        return Ok(None);
    }
    ensure!(
        !settings.host.is_empty(),
        "parameter fci.host: expected the robot's address for transport fci, got an empty string"
    );
    Ok(Some(settings))
}

fn fci(b: &NodeBuilder) -> Result<FciSettings> {
    let number = |name: &str, default: f64, unit: &str, range: RangeInclusive<f64>, text: &str| -> Result<f64> {
        Ok(b.declare_f64(name, default, fixed(text).unit(unit).range(range))?.get())
    };
    let host = b.declare_string("fci.host", "", fixed("Name or address of the robot, optionally with :port."))?.get();
    let generation = "Generation of the arm: panda (FCI version 5) or fr3 (version 10).";
    let generation = b.declare_string("fci.generation", "panda", fixed(generation).choices(&["panda", "fr3"]))?.get();
    let priority =
        "Real-time priority of the control thread, if the system grants one; its supervisor gets the next higher one.";
    let priority = fixed(priority).integer_range(1..=99);
    let priority = b.declare_i64("fci.priority", i64::from(DEFAULT_PRIORITY), priority)?.get();
    let priority = i32::try_from(priority).unwrap_or(DEFAULT_PRIORITY);
    let cpu = "Processor that the control thread is bound to, from 0; -1: any. Keep other work off it (isolcpus).";
    let cpu = usize::try_from(b.declare_i64("fci.cpu", -1, fixed(cpu).integer_range(-1..=1023))?.get()).ok();
    let d = LawSettings::default();
    let law = LawSettings {
        integral: number(
            "fci.integral",
            d.integral,
            "N/m",
            0.0..=10.0,
            "Integral gain a cycle; it removes the standing error of friction, and pushes harder against an obstacle.",
        )?,
        nullspace_stiffness: number(
            "fci.nullspace_stiffness",
            d.nullspace_stiffness,
            "N m/rad",
            0.0..=50.0,
            "Stiffness that keeps the posture; larger keeps the elbow nearer to it, against more stiction.",
        )?,
        joint1_factor: number(
            "fci.nullspace_joint1_factor",
            d.joint1_factor,
            "",
            1.0..=1000.0,
            "Factor of that stiffness for joint 1.",
        )?,
        ..d
    };
    let cutoff_hz = number(
        "fci.cutoff_hz",
        100.0,
        "Hz",
        1.0..=1000.0,
        "Cut-off frequency of the torques' low-pass; 1000 switches it off.",
    )?;
    let (compliance, collision) = (compliance(b)?, collision(b)?);
    if let Err(error) = compliance.check_thresholds(&collision.wrench, &collision.torque_n_m) {
        bail!("parameters fci.stiffness and fci.error_clip_m: {error}");
    }
    Ok(FciSettings {
        host,
        generation: if generation == "fr3" { Generation::Fr3 } else { Generation::Panda },
        priority,
        cpu,
        cutoff_hz,
        law,
        rest_joints_rad: rest(b)?,
        compliance,
        collision,
        load: load(b)?,
    })
}

fn rest(b: &NodeBuilder) -> Result<[f64; JOINTS]> {
    let text =
        "Posture of the arm at the start: move_to_start brings the joints near to it, and the elbow returns to it.";
    let rest = array(b, "fci.rest_joints_rad", READY_RAD, "rad", text)?;
    for (i, (angle, [low, high])) in rest.iter().zip(LIMITS_RAD).enumerate() {
        ensure!(
            (low..=high).contains(angle),
            "parameter fci.rest_joints_rad: joint {}: expected {low} to {high} rad, got {angle}",
            i + 1
        );
    }
    Ok(rest)
}

/// Declares an array of fixed length with finite values.
fn array<const N: usize>(b: &NodeBuilder, name: &str, default: [f64; N], unit: &str, text: &str) -> Result<[f64; N]> {
    let given = b.declare(name, default.to_vec(), fixed(text).unit(unit))?.get();
    let Ok(values) = <[f64; N]>::try_from(given.as_slice()) else {
        bail!("parameter {name}: expected {N} values, got {}", given.len());
    };
    ensure!(values.iter().all(|v| v.is_finite()), "parameter {name}: expected finite numbers, got {values:?}");
    Ok(values)
}

/// Declares and reads the gains at the start.
pub(super) fn compliance(b: &NodeBuilder) -> Result<Compliance> {
    let d = Compliance::default();
    let clip =
        fixed("Limit of the position error in the law; stiffness times this limit is the greatest steady force.");
    let compliance = Compliance {
        stiffness: array(
            b,
            "fci.stiffness",
            d.stiffness,
            "N/m, N m/rad",
            "Stiffness at the start, x, y, z and about them.",
        )?,
        damping: array(b, "fci.damping", d.damping, "N s/m, N m s/rad", "Damping at the start, in the same order.")?,
        error_clip_m: b.declare_f64("fci.error_clip_m", d.error_clip_m, clip.unit("m").range(1e-4..=0.1))?.get(),
    };
    if let Err(error) = compliance.check() {
        bail!("parameter fci.{error}");
    }
    Ok(compliance)
}

fn collision(b: &NodeBuilder) -> Result<Collision> {
    let d = Collision::default();
    let torque = "External torque of each joint at which the robot stops by a reflex.";
    let wrench = "External force and moment at the end effector at which the robot stops by a reflex.";
    let collision = Collision {
        torque_n_m: array(b, "fci.collision_torque", d.torque_n_m, "N m", torque)?,
        wrench: array(b, "fci.collision_wrench", d.wrench, "N, N m", wrench)?,
    };
    let positive = collision.torque_n_m.iter().chain(&collision.wrench).all(|v| *v > 0.0);
    ensure!(positive, "parameters fci.collision_*: expected positive thresholds, got {collision:?}");
    Ok(collision)
}

fn load(b: &NodeBuilder) -> Result<Load> {
    let inertia = array(b, "fci.load_inertia", [0.0; 3], "kg m^2", "Moments of inertia about the centre of mass.")?;
    ensure!(inertia.iter().all(|v| *v >= 0.0), "parameter fci.load_inertia: expected 0 or more, got {inertia:?}");
    let mass = "Mass of what the hand holds, which Desk does not know. A wrong mass makes the arm sag or rise.";
    Ok(Load {
        mass_kg: b.declare_f64("fci.load_mass_kg", 0.0, fixed(mass).unit("kg").range(0.0..=3.0))?.get(),
        centre_m: array(b, "fci.load_centre_m", [0.0; 3], "m", "Centre of that mass in the frame of the flange.")?,
        inertia_kg_m2: inertia,
    })
}
