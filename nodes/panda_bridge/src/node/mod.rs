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
use catenary_shell::{Misconfigured, NodeBuilder};
use front::MoveParameters;
use settings::Settings;
use std::process::ExitCode;

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("panda_bridge", args, run)
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
