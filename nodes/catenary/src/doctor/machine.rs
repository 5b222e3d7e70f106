//! Checks of the machine: cores, network buffers, disk space, Python and ffmpeg.

use super::check::Check;
use rustix::fs::{Access, access, statvfs};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Socket buffer below which camera images are lost between our nodes and other vendors', bytes.
const WANTED_BUFFER: u64 = 4 * 1024 * 1024;
/// Bytes of a camera image of 640 x 480 pixels. A socket whose program asks for no size must hold one at least.
const IMAGE: u64 = 640 * 480 * 3;
/// Free disk space below which a session may fill the disk, bytes. Camera images take 28 MB/s, so that this lasts three
/// minutes.
const WANTED_SPACE: u64 = 5_000_000_000;
/// Free disk space below which a demo does not fit, bytes.
const LEAST_SPACE: u64 = 200_000_000;
/// Python versions that tests and tools are run with.
const PYTHONS: [&str; 2] = ["3.11", "3.12"];

/// All checks of the machine.
pub fn checks() -> Vec<Check> {
    let mut checks = vec![cores(), loopback()];
    checks.push(buffer("receive buffer", "rmem_max"));
    checks.push(default_buffer(&setting("rmem_default")));
    checks.push(buffer("send buffer", "wmem_max"));
    checks.push(disk("disk", Path::new(".")));
    checks.push(match catenary_shell::ros_log_dir() {
        Some(folder) => disk("logs", &folder),
        None => Check::warning("logs", "there is no home folder for them", "set ROS_LOG_DIR to a folder for logs"),
    });
    checks.push(ffmpeg(program("ffmpeg")));
    checks.push(python());
    checks
}

fn cores() -> Check {
    match catenary_simulator::workers::available() {
        n if n >= 2 => Check::good("cores", n.to_string()),
        n => Check::warning("cores", n.to_string(), "the demo is meant for two and more: it takes longer"),
    }
}

/// Checks that a UDP packet on the loopback interface arrives.
pub fn loopback() -> Check {
    let send = || -> std::io::Result<usize> {
        let receiver = UdpSocket::bind("127.0.0.1:0")?;
        receiver.set_read_timeout(Some(Duration::from_secs(1)))?;
        let sender = UdpSocket::bind("127.0.0.1:0")?;
        sender.send_to(b"catenary", receiver.local_addr()?)?;
        receiver.recv(&mut [0; 16])
    };
    match send() {
        Ok(_) => Check::good("loopback", "a UDP packet came back"),
        Err(e) => Check::bad("loopback", format!("no UDP over 127.0.0.1: {e}"), "sudo ip link set lo up"),
    }
}

/// Text of a setting of the kernel's network; empty if it cannot be read.
fn setting(variable: &str) -> String {
    std::fs::read_to_string(format!("/proc/sys/net/core/{variable}")).unwrap_or_default()
}

/// Check of the receive buffer of sockets whose program asks for no size. Our nodes ask for one.
fn default_buffer(text: &str) -> Check {
    let name = "default buffer";
    let remedy = format!(
        "for ROS 2's own nodes, set a Fast DDS profile of launch_configs, or: sudo sysctl -w net.core.rmem_default={WANTED_BUFFER}"
    );
    match text.trim().parse::<u64>() {
        Ok(bytes) if bytes >= IMAGE => Check::good(name, format!("net.core.rmem_default is {bytes} bytes")),
        Ok(bytes) => Check::warning(
            name,
            format!("net.core.rmem_default is {bytes} bytes: programs that ask for no buffer lose images of {IMAGE}"),
            remedy,
        ),
        Err(_) => Check::warning(name, "net.core.rmem_default could not be read, as in a container", remedy),
    }
}

fn buffer(name: &'static str, variable: &str) -> Check {
    let text = setting(variable);
    let variable = format!("net.core.{variable}");
    match text.trim().parse::<u64>() {
        Ok(bytes) if bytes >= WANTED_BUFFER => Check::good(name, format!("{variable} is {bytes} bytes")),
        Ok(bytes) => Check::warning(
            name,
            format!("{variable} is {bytes} bytes; {WANTED_BUFFER} keep images whole between DDS vendors"),
            format!("sudo sysctl -w {variable}={WANTED_BUFFER}"),
        ),
        Err(_) => Check::warning(
            name,
            format!("{variable} could not be read, as in a container"),
            format!("where images get lost: sudo sysctl -w {variable}={WANTED_BUFFER} on the host"),
        ),
    }
}

