//! One check of `catenary doctor`, and its line.

use crate::output::wrapped;
use serde::Serialize;

/// Width of the lines.
const WIDTH: usize = 80;
/// Columns before a detail.
const INDENT: usize = 27;

/// One thing that was looked at.
#[derive(Debug, Serialize)]
pub struct Check {
    /// Its name.
    pub name: &'static str,
    /// Whether it is right.
    pub verdict: Verdict,
    /// What was found.
    pub detail: String,
    /// What to do; none: nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

/// Whether the graph can work with what was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It works.
    Good,
    /// It works, but not with everything or not for long.
    Warning,
    /// It does not work.
    Bad,
}

impl Check {
    /// What is as it should be.
    pub fn good(name: &'static str, detail: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Good, detail: detail.into(), remedy: None }
    }

    /// What limits the graph, and what to do about it.
    pub fn warning(name: &'static str, detail: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Warning, detail: detail.into(), remedy: Some(remedy.into()) }
    }

    /// What keeps the graph from working, and what to do about it.
    pub fn bad(name: &'static str, detail: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Bad, detail: detail.into(), remedy: Some(remedy.into()) }
    }

    /// The check in lines of a terminal.
    pub fn words(&self) -> String {
        let word = match self.verdict {
            Verdict::Good => "ok     ",
            Verdict::Warning => "warning",
            Verdict::Bad => "BAD    ",
        };
        let blank = " ".repeat(INDENT);
        let mut lines = wrapped(&self.detail, WIDTH - INDENT);
        // An error's message stays in one piece, for those who search for it.
        if self.verdict == Verdict::Bad {
            lines = vec![self.detail.clone()];
        }
        let remedy = self.remedy.iter().flat_map(|remedy| wrapped(remedy, WIDTH - INDENT));
        lines.extend(remedy);
        format!("{word}  {:<16}  {}", self.name, lines.join(&format!("\n{blank}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_fits_the_width_with_its_remedy_below() {
        let detail = "net.core.rmem_max is 212992 bytes; 4194304 keep images whole between DDS vendors";
        let words = Check::warning("receive buffer", detail, "sudo sysctl -w net.core.rmem_max=4194304").words();
        assert!(words.starts_with("warning  receive buffer    net.core.rmem_max is"), "{words}");
        assert!(words.lines().all(|line| line.chars().count() <= WIDTH), "{words}");
        assert!(words.ends_with("\n                           sudo sysctl -w net.core.rmem_max=4194304"), "{words}");
    }
}
