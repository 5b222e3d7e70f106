//! Option `--part`: a part of the work, for several machines with one folder.

use std::str::FromStr;

/// Part of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Number of the part, from 1.
    pub number: usize,
    /// Number of parts.
    pub of: usize,
}

impl Part {
    /// All of the work.
    pub const WHOLE: Self = Self { number: 1, of: 1 };

    /// True if the part makes item `index`.
    pub fn has(self, index: usize) -> bool {
        index % self.of == self.number - 1
    }

    /// Item `place` of those that the part makes, both from 0.
    pub fn item(self, place: usize) -> usize {
        self.number - 1 + place * self.of
    }

    /// Number of items that the part makes of `all`.
    pub fn count(self, all: usize) -> usize {
        (all + self.of - self.number) / self.of
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parse = || {
            let (number, of) = text.split_once('/')?;
            Some(Self { number: number.parse().ok()?, of: of.parse().ok()? })
        };
        let part = parse().filter(|part| (1..=part.of).contains(&part.number));
        part.ok_or_else(|| "expected I/N with whole numbers and 1 <= I <= N, such as 2/8".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_share_all_items() {
        let parts: Vec<Part> = (1..=3).map(|i| format!("{i}/3").parse().unwrap()).collect();
        assert!((0..20).all(|item| parts.iter().filter(|p| p.has(item)).count() == 1));
        assert!((0..20).all(|item| Part::WHOLE.has(item)));
        for part in parts {
            let items: Vec<usize> = (0..20).filter(|item| part.has(*item)).collect();
            assert_eq!((0..part.count(20)).map(|place| part.item(place)).collect::<Vec<usize>>(), items);
        }
        for bad in ["0/3", "4/3", "1", "a/2", "1/0", "-1/2", ""] {
            assert!(bad.parse::<Part>().is_err(), "{bad}");
        }
    }
}
