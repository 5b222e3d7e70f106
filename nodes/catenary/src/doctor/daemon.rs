//! Check of the daemon of `ros2`, which answers `ros2 topic list` and the like from what it heard itself.
//!
//! It keeps the settings of the command that started it. With another discovery range than the graph it shows an empty list, and the graph
//! runs well.

use super::check::Check;
use std::path::Path;

const NAME: &str = "ros2 daemon";
/// Variables that decide which nodes a daemon hears.
const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
const LOCALHOST_ONLY: &str = "ROS_LOCALHOST_ONLY";

/// Daemon of a domain. `range`: what it hears; none if only its owner may know.
#[derive(Debug, PartialEq, Eq)]
struct Daemon {
    pid: u32,
    range: Option<String>,
}

/// Compares the daemons of this domain with the settings here.
pub fn check(domain: u16) -> Check {
    let own = |name: &str| std::env::var(name).ok();
    compare(&daemons(Path::new("/proc"), domain), &range_of(own))
}

fn compare(daemons: &[Daemon], here: &str) -> Check {
    let Some(daemon) = daemons.iter().find(|daemon| daemon.range.as_deref() != Some(here)).or(daemons.first()) else {
        return Check::good(NAME, "none runs for this domain");
    };
    let remedy = "ros2 daemon stop; the next `ros2` command starts it anew, with the settings of its terminal";
    let pid = daemon.pid;
    match daemon.range.as_deref() {
        Some(range) if range == here => Check::good(NAME, format!("process {pid} hears {range}, as nodes here do")),
        Some(range) => Check::warning(
            NAME,
            format!(
                "process {pid} hears {range}, and nodes here {here}: `ros2 topic list` may show nothing of this graph"
            ),
            remedy,
        ),
        None => Check::warning(
            NAME,
            format!(
                "process {pid} of another user answers for this domain; if `ros2 topic list` shows nothing, it hears another range"
            ),
            "ros2 topic list --no-daemon",
        ),
    }
}

/// Daemons of a domain, by the arguments with which `ros2` starts them, in a folder of the form of `/proc`.
fn daemons(proc: &Path, domain: u16) -> Vec<Daemon> {
    let Ok(folders) = std::fs::read_dir(proc) else { return Vec::new() };
    let mut found: Vec<Daemon> = folders
        .filter_map(|folder| {
            let folder = folder.ok()?.path();
            let pid = folder.file_name()?.to_str()?.parse().ok()?;
            let text = |name: &str| std::fs::read(folder.join(name)).ok();
            let line = text("cmdline")?;
            let words: Vec<&[u8]> = line.split(|byte| *byte == 0).collect();
            let has = |option: &str, value: &str| words.windows(2).any(|w| w == [option.as_bytes(), value.as_bytes()]);
            let is_one = has("--name", "ros2-daemon") && has("--ros-domain-id", &domain.to_string());
            let range = |environment: Vec<u8>| range_of(|name| value_in(&environment, name));
            is_one.then(|| Daemon { pid, range: text("environ").map(range) })
        })
        .collect();
    found.sort_by_key(|daemon| daemon.pid);
    found
}

/// Value of a variable in an environment in the form of `/proc/PID/environ`.
fn value_in(environment: &[u8], name: &str) -> Option<String> {
    let entry = |entry: &[u8]| {
        let (key, value) = std::str::from_utf8(entry).ok()?.split_once('=')?;
        (key == name).then(|| value.to_owned())
    };
    environment.split(|byte| *byte == 0).find_map(entry)
}

/// Range that the variables of an environment choose.
fn range_of(variable: impl Fn(&str) -> Option<String>) -> String {
    let set = |name: &str| variable(name).filter(|value| !value.is_empty());
    match (set(LOCALHOST_ONLY).as_deref(), set(RANGE)) {
        (Some("1"), _) => "LOCALHOST".to_owned(),
        (_, None) => "SUBNET".to_owned(),
        (_, Some(range)) if range == "SYSTEM_DEFAULT" => "SUBNET".to_owned(),
        (_, Some(range)) => range,
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::Verdict::{Good, Warning};
    use super::*;

    /// Makes the folder of a process.
    fn process(proc: &Path, pid: u32, words: &[&str], environment: Option<&[&str]>) {
        let folder = proc.join(pid.to_string());
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join("cmdline"), words.join("\0") + "\0").unwrap();
        if let Some(environment) = environment {
            std::fs::write(folder.join("environ"), environment.join("\0")).unwrap();
        }
    }

    #[test]
    fn daemons_of_the_domain_are_found_with_their_range() {
        let folder = tempfile::tempdir().unwrap();
        let of = |domain| {
            let code = "from ros2cli.daemon.daemonize import main; main()";
            [
                "python3",
                "-c",
                code,
                "--name",
                "ros2-daemon",
                "--ros-domain-id",
                domain,
                "--rmw-implementation",
                "rmw_fastrtps_cpp",
            ]
        };
        process(folder.path(), 30, &of("7"), Some(&["HOME=/root", "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"]));
        process(folder.path(), 40, &of("7"), Some(&["HOME=/root"]));
        process(folder.path(), 50, &of("7"), None);
        process(folder.path(), 60, &of("8"), Some(&[]));
        process(folder.path(), 70, &["python3", "robot.py", "--ros-domain-id", "7"], Some(&[]));
        std::fs::create_dir(folder.path().join("self")).unwrap();
        let daemon = |pid, range: Option<&str>| Daemon { pid, range: range.map(str::to_owned) };
        let expected = [daemon(30, Some("LOCALHOST")), daemon(40, Some("SUBNET")), daemon(50, None)];
        assert_eq!(daemons(folder.path(), 7), expected);
        assert_eq!(daemons(folder.path(), 9), []);
    }

    #[test]
    fn a_daemon_with_another_range_is_named_with_the_way_out() {
        let daemon = |range: Option<&str>| vec![Daemon { pid: 5, range: range.map(str::to_owned) }];
        assert_eq!(compare(&[], "SUBNET").verdict, Good);
        assert_eq!(compare(&daemon(Some("SUBNET")), "SUBNET").verdict, Good);
        let check = compare(&daemon(Some("SUBNET")), "LOCALHOST");
        assert!(check.verdict == Warning && check.detail.contains("process 5 hears SUBNET, and nodes here LOCALHOST"));
        assert!(check.remedy.unwrap().starts_with("ros2 daemon stop"));
        assert_eq!(compare(&daemon(None), "SUBNET").verdict, Warning);
    }

    #[test]
    fn the_range_follows_both_variables() {
        let of = |only: &str, range: &str| {
            let (only, range) = (only.to_owned(), range.to_owned());
            range_of(move |name| Some(if name == RANGE { range.clone() } else { only.clone() }))
        };
        assert_eq!(
            [of("", ""), of("0", "SYSTEM_DEFAULT"), of("1", "SUBNET"), of("", "OFF")],
            ["SUBNET", "SUBNET", "LOCALHOST", "OFF"]
        );
    }
}
