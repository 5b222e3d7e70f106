//! Conversions between [`Time`] and stamps of messages.

use super::point::Time;
use catenary_msgs::{builtin_interfaces, std_msgs};

/// Converts to `builtin_interfaces/Time`. Times outside the years 1901 to 2038 are clamped.
#[must_use]
pub fn to_msg(time: Time) -> builtin_interfaces::msg::Time {
    let seconds = time.nanos().div_euclid(1_000_000_000);
    let nanosec = time.nanos().rem_euclid(1_000_000_000);
    // ROS 2 stamps hold seconds in 32 bits.
    let sec = i32::try_from(seconds).unwrap_or(if seconds < 0 { i32::MIN } else { i32::MAX });
    builtin_interfaces::msg::Time { sec, nanosec: u32::try_from(nanosec).unwrap_or(0) }
}

/// Converts from `builtin_interfaces/Time`.
#[must_use]
pub fn from_msg(stamp: &builtin_interfaces::msg::Time) -> Time {
    Time::from_nanos(i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec))
}

/// Creates a standard header.
#[must_use]
pub fn header(time: Time, frame_id: &str) -> std_msgs::msg::Header {
    std_msgs::msg::Header { stamp: to_msg(time), frame_id: frame_id.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_survive_the_round_trip() {
        for nanos in [0, 1, 999_999_999, 1_000_000_000, -1, -1_500_000_000, 1_763_692_800_123_456_789] {
            let time = Time::from_nanos(nanos);
            assert_eq!(from_msg(&to_msg(time)), time);
        }
    }
}
