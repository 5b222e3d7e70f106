//! `reindex` on bags that others wrote: what it cannot do well it leaves as it is.
#![allow(clippy::unwrap_used, clippy::disallowed_methods, reason = "a test of files")]

use catenary_bag::{BagReader, reindex};
use std::path::{Path, PathBuf};

/// The sample bag in a folder of its own.
fn swing() -> (tempfile::TempDir, PathBuf) {
    let (folder, sample) =
        (tempfile::tempdir().unwrap(), Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bags/swing"));
    let bag = folder.path().join("swing");
    std::fs::create_dir(&bag).unwrap();
    for name in ["metadata.yaml", "swing_0.mcap"] {
        std::fs::copy(sample.join(name), bag.join(name)).unwrap();
    }
    (folder, bag)
}

fn metadata(bag: &Path) -> String {
    std::fs::read_to_string(bag.join("metadata.yaml")).unwrap()
}

#[test]
fn a_bag_that_misses_nothing_stays_as_it_is() {
    let (_folder, bag) = swing();
    let own = metadata(&bag).replace("custom_data: {}", "custom_data: {operator: me}");
    std::fs::write(bag.join("metadata.yaml"), &own).unwrap();
    assert_eq!(reindex(&bag).unwrap(), [] as [String; 0]);
    assert_eq!(metadata(&bag), own);
}

#[test]
fn a_bag_of_compressed_messages_is_refused_where_something_is_amiss() {
    let (_folder, bag) = swing();
    let own =
        metadata(&bag).replace("compression_mode: \"\"", "compression_mode: MESSAGE").replace("swing_0", "gone_0");
    std::fs::write(bag.join("metadata.yaml"), &own).unwrap();
    let error = reindex(&bag).unwrap_err().to_string();
    assert!(error.contains("compression mode message"), "{error}");
    assert_eq!(metadata(&bag), own);
}

#[test]
fn a_file_that_nobody_listed_is_noted_and_taken_in() {
    let (_folder, bag) = swing();
    std::fs::copy(bag.join("swing_0.mcap"), bag.join("swing_1.mcap")).unwrap();
    let before = BagReader::open(&bag).unwrap();
    assert!(before.notes().iter().any(|n| n.contains("swing_1.mcap: not listed")), "{:?}", before.notes());
    let count = before.message_count();
    reindex(&bag).unwrap();
    let after = BagReader::open(&bag).unwrap();
    assert_eq!((after.message_count(), after.notes().len()), (2 * count, 0));
}
