//! Checks of what a control loop at 1 kHz needs of the machine: kernel, priority, locked memory and clock of the processors. A machine
//! without a real arm does not need them: they are warnings if a robot is named alone.

use super::check::Check;
use panda_bridge::fci::DEFAULT_PRIORITY;
use panda_bridge::fci::realtime::{
    MEMORY_REMEDY, PRIORITY_REMEDY, memory_lock_refusal, supervisor_priority, try_priority,
};

/// Folder with a folder for each processor.
const PROCESSORS: &str = "/sys/devices/system/cpu";

/// Finding on a means of real time.
#[derive(Debug, PartialEq)]
struct Finding {
    name: &'static str,
    detail: String,
    /// Remedy; `None` if nothing is missing.
    remedy: Option<String>,
}

impl Finding {
    fn judged(self, with_robot: bool) -> Check {
        match self.remedy {
            None => Check::good(self.name, self.detail),
            Some(remedy) if with_robot => Check::warning(self.name, self.detail, remedy),
            Some(_) => Check::good(self.name, format!("{}: matters to a real arm alone, see --robot", self.detail)),
        }
    }
}

/// All checks of real time. `with_robot`: this machine is to drive a real arm.
pub fn checks(with_robot: bool) -> Vec<Check> {
    let flag = std::fs::read_to_string("/sys/kernel/realtime").ok();
    let version = std::fs::read_to_string("/proc/sys/kernel/version").unwrap_or_default();
    let priority = supervisor_priority(DEFAULT_PRIORITY);
    let findings = [
        kernel(flag.as_deref(), version.trim()),
        real_time(priority, try_priority(priority)),
        locked_memory(memory_lock_refusal()),
        governor(&governors()),
    ];
    findings.into_iter().map(|finding| finding.judged(with_robot)).collect()
}

/// Finding on the kernel, from `/sys/kernel/realtime` and `/proc/sys/kernel/version`, which `uname -v` prints.
fn kernel(flag: Option<&str>, version: &str) -> Finding {
    let says_so = ["PREEMPT_RT", "PREEMPT RT"].iter().any(|words| version.contains(words));
    let is_realtime = says_so || flag.is_some_and(|flag| flag.trim() == "1");
    Finding {
        name: "kernel",
        detail: if is_realtime { "PREEMPT_RT".to_owned() } else { format!("no PREEMPT_RT ({version})") },
        remedy: (!is_realtime).then(|| {
            "a motion loses some cycles: install a real-time kernel (Debian: linux-image-rt-amd64; Ubuntu: pro enable realtime-kernel)"
                .to_owned()
        }),
    }
}

/// Finding on the real-time priority, from a try.
fn real_time(priority: i32, tried: Result<(), String>) -> Finding {
    let (detail, remedy) = match tried {
        Ok(()) => (format!("SCHED_FIFO {priority} is granted"), None),
        Err(why) => (format!("SCHED_FIFO {priority} is refused ({why})"), Some(PRIORITY_REMEDY.to_owned())),
    };
    Finding { name: "rtprio", detail, remedy }
}

/// Finding on locked memory, from the reason why a process may not lock all of its memory.
fn locked_memory(refusal: Option<String>) -> Finding {
    let detail = refusal.clone().unwrap_or_else(|| "a process may lock all of its memory".to_owned());
    Finding { name: "memlock", detail, remedy: refusal.map(|_| MEMORY_REMEDY.to_owned()) }
}

/// Governors of the processors that have one.
fn governors() -> Vec<String> {
    let entries = std::fs::read_dir(PROCESSORS).into_iter().flatten().flatten();
    let governor = |entry: std::fs::DirEntry| {
        std::fs::read_to_string(entry.path().join("cpufreq/scaling_governor")).map(|text| text.trim().to_owned())
    };
    entries.filter_map(|entry| governor(entry).ok()).collect()
}

/// Finding on the clock of the processors, from the governor of each.
fn governor(found: &[String]) -> Finding {
    let slow: Vec<&String> = found.iter().filter(|governor| *governor != "performance").collect();
    let set = "sudo cpupower frequency-set --governor performance";
    let (detail, remedy) = match (found.len(), slow.as_slice()) {
        (0, _) => (
            format!(
                "cannot be told, because {PROCESSORS}/cpu*/cpufreq is missing, as in a virtual machine or a container"
            ),
            Some(format!("a processor that saves power is late for the robot: on the machine itself, {set}")),
        ),
        (n, []) => (format!("performance on all {n} processors"), None),
        (n, [first, ..]) => {
            (format!("{first} on {} of {n} processors", slow.len()), Some(format!("it delays the control loop: {set}")))
        }
    };
    Finding { name: "CPU governor", detail, remedy }
}

#[cfg(test)]
mod tests {
    use super::super::check::Verdict::{Good, Warning};
    use super::*;

    #[test]
    fn a_real_time_kernel_is_known_by_its_flag_or_its_version() {
        let debian = "#1 SMP PREEMPT_RT Debian 6.1.90-1 (2024-05-03)";
        let old = "#1 SMP PREEMPT RT Wed Feb 5 12:00:00 UTC 2020";
        let common = "#1 SMP PREEMPT_DYNAMIC Debian 6.1.90-1 (2024-05-03)";
        let lacks = |flag, version| kernel(flag, version).remedy.is_some();
        assert_eq!([lacks(None, debian), lacks(None, old), lacks(Some("1\n"), common)], [false; 3]);
        assert_eq!([lacks(None, common), lacks(Some("0\n"), common)], [true; 2]);
    }

    #[test]
    fn a_lack_is_a_warning_for_a_real_arm_alone() {
        let lack = || real_time(81, Err("not permitted".to_owned()));
        let (with, without) = (lack().judged(true), lack().judged(false));
        assert_eq!((with.verdict, without.verdict), (Warning, Good));
        assert!(with.remedy.unwrap().contains("limits.conf") && without.detail.contains("--robot"));
        assert_eq!(real_time(81, Ok(())).judged(true).verdict, Good);
        let locked = [None, Some("the limit of locked memory is 8192 KiB".to_owned())].map(locked_memory);
        assert_eq!(locked.map(|finding| finding.judged(true).verdict), [Good, Warning]);
    }

    #[test]
    fn each_processor_counts_for_the_governor() {
        let of = |names: &[&str]| governor(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        assert_eq!(of(&["performance", "performance"]).remedy, None);
        let mixed = of(&["performance", "powersave", "powersave"]);
        assert_eq!(mixed.detail, "powersave on 2 of 3 processors");
        assert!(of(&[]).detail.starts_with("cannot be told, because"));
    }
}