/// Checks that files can be written at `path`, or at its nearest existing ancestor.
fn disk(name: &'static str, path: &Path) -> Check {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let there = path.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("/"));
    if !there.is_dir() || access(there, Access::WRITE_OK).is_err() {
        let remedy = "go to another folder, or have its owner change its rights";
        return Check::warning(name, format!("{}: nothing can be written there", there.display()), remedy);
    }
    match statvfs(there) {
        Ok(disk) => space(name, &path, disk.f_bavail * disk.f_frsize),
        Err(e) => Check::warning(name, format!("{}: {e}", there.display()), "see `df`"),
    }
}

fn space(name: &'static str, path: &Path, free: u64) -> Check {
    let detail = format!("{:.1} GB free for {}", free as f64 * 1e-9, path.display());
    match free {
        free if free >= WANTED_SPACE => Check::good(name, detail),
        free if free >= LEAST_SPACE => {
            Check::warning(name, detail, "enough for a demo; a recording with images takes 28 MB a second")
        }
        _ => Check::bad(name, detail, "make room: recordings and results do not fit"),
    }
}

/// Path of a program on the PATH.
fn program(name: &str) -> Option<PathBuf> {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&paths).map(|folder| folder.join(name)).find(|path| access(path, Access::EXEC_OK).is_ok())
}

fn ffmpeg(path: Option<PathBuf>) -> Check {
    match path {
        Some(path) => Check::good("ffmpeg", path.display().to_string()),
        None => Check::warning("ffmpeg", "not on the PATH", "`simulate --video` makes NAME.gif, but no NAME.mp4"),
    }
}

fn python() -> Check {
    // One process for both questions: a start of Python takes a noticeable time.
    let code = "import sys; print('%d.%d' % sys.version_info[:2])\ntry: import rclpy; print(rclpy.__file__)\nexcept ImportError as e: print('no', e)";
    let mut names = vec!["python3".to_owned()];
    names.extend(PYTHONS.map(|version| format!("python{version}")));
    let Some(path) = names.iter().find_map(|name| program(name)) else {
        return Check::warning("Python", "no python3 on the PATH", "only the tests and nodes/inspect need it");
    };
    let run = Command::new(&path).args(["-c", code]).stdin(Stdio::null()).stderr(Stdio::null()).output();
    let text = run.map(|done| String::from_utf8_lossy(&done.stdout).into_owned()).unwrap_or_default();
    python_words(&path, &text)
}

/// Check from a Python's own report: its version, and the path of its rclpy.
fn python_words(path: &Path, said: &str) -> Check {
    let mut lines = said.lines();
    let (version, rclpy) = (lines.next().unwrap_or("?"), lines.next().unwrap_or("no"));
    let detail = format!("{version}, {}", path.display());
    if !PYTHONS.contains(&version) {
        let remedy = format!("the tests and nodes/inspect need Python {}", PYTHONS.join(" or "));
        return Check::warning("Python", detail, remedy);
    }
    match rclpy.starts_with("no") {
        true => Check::warning(
            "Python",
            format!("{detail}; it has no rclpy"),
            "only the tests and nodes/inspect need it: source /opt/ros/jazzy/setup.bash, or .venv/ros.env of the tests",
        ),
        false => Check::good("Python", format!("{detail}, with rclpy")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::Verdict::{Bad, Good, Warning};
    use super::*;

    #[test]
    fn the_loopback_interface_is_there() {
        assert_eq!(loopback().verdict, Good);
    }

    #[test]
    fn a_buffer_that_holds_no_image_is_a_warning() {
        let of = |text| default_buffer(text).verdict;
        assert_eq!([of("4194304\n"), of("212992\n"), of("")], [Good, Warning, Warning]);
    }

    #[test]
    fn free_space_is_compared_with_the_need_of_a_session() {
        let of = |free| space("disk", Path::new("/data"), free).verdict;
        assert_eq!([of(100_000_000_000), of(1_000_000_000), of(1_000_000)], [Good, Warning, Bad]);
        assert_eq!(disk("logs", Path::new("/dev/null/at/all")).verdict, Warning);
    }

    #[test]
    fn a_python_without_rclpy_or_of_another_version_is_named() {
        let of = |said| python_words(Path::new("/usr/bin/python3"), said);
        assert_eq!(of("3.12\n/opt/ros/jazzy/rclpy/__init__.py\n").verdict, Good);
        assert!(of("3.12\nno module\n").detail.contains("no rclpy"));
        assert!(of("3.9\nno module\n").remedy.unwrap().contains("3.11 or 3.12"));
        assert_eq!(of("").verdict, Warning);
    }

    #[test]
    fn a_missing_ffmpeg_costs_one_kind_of_video() {
        assert_eq!(ffmpeg(None).verdict, Warning);
        assert_eq!(ffmpeg(Some("/usr/bin/ffmpeg".into())).verdict, Good);
    }
}
