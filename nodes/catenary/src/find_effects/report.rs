//! Result of a search.

use crate::exit::Misfit;
use effect_finder::{Finding, Settings, Verdict};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Contents of verdict.json, and result in the form of `--json`.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Name of the model.
    pub model: String,
    /// Fitted episodes; conclusions and places count these from 0.
    pub episodes: Vec<UsedEpisode>,
    /// Validation episodes.
    pub validation: Vec<UsedEpisode>,
    /// Held-out episodes.
    pub held_out: Vec<UsedEpisode>,
    /// Settings of the search.
    pub settings: Settings,
    /// Wall time of the search, s.
    pub wall_s: f64,
    /// False if the best model does not fit the recordings; `misfit` has the reason.
    pub fits: bool,
    /// Doubts about the recordings.
    pub warnings: Vec<String>,
    /// Finding of the search.
    #[serde(flatten)]
    pub finding: Finding,
}

/// Episode that the search used.
#[derive(Debug, Serialize)]
pub struct UsedEpisode {
    /// Path of the bag.
    pub bag: PathBuf,
    /// Number of the episode in its bag.
    pub number: u32,
    /// Name in sentences and pictures, by bag and number.
    #[serde(skip)]
    pub name: String,
}

impl Report {
    /// Lines for the terminal; `page` is the path of the HTML page.
    pub fn words(&self, page: &Path) -> String {
        let misfit = self.finding.misfit.iter().map(|reason| Misfit::headline(reason));
        let mut lines: Vec<String> = misfit.collect();
        lines.push(headline(&self.finding));
        let pressing = self.finding.pressing_in_words();
        if !pressing.is_empty() {
            lines.push(format!("at a bound of the prior: {}", pressing.join(", ")));
        }
        lines.push(format!("{} episodes, {:.1} s", self.episodes.len(), self.wall_s));
        lines.extend(self.finding.noise_doubt.iter().map(|doubt| format!("warning: {doubt}")));
        if self.finding.verdict == Verdict::CannotSee {
            let size = self.finding.hidden_gap_mm.map_or("a gap".into(), |mm| format!("a gap of up to {mm:.1} mm"));
            lines.push(format!("{size} may hide in the stated noise"));
        }
        if !self.finding.nearest.is_empty() {
            lines.push("nearest.yaml is the model with the nearest effects; model.yaml has none of them".into());
        }
        lines.push(format!("report: {}", page.display()));
        lines.join("\n")
    }
}

/// Verdict and the effects that it names, in a line.
fn headline(finding: &Finding) -> String {
    let list = |groups: &[Vec<String>]| groups.iter().map(|alike| alike.join(" or ")).collect::<Vec<_>>().join(", ");
    match (finding.found.as_slice(), finding.nearest.as_slice()) {
        ([], []) => finding.verdict.name().to_owned(),
        ([], nearest) => format!("{} (nearest: {})", finding.verdict.name(), list(nearest)),
        (found, _) => format!("{} ({})", finding.verdict.name(), list(found)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::answer::tests::named;
    use super::*;

    #[test]
    fn the_terminal_tells_values_at_a_bound_without_a_gap() {
        let words = |pressing: &[&str]| {
            let pressing = pressing.iter().map(|name| (*name).to_owned()).collect();
            let finding = Finding { verdict: Verdict::NoGap, found: Vec::new(), pressing, ..named() };
            let report = Report {
                model: "bar".into(),
                episodes: Vec::new(),
                validation: Vec::new(),
                held_out: Vec::new(),
                settings: Settings::default(),
                wall_s: 1.0,
                fits: true,
                warnings: Vec::new(),
                finding,
            };
            report.words(Path::new("found/index.html"))
        };
        let told = "no_gap\nat a bound of the prior: length_m, density_kg_m3\n0 episodes";
        assert!(words(&["length_m", "density_kg_m3"]).starts_with(told), "{}", words(&["length_m", "density_kg_m3"]));
        assert!(words(&[]).starts_with("no_gap\n0 episodes"), "{}", words(&[]));
    }
}
