//! rosbag2 MCAP files: record, read, replay, import.
