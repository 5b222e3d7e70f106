//! A check of `catenary doctor`, and its line of output.

use crate::terminal::output::wrapped;
use serde::Serialize;

/// Width of the output, columns.
const WIDTH: usize = 80;
/// Indentation of the details, columns.
const INDENT: usize = 27;

/// Result of one check.
#[derive(Debug, Serialize)]
pub struct Check {
    /// Name of the check.
    pub name: &'static str,
    /// Verdict.
    pub verdict: Verdict,
    /// Finding, in words.
    pub detail: String,
    /// Remedy; `None` if nothing needs to be done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

/// Verdict on a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The graph can work.
    Good,
    /// The graph can work, with limits.
    Warning,
    /// The graph cannot work.
    Bad,
}

impl Check {
    /// Check without objection.
    pub fn good(name: &'static str, detail: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Good, detail: detail.into(), remedy: None }
    }

    /// Check whose finding limits the graph, with its remedy.
    pub fn warning(name: &'static str, detail: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Warning, detail: detail.into(), remedy: Some(remedy.into()) }
    }

    /// Check whose finding prevents the graph from working, with its remedy.
    pub fn bad(name: &'static str, detail: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Bad, detail: detail.into(), remedy: Some(remedy.into()) }
    }

    /// Text of the check for a terminal.
    pub fn words(&self) -> String {
        let word = match self.verdict {
            Verdict::Good => "ok     ",
            Verdict::Warning => "warning",
            Verdict::Bad => "BAD    ",
        };
        let blank = " ".repeat(INDENT);
        let mut lines = wrapped(&self.detail, WIDTH - INDENT);
        // An error message is not wrapped, so that it can be copied and searched for.
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
