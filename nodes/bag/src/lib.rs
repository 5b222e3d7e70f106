//! rosbag2 MCAP files: record, read, replay, import.
//!
//! Does: write bags as `ros2 bag record` does, chunk by chunk, so that a killed process loses the last second at most
//! ([`BagWriter`]); read them, finished or not ([`BagReader`]); put episodes together from them ([`read_episodes`]); make
//! them from measured tracks ([`import_track`]). With the feature `node` also: record the graph and replay into it.
//! Does not: know any algorithm, or change what a message says. Reads no sqlite3 bags.

#[cfg(feature = "node")]
mod backlog;
pub mod convert;
mod episodes;
mod error;
mod import;
#[cfg(feature = "node")]
mod kinds;
mod metadata;
#[cfg(feature = "node")]
pub mod node;
mod profile;
mod reader;
#[cfg(feature = "node")]
mod record;
#[cfg(feature = "node")]
mod replay;
mod writer;

pub use convert::Feed;
pub use episodes::{EpisodeTopics, read_episodes};
pub use error::BagError;
pub use import::import_track;
pub use reader::{BagMessage, BagReader, Messages, Topic, TopicCount, reindex};
#[cfg(feature = "node")]
pub use record::{RecordSettings, record};
#[cfg(feature = "node")]
pub use replay::{ReplaySettings, ReplaySummary, replay};
pub use writer::{BagSummary, BagWriter, Compression, TopicId, WriterOptions};
