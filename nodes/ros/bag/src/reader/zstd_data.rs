//! Decompression of messages that a recorder compressed by zstd, one by one.

use std::io::Read;

/// First bytes of a zstd frame. No message in CDR begins with them.
pub(super) const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Decompresses a message's bytes, if the recorder compressed message by message.
///
/// # Errors
/// A sentence about damaged data, or about a message of more than `limit` bytes. A message is never cut at the limit.
pub(super) fn unpacked(data: Vec<u8>, limit: u64) -> Result<Vec<u8>, String> {
    if !data.starts_with(&ZSTD_MAGIC) {
        return Ok(data);
    }
    let too_large = |size: String| format!("expected at most {limit} bytes after decompression, got {size}");
    // Recorders state the size in the frame: a message that is too large costs no memory then.
    if let Ok(Some(size)) = zstd::zstd_safe::get_frame_content_size(&data)
        && size > limit
    {
        return Err(too_large(size.to_string()));
    }
    let mut out = Vec::new();
    let packed = zstd::Decoder::new(&data[..]).map_err(|e| e.to_string())?;
    // One byte more than the limit tells a message that is too large from one that just fits.
    packed.take(limit + 1).read_to_end(&mut out).map_err(|e| format!("a message compressed by zstd: {e}"))?;
    if out.len() as u64 > limit {
        return Err(too_large("more".to_owned()));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// Zeros in a zstd frame, with or without their number in the frame's header.
    fn zeros(size: usize, is_size_stated: bool) -> Vec<u8> {
        let mut packed = zstd::Encoder::new(Vec::new(), 0).unwrap();
        if is_size_stated {
            packed.set_pledged_src_size(Some(size as u64)).unwrap();
        }
        packed.write_all(&vec![0; size]).unwrap();
        packed.finish().unwrap()
    }

    #[test]
    fn a_message_over_the_limit_is_an_error_and_never_cut() {
        for is_size_stated in [true, false] {
            assert_eq!(unpacked(zeros(1000, is_size_stated), 1000), Ok(vec![0; 1000]));
        }
        let error = |is_size_stated| unpacked(zeros(1001, is_size_stated), 1000).unwrap_err();
        assert_eq!(error(true), "expected at most 1000 bytes after decompression, got 1001");
        assert_eq!(error(false), "expected at most 1000 bytes after decompression, got more");
        assert!(
            unpacked(zeros(1000, true)[..12].to_vec(), 1000).unwrap_err().starts_with("a message compressed by zstd")
        );
        assert_eq!(
            unpacked(b"\0\x01\0\0plain".to_vec(), 3).unwrap(),
            b"\0\x01\0\0plain",
            "no limit without compression"
        );
    }
}
