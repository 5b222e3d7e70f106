//! Page of a training.

use super::report::Report;
use crate::report::Page;
use crate::report::plots::{self, Series};
use anyhow::Result;
use ppo_trainer::CurvePoint;

/// Page with the learning curve of a training.
pub fn page(report: &Report) -> Result<Page> {
    let mut page = Page::new("How did the training go?");
    page.answer(&report.words().lines().map(str::to_owned).collect::<Vec<String>>(), report.interrupted);
    page.note("Return and success are means over the last 100 episodes, in which the policy explores; catenary evaluate scores it without.");
    let mut picture = |title: &str, unit: &str, value: fn(&CurvePoint) -> f64| -> Result<()> {
        let points = report.curve.iter().map(|p| (p.steps as f64, value(p))).collect();
        page.svg(&plots::lines(title, "environment steps", unit, &[Series { name: title.to_owned(), points }])?);
        Ok(())
    };
    picture("Mean return", "reward", |p| p.mean_return)?;
    picture("Success", "%", |p| 100.0 * p.success_rate)?;
    picture("Entropy of the actions", "nat", |p| p.entropy)?;
    picture("Mean squared error of the values", "squared reward", |p| p.value_loss)?;
    Ok(page)
}
