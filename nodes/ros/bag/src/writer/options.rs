//! Options of a bag writer.

use std::time::Duration;

/// Compression of the chunks of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// No compression.
    None,
    /// lz4, chunk by chunk: faster than zstd, with larger files.
    Lz4,
    /// zstd, chunk by chunk.
    #[default]
    Zstd,
}

impl Compression {
    /// Name in settings.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        }
    }

    /// All compressions.
    pub const ALL: [Self; 3] = [Self::None, Self::Lz4, Self::Zstd];

    /// Compression with this name; none if no compression has it.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.name() == name)
    }
}

/// Limits of a file. As in rosbag2, the first message after a limit was reached begins a new file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Split {
    /// Bytes of complete chunks; none for no limit.
    pub bytes: Option<u64>,
    /// Log time since the first message of the file; none for no limit.
    pub duration: Option<Duration>,
}

/// Options of a writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriterOptions {
    /// Compression of the chunks.
    pub compression: Compression,
    /// Bytes of messages after which a chunk ends, default 256 KiB. Larger chunks compress better, but a killed process
    /// or a full disk loses more. The limit grows to a sixteenth of the file, up to 4 MiB, because the index of the
    /// chunks is kept in memory until the end of the file.
    pub chunk_bytes: usize,
    /// Log time after which a chunk ends even if it is not full, default 1 s.
    pub chunk_period: Duration,
    /// Limits of a file, default none.
    pub split: Split,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self {
            compression: Compression::default(),
            chunk_bytes: 256 * 1024,
            chunk_period: Duration::from_secs(1),
            split: Split::default(),
        }
    }
}
