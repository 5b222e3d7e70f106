//! Limit on the memory of a node's process.
//!
//! A node that is given too much to hold, by a fault or by a sender of ill will, ends with an error of its allocator, and a launch file
//! may start it again. Without a limit the kernel would end another process of the machine, or the machine would stall. The limit
//! counts what the process may write and shares with none (`RLIMIT_DATA`): mapped files do not count, reserved address space of the
//! allocator does (1 GiB at the start).

use crate::error::ShellError;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Environment variable with the limit, MiB; 0 means none.
const VARIABLE: &str = "CATENARY_MEMORY_LIMIT_MIB";
/// Default of the variable. Nodes need up to some hundred MiB.
const DEFAULT_MIB: u64 = 4096;
/// Least limit, MiB: the reserve of the allocator, and a quarter as much for the node. With less than the reserve a node could not even start its
/// threads, and a launch would start it again and again.
const LEAST_MIB: u64 = 1280;

/// Limits the memory of this process and of its children, as the environment says.
pub(super) fn apply(variable: &dyn Fn(&str) -> Option<String>) -> Result<(), ShellError> {
    let Some(limit) = limit(variable)? else { return Ok(()) };
    let Rlimit { current, maximum } = getrlimit(Resource::Data);
    // A stricter limit of the user or of the system stays.
    let stricter = [current, maximum].into_iter().flatten().min().unwrap_or(u64::MAX);
    if stricter > limit {
        setrlimit(Resource::Data, Rlimit { current: Some(limit), maximum })
            .map_err(|error| ShellError::create(format!("{VARIABLE}={}", limit >> 20), error))?;
    }
    Ok(())
}

/// Returns the limit in bytes; `None` without limit.
fn limit(variable: &dyn Fn(&str) -> Option<String>) -> Result<Option<u64>, ShellError> {
    let mib = match variable(VARIABLE).filter(|value| !value.is_empty()) {
        None => DEFAULT_MIB,
        Some(value) => {
            let mib = value.parse().ok().filter(|mib| *mib == 0 || (LEAST_MIB..=u64::MAX >> 20).contains(mib));
            mib.ok_or(ShellError::Environment {
                variable: VARIABLE,
                value,
                expected: "0 (no limit), or an integer from 1280",
            })?
        }
    };
    Ok((mib > 0).then_some(mib << 20))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_read_from_the_environment() {
        let read = |value: Option<&str>| limit(&|_| value.map(str::to_owned));
        for (value, expected) in
            [(None, Some(4 << 30)), (Some(""), Some(4 << 30)), (Some("0"), None), (Some("1280"), Some(1280 << 20))]
        {
            assert_eq!(read(value).unwrap(), expected, "{value:?}");
        }
        for wrong in ["1279", "-1", "4GiB", "18446744073709551615"] {
            let error = read(Some(wrong)).unwrap_err();
            assert!(error.is_usage() && error.to_string().contains(VARIABLE), "{error}");
        }
    }
}
