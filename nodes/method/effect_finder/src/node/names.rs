//! Names of episodes that tell apart those of one number in several bags.

use catenary_core::episode::MeasuredTrack;
use std::path::{Path, PathBuf};

/// Names the episodes of `bag` by bag and number: "bag_0, episode 3". `bags` are all bags of the search: bags of one file name
/// get as much of their paths as tells them apart.
pub fn named_apart(
    mut episodes: Vec<(u32, MeasuredTrack)>,
    bag: &Path,
    bags: &[impl AsRef<Path>],
) -> Vec<(u32, MeasuredTrack)> {
    let name = short_name(bag, bags);
    episodes.iter_mut().for_each(|(number, measured)| measured.name = format!("{name}, episode {number}"));
    episodes
}

/// Shortest end of the path of `bag` that no other one of `bags` has.
fn short_name(bag: &Path, bags: &[impl AsRef<Path>]) -> String {
    let end = |path: &Path, count: usize| -> PathBuf {
        let parts: Vec<_> = path.components().collect();
        parts[parts.len().saturating_sub(count)..].iter().collect()
    };
    let others = || bags.iter().map(AsRef::as_ref).filter(|other| *other != bag);
    let is_apart = |count: &usize| others().all(|other| end(other, *count) != end(bag, *count));
    let count = (1..=bag.components().count()).find(is_apart).unwrap_or(usize::MAX);
    end(bag, count).display().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use track_fit::toy::{self, Toy};

    #[test]
    fn bags_of_one_name_are_told_apart_by_their_folders() {
        let bags = ["runs/monday/bag_0", "runs/tuesday/bag_0", "runs/tuesday/bag_1", "bag_0"];
        let names = bags.map(|bag| short_name(Path::new(bag), &bags));
        assert_eq!(names, ["monday/bag_0", "tuesday/bag_0", "bag_1", "bag_0"]);
        assert_eq!(short_name(Path::new("a/x.mcap"), &["a/x.mcap", "a/x.mcap"]), "x.mcap", "a bag that is given twice");
        assert_eq!(short_name(Path::new("/bag"), &["/bag", "./bag"]), "/bag");
    }

    #[test]
    fn episodes_of_one_number_in_two_bags_have_two_names() {
        let of = |bag: &str| {
            let measured = toy::measured(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
            named_apart(vec![(0, measured)], Path::new(bag), &["bag_0", "bag_1"]).remove(0).1.name
        };
        assert_eq!([of("bag_0"), of("bag_1")], ["bag_0, episode 0", "bag_1, episode 0"]);
    }
}
