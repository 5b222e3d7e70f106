//! Latched topics of a part of a split recording. Their messages come once, and lie in the file in which they came.

use crate::reader::BagReader;

/// Sentence about latched topics without a message in a bag that lacks the first files of a split recording; none for other
/// bags. Transforms, camera and start of an episode may be among them.
#[must_use]
pub fn latched_elsewhere(bag: &BagReader) -> Option<String> {
    lacking(bag).map(|note| format!("{}: {note}", bag.path().display()))
}

/// Sentence of [`latched_elsewhere`] without the path of the bag.
pub(crate) fn lacking(bag: &BagReader) -> Option<String> {
    let first = bag.files().next()?;
    let stem = first.file_name()?.to_str()?.split('.').next()?;
    // Recorders number the files of a bag from 0.
    let number: u32 = stem.rsplit_once('_')?.1.parse().ok().filter(|number| *number > 0)?;
    let is_latched = |offered: &[catenary_shell::Qos]| offered.iter().any(|qos| qos.is_transient_local());
    let empty = bag.topics().iter().filter(|t| t.messages == 0 && is_latched(&t.topic.qos));
    let names: Vec<&str> = empty.map(|t| t.topic.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "a part of a split recording, without its files before number {number}: no message of the latched topics {}; they come \
             once, and lie in an earlier file, if anywhere",
            names.join(", ")
        )
    })
}
