//! ROS 2 side: the front end of an arm, and its two transports: a relay to a controller, and FCI.

mod controller;
mod fci;
pub mod front;
mod parameters;
mod relay;
mod settings;
pub mod topics;
mod transport;

use anyhow::Result;
use catenary_core::model::ArmLaw;
use catenary_shell::{Misconfigured, NodeBuilder, ParamSpec, RosArgs};
use front::MoveParameters;
use settings::Settings;
use std::process::ExitCode;

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("panda_bridge", args, run)
}

/// Law of a bridge with these arguments, from its parameters alone: nothing is started. It is that of `controller.arm_law` where the relay
/// has one, else that of the gains `fci.*` and of `follow_speed_m_s`.
///
/// # Errors
/// A parameter that the bridge would refuse, too.
pub fn law_of(arguments: &RosArgs) -> Result<ArmLaw> {
    let builder = NodeBuilder::new("panda_bridge", arguments)?;
    let transport = builder.declare_string("transport", "relay", ParamSpec::new("Transport to the arm."))?.get();
    let of_the_controller = if transport == "fci" { None } else { settings::law(&builder)? };
    match of_the_controller {
        Some(law) => Ok(law),
        None => Ok(transport::compliance(&builder)?.arm_law(&settings::speed(&builder)?)),
    }
}

fn run(builder: NodeBuilder) -> Result<()> {
    let settings = Settings::declare(&builder).map_err(Misconfigured::new)?;
    let transport = transport::declare(&builder).map_err(Misconfigured::new)?;
    let moves = MoveParameters::declare(&builder)?;
    let node = builder.build()?;
    match transport {
        None => relay::run(&node, settings, moves),
        Some(mut transport) => {
            transport.law.speed = settings.speed;
            fci::run(&node, settings, transport, moves)
        }
    }
}
