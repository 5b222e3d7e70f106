//! The interface package catenary_msgs: Rust types, type names, hashes and texts, generated from the .msg, .srv and .action files.
