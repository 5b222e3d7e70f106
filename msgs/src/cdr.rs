//! CDR, the encoding of messages on the wire and in bags: little-endian XCDR1 after a 4-byte encapsulation header.

use serde::{Serialize, de::DeserializeOwned};

/// Encapsulation header of plain CDR, little-endian, without options (RTPS 2.5, chapter 10).
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Error of decoding or encoding a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CdrError {
    /// Fewer bytes than an encapsulation header; holds their number.
    Short(usize),
    /// Representation other than plain CDR; holds its identifier.
    Representation([u8; 2]),
    /// Content that is not a message of the type; holds the decoder's message.
    Content(String),
}

impl std::fmt::Display for CdrError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Short(n) => write!(f, "expected a CDR message of at least 4 bytes, got {n}"),
            Self::Representation(r) => write!(f, "expected plain CDR (0x0000 or 0x0001), got representation {r:02x?}"),
            Self::Content(e) => write!(f, "the CDR message is not of the expected type: {e}"),
        }
    }
}

impl std::error::Error for CdrError {}

/// Encodes `message` with its encapsulation header.
///
/// # Errors
/// [`CdrError::Content`] for a `T` without a form in CDR, for example a sequence of unknown length. Generated types never fail.
pub fn to_cdr<T: Serialize>(message: &T) -> Result<Vec<u8>, CdrError> {
    let mut bytes = HEADER.to_vec();
    // CDR alignment starts after the header. The serialiser counts only the bytes that it writes itself.
    cdr_encoding::to_writer::<T, byteorder::LittleEndian, _>(&mut bytes, message)
        .map_err(|e| CdrError::Content(e.to_string()))?;
    Ok(bytes)
}

/// Decodes the message in `bytes`, which begin with an encapsulation header of either byte order. Trailing bytes are ignored:
/// rclpy sends as many bytes as it estimated, stale ones included.
///
/// # Errors
/// [`CdrError`]: a missing or unknown header, or content of another type.
pub fn from_cdr<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CdrError> {
    let [a, b, _, _, body @ ..] = bytes else { return Err(CdrError::Short(bytes.len())) };
    let read = match (a, b) {
        (0, 1) => cdr_encoding::from_bytes::<T, byteorder::LittleEndian>(body),
        (0, 0) => cdr_encoding::from_bytes::<T, byteorder::BigEndian>(body),
        _ => return Err(CdrError::Representation([*a, *b])),
    };
    read.map(|(message, _)| message).map_err(|e| CdrError::Content(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry_msgs::msg::PoseStamped;
    use crate::sensor_msgs::msg::Image;

    #[test]
    fn round_trip_keeps_every_field() {
        let mut pose = PoseStamped::default();
        pose.header.frame_id = "panda_link0".into();
        pose.header.stamp.sec = -3;
        pose.pose.orientation.w = 1.0;
        assert_eq!(from_cdr::<PoseStamped>(&to_cdr(&pose).unwrap()).unwrap(), pose);
        let image =
            Image { data: vec![1, 2, 3], height: 1, width: 1, step: 3, encoding: "rgb8".into(), ..Image::default() };
        assert_eq!(from_cdr::<Image>(&to_cdr(&image).unwrap()).unwrap(), image);
    }

    #[test]
    fn stale_bytes_after_the_message_are_ignored() {
        let mut bytes = to_cdr(&PoseStamped::default()).unwrap();
        bytes.extend(*b"dds_::EpisodeEve");
        assert_eq!(from_cdr::<PoseStamped>(&bytes).unwrap(), PoseStamped::default());
    }

    #[test]
    fn short_and_foreign_bytes_are_refused() {
        assert_eq!(from_cdr::<PoseStamped>(&[0, 1]), Err(CdrError::Short(2)));
        assert!(matches!(from_cdr::<PoseStamped>(&[0, 7, 0, 0, 1]), Err(CdrError::Representation([0, 7]))));
        let bytes = to_cdr(&PoseStamped::default()).unwrap();
        assert!(matches!(from_cdr::<PoseStamped>(&bytes[..20]), Err(CdrError::Content(_))));
    }
}
