//! Parameters of the emulated arm.

use crate::fci::{Generation, JOINTS, Load};
use crate::panda::{Settings, Wall};
use crate::server::{FCI_PORT, Network, PATIENCE, Pace, ServerOptions};
use anyhow::{Context, Result, anyhow, bail};
use catenary_shell::{NodeBuilder, ParamSpec};
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

fn fixed(text: &str) -> ParamSpec {
    ParamSpec::new(text).read_only()
}

/// Declares the parameters. Returns the address of the server, and its options.
///
/// # Errors
/// An invalid value, a model library that cannot be read.
pub fn declare(b: &NodeBuilder) -> Result<(SocketAddr, ServerOptions)> {
    let address = "Address of the arm: one of this machine's. Any 127.x.y.z is, so that several arms can run at once.";
    let address = b.declare_string("address", "127.0.0.1", fixed(address))?.get();
    let ip: IpAddr = match address.parse() {
        Ok(ip) => ip,
        Err(_) => bail!("parameter address: expected an IP address, got `{address}`"),
    };
    let generation =
        fixed("Generation of the arm: panda (FCI version 5) or fr3 (version 10).").choices(&["panda", "fr3"]);
    let generation = match b.declare_string("generation", "panda", generation)?.get().as_str() {
        "fr3" => Generation::Fr3,
        _ => Generation::Panda,
    };
    let pace = "Time of the arm: clock (1 kHz), elastic (1 kHz at most: while a motion runs, a state waits for the command before it) or \
                lock_step (likewise, and as fast as the client answers).";
    let pace = fixed(pace).choices(&["clock", "elastic", "lock_step"]);
    let pace = match b.declare_string("pace", "clock", pace)?.get().as_str() {
        "lock_step" => Pace::LockStep,
        "elastic" => Pace::Elastic,
        _ => Pace::Clock,
    };
    let patience =
        "Wait for a command in the paces elastic and lock_step. libfranka gives up a robot that is silent for 1 s.";
    let patience = fixed(patience).unit("s").range(0.0..=60.0);
    let patience = Duration::from_secs_f64(b.declare_f64("patience_s", PATIENCE.as_secs_f64(), patience)?.get());
    let network = "Losses and delays of states: none, or lab (as recorded on real arms).";
    let network = match b.declare_string("network", "none", fixed(network).choices(&["none", "lab"]))?.get().as_str() {
        "lab" => Network::Lab,
        _ => Network::None,
    };
    let seed = b.declare_i64("seed", 1, fixed("Seed of noise and losses.").integer_range(0..=i64::MAX))?.get();
    let library = "Shared library that clients load as the model of the arm (panda_model_library); empty: none.";
    let library = b.declare_string("model_library", "", fixed(library))?.get();
    let model_library = match library.as_str() {
        "" => None,
        path => Some(std::fs::read(path).with_context(|| format!("parameter model_library: {path}"))?),
    };
    let settings = settings(b, generation)?;
    settings.check().map_err(|e| anyhow!("parameter {}: expected {}, got {}", e.field, e.expected, e.value))?;
    let options = ServerOptions { settings, seed: seed.cast_unsigned(), pace, patience, network, model_library };
    Ok((SocketAddr::new(ip, FCI_PORT), options))
}

/// Declares the wall in the way of the hand, which may be moved while the node runs. Returns a reader of its present place.
///
/// # Errors
/// An invalid value.
pub fn wall(b: &NodeBuilder) -> Result<impl Fn() -> Option<Wall> + use<>> {
    let place =
        ParamSpec::new("Place of a wall in the way of the hand, along x; 0: no wall.").unit("m").range(0.0..=2.0);
    let place = b.declare_f64("wall.x_m", 0.0, place)?;
    let stiffness = ParamSpec::new("Stiffness of the wall.").unit("N/m").range(1.0..=1e5);
    let stiffness = b.declare_f64("wall.stiffness_n_m", 5000.0, stiffness)?;
    Ok(move || {
        let x_m = place.get();
        (x_m > 0.0).then(|| Wall { x_m, stiffness_n_m: stiffness.get() })
    })
}

/// Declares the settings of the arm that a laboratory would vary. The others keep their defaults.
fn settings(b: &NodeBuilder, generation: Generation) -> Result<Settings> {
    let d = Settings::of(generation);
    let number = |name: &str, default: f64, unit: &str, text: &str| -> Result<f64> {
        Ok(b.declare_f64(name, default, fixed(text).unit(unit))?.get())
    };
    let joints = |name: &str, default: [f64; JOINTS], unit: &str, text: &str| array(b, name, default, unit, text);
    let stiction = "Stiction of each joint, which vanishes while the joint moves.";
    let bias = "Constant error of each torque sensor.";
    let stop = "Refuse motions after the user stop was released until the errors are recovered from.";
    let manual = "Refuse the automatic recovery after a joint limit or a self-collision.";
    let delay = fixed("Delay of a torque command.").unit("cycles").integer_range(0..=10);
    let mass = "Mass in the hand that the control box does not know.";
    let mass = fixed(mass).unit("kg").range(0.0..=100.0);
    let settings = Settings {
        start_joints_rad: joints("start_joints_rad", d.start_joints_rad, "rad", "Joint angles at power-up.")?,
        true_load: Load {
            mass_kg: b.declare_f64("load.mass_kg", 0.0, mass)?.get(),
            centre_m: array(b, "load.centre_m", [0.0, 0.0, 0.1], "m", "Its centre in the frame of the flange.")?,
            inertia: d.true_load.inertia,
        },
        friction_ratio: number(
            "friction_ratio",
            d.friction_ratio,
            "",
            "Scale of the joint friction that the motors leave over.",
        )?,
        stiction_n_m: joints("stiction_n_m", d.stiction_n_m, "N m", stiction)?,
        rotor_inertia_ratio: number(
            "rotor_inertia_ratio",
            d.rotor_inertia_ratio,
            "",
            "Share of the rotor inertia that the torque control does not hide.",
        )?,
        torque_bias_n_m: joints("torque_bias_n_m", d.torque_bias_n_m, "N m", bias)?,
        command_delay_cycles: usize::try_from(
            b.declare_i64("command_delay_cycles", d.command_delay_cycles as i64, delay)?.get(),
        )?,
        user_stop_needs_recovery: b
            .declare_bool("user_stop_needs_recovery", d.user_stop_needs_recovery, fixed(stop))?
            .get(),
        limits_need_manual_recovery: b
            .declare_bool("limits_need_manual_recovery", d.limits_need_manual_recovery, fixed(manual))?
            .get(),
        ..d
    };
    settings.check()?;
    Ok(settings)
}

/// Declares an array of fixed length.
fn array<const N: usize>(b: &NodeBuilder, name: &str, default: [f64; N], unit: &str, text: &str) -> Result<[f64; N]> {
    let given = b.declare(name, default.to_vec(), fixed(text).unit(unit))?.get();
    match <[f64; N]>::try_from(given.as_slice()) {
        Ok(values) => Ok(values),
        Err(_) => bail!("parameter {name}: expected {N} values, got {}", given.len()),
    }
}
