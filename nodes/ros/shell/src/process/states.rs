//! State files of long work, from which a node continues after a kill.

use super::ros_home::ros_home;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Number of newest states that a folder keeps at any age.
const KEPT: usize = 8;
/// Age below which no state is removed: its work may still be running.
const YOUNG: Duration = Duration::from_secs(7 * 24 * 3600);

/// Returns the folder of a node's states: `asked`, or if that is empty `catenary/NODE` in ROS_HOME or ~/.ros. Returns `None` without
/// a home folder.
pub fn state_folder(asked: &str, node: &str) -> Option<PathBuf> {
    if asked.is_empty() { Some(ros_home()?.join("catenary").join(node)) } else { Some(PathBuf::from(asked)) }
}

/// Returns the state file in `folder` of the work with this fingerprint.
pub fn state_file(folder: &Path, fingerprint: u64, extension: &str) -> PathBuf {
    folder.join(format!("{fingerprint:016x}.{extension}"))
}

/// Removes old states of work that was cancelled and never requested again, except the newest.
pub fn remove_old_states(folder: &Path, extension: &str) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| is_state(path, extension));
    let mut states: Vec<(SystemTime, PathBuf)> =
        paths.filter_map(|path| Some((path.metadata().ok()?.modified().ok()?, path))).collect();
    states.sort();
    // Oldest first, so the newest ones are kept whatever their age is.
    let surplus = states.len().saturating_sub(KEPT);
    let is_old = |at: &SystemTime| at.elapsed().is_ok_and(|age| age > YOUNG);
    for (_, path) in states.iter().take(surplus).filter(|(at, _)| is_old(at)) {
        remove_state(path);
    }
}

/// Removes the state file of finished work, if there is one.
pub fn remove_state(path: &Path) {
    if let Err(error) = std::fs::remove_file(path)
        && error.kind() != std::io::ErrorKind::NotFound
    {
        tracing::warn!("{}: cannot remove the state file: {error}", path.display());
    }
}

/// Returns true if a file has a name as [`state_file`] returns it: other files in the folder must survive.
fn is_state(path: &Path, extension: &str) -> bool {
    let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
    path.extension().is_some_and(|e| e == extension)
        && stem.len() == 16
        && stem.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_states_are_removed_except_a_few_and_other_files_survive() {
        let folder = std::env::temp_dir().join(format!("catenary_states_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let write = |path: &Path, days: u64| {
            let at = SystemTime::now() - Duration::from_secs(days * 24 * 3600);
            std::fs::write(path, "{}").unwrap();
            std::fs::File::options().append(true).open(path).unwrap().set_modified(at).unwrap();
        };
        let file = |question| state_file(&folder, question, "json");
        let mine = ["notes.json", "0123456789ABCDEF.json", "0123456789abcdef.text"].map(|name| folder.join(name));
        mine.iter().for_each(|path| write(path, 100));
        // Twelve young states, and twenty old ones.
        (0..32).for_each(|question| write(&file(question), if question < 12 { question / 2 } else { question }));
        let left = |of: std::ops::Range<u64>| of.filter(|q| file(*q).exists()).count();
        remove_old_states(&folder, "json");
        assert_eq!((left(0..12), left(12..32)), (12, 0));
        (0..8).for_each(|question| remove_state(&file(question)));
        (12..32).for_each(|question| write(&file(question), question));
        remove_old_states(&folder, "json");
        assert_eq!((left(8..12), left(12..16), left(16..32)), (4, 4, 0));
        assert!(mine.iter().all(|path| path.exists()));
        remove_old_states(&folder.join("nowhere"), "json");
        remove_state(&folder.join("nothing.json"));
        std::fs::remove_dir_all(folder).unwrap();
    }
}
