//! Holds an arm by the transport `fci` for a number of cycles, without ROS: `follow ADDRESS CYCLES [panda|fr3]`. The arm must be an
//! emulated one.
//!
//! Prints the number of cycles, the median, 99th percentile and greatest computing time of a cycle (us), the lost states, and how many
//! times faster than the arm's 1 kHz the cycles came.
#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a program with arguments, a clock and a standard output"
)]

use panda_bridge::fci::{FciLink, FciSettings, Generation};
use std::error::Error;
use std::time::{Duration, Instant};

/// Longest time without a cycle.
const PATIENCE: Duration = Duration::from_secs(15);

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let host = arguments.next().ok_or("expected an address")?;
    let cycles: u64 = arguments.next().ok_or("expected a number of cycles")?.parse()?;
    let generation = match arguments.next().as_deref() {
        None | Some("panda") => Generation::Panda,
        Some("fr3") => Generation::Fr3,
        Some(other) => return Err(format!("expected panda or fr3, got {other}").into()),
    };
    if !host.starts_with("127.") {
        return Err("expected an address of this machine, 127.x.y.z: this program moves the arm without asking".into());
    }
    let settings = FciSettings { priority: 1, ..FciSettings::new(&host, generation) };
    let link = FciLink::start(settings, || std::process::exit(1))?;
    let (mut before, mut since) = (0, Instant::now());
    // The motion has begun when a tenth of the cycles have passed.
    let mut moving = None;
    while link.figures().computing.count() < cycles {
        let count = link.figures().computing.count();
        if count > before {
            (before, since) = (count, Instant::now());
            if count >= cycles / 10 {
                moving.get_or_insert((count, since));
            }
        } else if since.elapsed() > PATIENCE {
            let why = link.unready().unwrap_or_else(|| "the robot sends no states".to_owned());
            return Err(format!("no cycle in {} s after {count} of them: {why}", PATIENCE.as_secs()).into());
        }
        link.follow(link.unready().is_none());
        if let Some(why) = link.take_end() {
            return Err(format!("the motion ended: {why:?}").into());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let figures = link.figures();
    let us = |share| figures.computing.quantile_us(share).unwrap_or_default();
    let (median, p99, longest) = (us(0.5), us(0.99), figures.computing.longest().as_micros());
    let count = figures.computing.count();
    let speed = moving.map_or(0.0, |(from, at)| 1e-3 * (count - from) as f64 / at.elapsed().as_secs_f64());
    println!("{count} {median} {p99} {longest} {} {speed:.1}", figures.lost_states);
    Ok(())
}
