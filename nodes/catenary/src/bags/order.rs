//! Hints about the order of the words of `record` and `replay`. `ros2 bag record` took topics without an option for years, and
//! an option with many values takes the bag that follows it.

use clap::Error;
use clap::error::ErrorKind;
use std::path::Path;

/// Way to name topics and bag, for errors of `record`.
pub const TOPICS_AND_BAG: &str = "topics follow --topics, and the bag's folder -o";

/// Options with any number of values.
const MANY: [&str; 7] =
    ["--topics", "--topic-types", "--exclude-topics", "--exclude-topic-types", "-m", "--remap", "--clock"];

/// Hint for the error of a command line, whose words come without the program's name.
pub fn hint(error: &Error, words: &[String]) -> Option<String> {
    let at = words.iter().position(|word| word == "record" || word == "replay")?;
    let rest = &words[at + 1..];
    match (words[at].as_str(), error.kind()) {
        (_, ErrorKind::MissingRequiredArgument) => {
            let option = rest.iter().rfind(|word| word.starts_with('-'))?;
            let takes_all = MANY.contains(&option.as_str());
            takes_all.then(|| format!("{option} takes the words after it: give BAG before it, or as --bag BAG"))
        }
        ("record", ErrorKind::UnknownArgument | ErrorKind::ArgumentConflict) => {
            rest.iter().any(|word| word.starts_with('/')).then(|| TOPICS_AND_BAG.to_owned())
        }
        _ => None,
    }
}

/// True if a path is rather a topic's name: `/a`, or `/dlo/keypoints` where no folder `/dlo` exists.
#[allow(clippy::disallowed_methods, reason = "folders distinguish a path from a topic")]
pub fn is_like_topic(path: &Path) -> bool {
    let is_folder = |folder: &Path| folder != Path::new("/") && folder.is_dir();
    path.is_absolute() && !path.parent().is_some_and(is_folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_is_told_from_a_path() {
        let folder = tempfile::tempdir().unwrap();
        assert!(is_like_topic(Path::new("/a")) && is_like_topic(Path::new("/dlo/keypoints")));
        assert!(!is_like_topic(&folder.path().join("bag")) && !is_like_topic(Path::new("dlo/keypoints")));
    }
}
