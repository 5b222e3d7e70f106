//! `catenary doctor`: what on this machine would keep the graph from working.

use crate::cli::DoctorArgs;
use crate::{model_file, output};
use anyhow::{Context, Result, bail};
use serde::Serialize;
use std::net::UdpSocket;

/// Receive buffer below which camera images get lost on their way to other vendors' nodes, bytes.
const WANTED_RECEIVE_BUFFER: u64 = 4 * 1024 * 1024;
/// Participants of one domain on one host that are looked for.
const PARTICIPANTS: u16 = 12;

/// One thing that was looked at.
#[derive(Debug, Serialize)]
struct Check {
    name: &'static str,
    verdict: Verdict,
    detail: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Verdict {
    Good,
    Warning,
    Bad,
}

/// Runs the checks; fails where one of them says that the graph cannot work.
pub fn run(arguments: &DoctorArgs) -> Result<()> {
    let mut checks = vec![cores(), domain(), discovery_range(), receive_buffer(), loopback()];
    if let Some(path) = &arguments.model {
        checks.push(model(path)?);
    }
    output::result(&arguments.output, &checks, |checks| {
        let line = |c: &Check| {
            let word = match c.verdict {
                Verdict::Good => "ok     ",
                Verdict::Warning => "warning",
                Verdict::Bad => "BAD    ",
            };
            format!("{word}  {:<18} {}", c.name, c.detail)
        };
        checks.iter().map(line).collect::<Vec<_>>().join("\n")
    })?;
    match checks.iter().filter(|c| c.verdict == Verdict::Bad).count() {
        0 => Ok(()),
        n => bail!("{n} of {} checks say that the graph cannot work here", checks.len()),
    }
}

fn check(name: &'static str, verdict: Verdict, detail: String) -> Check {
    Check { name, verdict, detail }
}

fn cores() -> Check {
    let n = simulator_pool::workers::available();
    let verdict = if n >= 2 { Verdict::Good } else { Verdict::Warning };
    check("cores", verdict, format!("{n}; the demo is meant for two and more"))
}

/// RTPS 2.5, section 9.6.1.1: the unicast discovery port of participant p in domain d is 7400 + 250 d + 10 + 2 p.
fn discovery_port(domain: u16, participant: u16) -> u16 {
    7400 + 250 * domain + 10 + 2 * participant
}

fn domain_id() -> Result<u16> {
    match std::env::var("ROS_DOMAIN_ID") {
        Err(_) => Ok(0),
        Ok(text) => text
            .parse()
            .ok()
            .filter(|d| *d <= 232)
            .with_context(|| format!("ROS_DOMAIN_ID: expected a whole number of 0 to 232, got `{text}`")),
    }
}

fn domain() -> Check {
    let domain = match domain_id() {
        Ok(domain) => domain,
        Err(e) => return check("domain", Verdict::Bad, e.to_string()),
    };
    let taken = (0..PARTICIPANTS).filter(|p| UdpSocket::bind(("0.0.0.0", discovery_port(domain, *p))).is_err()).count();
    let detail = format!("ROS_DOMAIN_ID {domain}; {taken} of its first {PARTICIPANTS} participant ports are in use");
    let verdict = match taken {
        0 => Verdict::Good,
        n if n < usize::from(PARTICIPANTS) => Verdict::Warning,
        _ => Verdict::Bad,
    };
    let hint = if taken > 0 { ": other ROS 2 nodes run here; another ROS_DOMAIN_ID keeps them apart" } else { "" };
    check("domain", verdict, detail + hint)
}

fn discovery_range() -> Check {
    let range = std::env::var("ROS_AUTOMATIC_DISCOVERY_RANGE").unwrap_or_else(|_| "SUBNET".to_owned());
    let verdict = match range.as_str() {
        "LOCALHOST" | "SUBNET" | "SYSTEM_DEFAULT" => Verdict::Good,
        _ => Verdict::Bad,
    };
    check("discovery range", verdict, format!("{range}; LOCALHOST, SUBNET and SYSTEM_DEFAULT work"))
}

fn receive_buffer() -> Check {
    let text = std::fs::read_to_string("/proc/sys/net/core/rmem_max").unwrap_or_default();
    let Ok(bytes) = text.trim().parse::<u64>() else {
        return check("receive buffer", Verdict::Warning, "net.core.rmem_max could not be read".to_owned());
    };
    let verdict = if bytes >= WANTED_RECEIVE_BUFFER { Verdict::Good } else { Verdict::Warning };
    let detail =
        format!("net.core.rmem_max {bytes} bytes; {WANTED_RECEIVE_BUFFER} keep images whole between DDS vendors");
    check("receive buffer", verdict, detail)
}

fn loopback() -> Check {
    let send = || -> std::io::Result<usize> {
        let receiver = UdpSocket::bind("127.0.0.1:0")?;
        receiver.set_read_timeout(Some(std::time::Duration::from_secs(1)))?;
        let sender = UdpSocket::bind("127.0.0.1:0")?;
        sender.send_to(b"catenary", receiver.local_addr()?)?;
        receiver.recv(&mut [0; 16])
    };
    match send() {
        Ok(_) => check("loopback", Verdict::Good, "a UDP packet came back".to_owned()),
        Err(e) => check("loopback", Verdict::Bad, format!("no UDP over 127.0.0.1: {e}")),
    }
}

fn model(path: &std::path::Path) -> Result<Check> {
    std::fs::metadata(path).with_context(|| format!("model {}", path.display()))?;
    Ok(match model_file::read(path) {
        Ok(m) => check(
            "model",
            Verdict::Good,
            format!("{}: `{}`, {} inferred parameters", path.display(), m.name, m.theta.dimension()),
        ),
        Err(e) => check("model", Verdict::Bad, format!("{e:#}")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_follow_the_rtps_formula() {
        assert_eq!(discovery_port(0, 0), 7410);
        assert_eq!(discovery_port(42, 3), 17916);
    }

    #[test]
    fn a_taken_port_is_counted() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let port = socket.local_addr().unwrap().port();
        assert!(UdpSocket::bind(("0.0.0.0", port)).is_err());
        assert_eq!(loopback().verdict, Verdict::Good);
    }
}
