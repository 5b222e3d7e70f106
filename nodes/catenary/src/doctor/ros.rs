//! Checks of the ROS 2 environment: settings that separate nodes from one another.

use super::check::Check;
use super::daemon;
use catenary_core::spelling::did_you_mean;
use catenary_shell::{NodeBuilder, RosArgs, ShellError, domain_id, files};
use std::net::UdpSocket;
use std::path::Path;
use std::time::Duration;

/// Participants of one domain on one host whose ports are probed.
const PARTICIPANTS: u16 = 12;
/// Time in which the nodes of the domain answer.
const LOOK: Duration = Duration::from_millis(1500);
/// Largest number of nodes that are listed by name.
const NAMED: usize = 8;
/// ROS 2 middlewares that speak DDS and meet our nodes.
const SPEAK_DDS: [&str; 3] = ["rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp", "rmw_cyclonedds_cpp"];
/// Further middlewares of ROS 2.
const OTHERS: [&str; 3] = ["rmw_connextdds", "rmw_zenoh_cpp", "rmw_gurumdds_cpp"];
/// Discovery ranges that our nodes support.
const RANGES: [&str; 3] = ["SUBNET", "LOCALHOST", "SYSTEM_DEFAULT"];

/// All checks of the ROS 2 environment.
pub fn checks() -> Vec<Check> {
    let mut checks = vec![domain(), graphs()];
    checks.push(range(variable("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref()));
    checks.extend(domain_id().ok().map(daemon::check));
    checks.push(localhost_only(variable("ROS_LOCALHOST_ONLY").as_deref()));
    checks.push(middleware(variable("RMW_IMPLEMENTATION").as_deref()));
    let profiles = ["FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"];
    checks.push(profile(&profiles.map(|name| (name, variable(name)))));
    checks
}

/// Value of an environment variable. An empty one counts as unset, as in ROS 2.
fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.is_empty())
}

/// Unicast discovery port of participant p in domain d: 7400 + 250 d + 10 + 2 p (RTPS 2.5, section 9.6.1.1).
fn discovery_port(domain: u16, participant: u16) -> u16 {
    7400 + 250 * domain + 10 + 2 * participant
}

fn domain() -> Check {
    let domain = match domain_id() {
        Ok(domain) => domain,
        Err(error) => return Check::bad("domain", error.to_string(), "correct the variable, or unset it"),
    };
    // A port that cannot be bound belongs to a participant on this host.
    let taken = (0..PARTICIPANTS).filter(|p| UdpSocket::bind(("0.0.0.0", discovery_port(domain, *p))).is_err()).count();
    let detail = format!("ROS_DOMAIN_ID {domain}; {taken} of its first {PARTICIPANTS} participant ports are in use");
    match taken {
        0 => Check::good("domain", detail),
        n if n < usize::from(PARTICIPANTS) => {
            Check::warning("domain", detail, "other ROS 2 nodes run on this machine: see the next line")
        }
        _ => Check::bad("domain", detail, "end nodes that are left over, or set another ROS_DOMAIN_ID"),
    }
}

fn graphs() -> Check {
    match neighbours() {
        Ok(nodes) => others(&nodes),
        Err(error) => Check::bad("other graphs", error.to_string(), "no node can join the domain"),
    }
}

/// Other nodes of the domain, each with its process or its host.
fn neighbours() -> Result<Vec<String>, ShellError> {
    let node = NodeBuilder::new("doctor", &RosArgs::default())?.build()?;
    Ok(node.look_around(LOOK).iter().map(ToString::to_string).collect())
}

fn others(nodes: &[String]) -> Check {
    let named: Vec<&str> = nodes.iter().take(NAMED).map(String::as_str).collect();
    let more = nodes.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    match nodes.len() {
        0 => Check::good("other graphs", "no node answers in this domain"),
        n => Check::warning(
            "other graphs",
            format!("{n} nodes answer in this domain: {}{more}", named.join(", ")),
            "a graph started here joins them; another ROS_DOMAIN_ID keeps graphs apart",
        ),
    }
}

fn range(value: Option<&str>) -> Check {
    match value {
        None => Check::good("discovery range", "SUBNET, as ROS_AUTOMATIC_DISCOVERY_RANGE is not set"),
        Some(range) if RANGES.contains(&range) => Check::good("discovery range", range),
        Some(other) => Check::bad(
            "discovery range",
            format!("ROS_AUTOMATIC_DISCOVERY_RANGE={other}: expected {}", RANGES.join(" or ")),
            format!("no node starts with it{}", did_you_mean(other, RANGES)),
        ),
    }
}

fn localhost_only(value: Option<&str>) -> Check {
    match value {
        None => Check::good("localhost only", "ROS_LOCALHOST_ONLY is not set"),
        Some("0") => Check::good("localhost only", "ROS_LOCALHOST_ONLY=0"),
        Some(value) => Check::warning(
            "localhost only",
            format!("ROS_LOCALHOST_ONLY={value} overrules the discovery range, and is deprecated"),
            "unset it, and set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",
        ),
    }
}

fn middleware(value: Option<&str>) -> Check {
    match value {
        None => Check::good("middleware", "RMW_IMPLEMENTATION is not set: ROS 2's own nodes use Fast DDS"),
        Some(known) if SPEAK_DDS.contains(&known) => Check::good("middleware", format!("RMW_IMPLEMENTATION={known}")),
        Some("rmw_zenoh_cpp") => Check::warning(
            "middleware",
            "RMW_IMPLEMENTATION=rmw_zenoh_cpp: our nodes speak DDS and do not meet nodes that speak Zenoh",
            "start the others with rmw_fastrtps_cpp or rmw_cyclonedds_cpp",
        ),
        Some(other) => {
            let hint = did_you_mean(other, SPEAK_DDS.into_iter().chain(OTHERS));
            Check::warning(
                "middleware",
                format!("RMW_IMPLEMENTATION={other} was not tried with our nodes{hint}"),
                format!("these were: {}", SPEAK_DDS.join(", ")),
            )
        }
    }
}

/// Check of the Fast DDS profiles. They concern other ROS 2 nodes: ours read none.
fn profile(variables: &[(&str, Option<String>)]) -> Check {
    let set: Vec<(&str, &String)> = variables.iter().filter_map(|(name, path)| Some((*name, path.as_ref()?))).collect();
    let unreadable = set.iter().find(|(_, path)| !Path::new(path).is_file());
    match (set.as_slice(), unreadable) {
        ([], _) => Check::good("Fast DDS profile", "none is set"),
        (_, Some((name, path))) => Check::warning(
            "Fast DDS profile",
            format!("{name}={path}: no such file{}", files::hint(Path::new(path))),
            "ROS 2's own nodes run without a profile; correct the path, or unset the variable",
        ),
        ([(a, first), (b, second)], None) if first != second => Check::warning(
            "Fast DDS profile",
            format!("{a}={first} and {b}={second} differ"),
            "unset one of them: which one counts depends on the version of Fast DDS",
        ),
        ([(name, path), ..], None) => Check::good("Fast DDS profile", format!("{name}={path}")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::Verdict::{Bad, Good, Warning};
    use super::*;

    #[test]
    fn ports_follow_the_rtps_formula() {
        assert_eq!(discovery_port(0, 0), 7410);
        // 7400 + 250 * 42 + 10 + 2 * 3.
        assert_eq!(discovery_port(42, 3), 17916);
    }

    #[test]
    fn nodes_of_others_are_named() {
        assert_eq!(others(&[]).verdict, Good);
        let nodes: Vec<String> = (0..10).map(|n| format!("/lab/node_{n}")).collect();
        let check = others(&nodes);
        assert_eq!(check.verdict, Warning);
        assert!(check.detail.contains("10 nodes") && check.detail.contains("/lab/node_7 and 2 more"), "{check:?}");
    }

    #[test]
    fn settings_that_separate_nodes_are_found() {
        assert_eq!(
            [range(None).verdict, range(Some("LOCALHOST")).verdict, range(Some("OFF")).verdict],
            [Good, Good, Bad]
        );
        assert!(range(Some("localhost")).remedy.unwrap().contains("did you mean `LOCALHOST`?"));
        let localhost = [None, Some("0"), Some("1")].map(|value| localhost_only(value).verdict);
        assert_eq!(localhost, [Good, Good, Warning]);
        let middleware = |value| middleware(Some(value));
        assert_eq!(middleware("rmw_cyclonedds_cpp").verdict, Good);
        assert!(middleware("rmw_zenoh_cpp").detail.contains("Zenoh"));
        assert!(middleware("rmw_fastrtps").detail.contains("did you mean `rmw_fastrtps_cpp`?"));
    }

    #[test]
    fn a_missing_or_ambiguous_profile_is_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        let there = folder.path().join("fast.xml").display().to_string();
        std::fs::write(&there, "<dds/>").unwrap();
        let of =
            |a: Option<&str>, b: Option<&str>| profile(&[("A", a.map(str::to_owned)), ("B", b.map(str::to_owned))]);
        assert_eq!([of(None, None).verdict, of(None, Some(&there)).verdict], [Good, Good]);
        let wrong = folder.path().join("fastt.xml").display().to_string();
        let check = of(Some(&wrong), None);
        assert!(check.verdict == Warning && check.detail.contains(&format!("did you mean `{there}`?")), "{check:?}");
        let other = folder.path().join("other.xml").display().to_string();
        std::fs::write(&other, "<dds/>").unwrap();
        assert_eq!(of(Some(&there), Some(&other)).verdict, Warning);
    }
}
