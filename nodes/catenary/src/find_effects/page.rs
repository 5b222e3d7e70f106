//! The page of a search: what was found, with every picture.

use super::{Looked, Report, headline};
use crate::figures::figures;
use crate::misfit::Misfit;
use crate::report::Page;
use crate::report::plots::search::{Bar, Interval, Panel, Ribbon, bars, histogram, intervals, panels};
use anyhow::Result;
use effect_finder::case::Quantity;
use effect_finder::localise::{Part, Place};
use effect_finder::outcome::{Band, Places, Shown};
use effect_finder::verdict::{Estimate, Fitness};
use effect_finder::verify::Verification;

/// Explanations in the picture, of all the most probable.
const RANKED: usize = 12;
/// Episodes in pictures, of those that models were fitted to and of the held-out ones.
const SHOWN: usize = 3;
/// Least p-value in pictures, which have it in a logarithm.
const LEAST_P: f64 = 1e-3;

/// The whole page.
pub fn page(report: &Report, shown: &[Shown]) -> Result<String> {
    let finding = &report.finding;
    let mut page = Page::new(&format!("catenary find-effects: {}", report.model));
    finding.misfit.iter().for_each(|reason| page.warning(&Misfit::headline(reason)));
    report.warnings.iter().for_each(|w| page.warning(w));
    page.paragraph(&format!("verdict: {}", headline(finding)));
    finding.conclusions.iter().for_each(|c| page.paragraph(c));
    let row = |kind: &'static str| {
        move |(i, e): (usize, &Looked)| {
            vec![i.to_string(), kind.into(), e.number.to_string(), e.bag.display().to_string()]
        }
    };
    let mut rows: Vec<Vec<String>> = report.episodes.iter().enumerate().map(row("fitted")).collect();
    rows.extend(report.held_out.iter().enumerate().map(row("held out")));
    page.table(&["episode", "", "number in its bag", "bag"], &rows);
    page.heading("The present model");
    fitness(&mut page, &finding.present)?;
    if let Some(repaired) = &finding.repaired {
        page.heading("The model with the most probable effects");
        fitness(&mut page, repaired)?;
        page.svg(&theta(&finding.present, repaired)?);
    }
    if let Some(verification) = &finding.verification {
        page.heading("On episodes that no fit has seen");
        page.svg(&gap(verification)?);
    }
    page.heading("Measured and predicted");
    overlays(&mut page, shown)?;
    page.heading("Where they disagree");
    page.svg(&places(&finding.places)?);
    page.table(
        &["part", "times the noise", "excess, sd", "p (corrected)"],
        &finding.places.iter().map(place).collect::<Vec<_>>(),
    );
    if !finding.explanations.is_empty() {
        page.heading("What explains it");
        explanations(&mut page, report)?;
    }
    for (name, reason) in &finding.left_out {
        page.paragraph(&format!("{name} was left out: {reason}"));
    }
    Ok(page.finish())
}

/// Values and test of a model: the null sets' statistics, with the measured one.
fn fitness(page: &mut Page, fitness: &Fitness) -> Result<()> {
    let row = |e: &Estimate| vec![e.name.clone(), figures(e.value), figures(e.q05), figures(e.q95)];
    page.table(&["parameter", "best fit", "5 %", "95 %"], &fitness.estimates.iter().map(row).collect::<Vec<_>>());
    let test = &fitness.test;
    page.paragraph(&format!(
        "RMSE {:.1} mm; {} coordinates leave {:.0} squared deviations; p = {:.3}",
        fitness.rmse_mm, test.coordinates, test.statistic, test.p_value
    ));
    let title = "what is left after fits of simulated data without a gap";
    page.svg(&histogram(title, "squared deviations", &test.null, ("this fit", test.statistic))?);
    Ok(())
}

/// How the shared values moved.
fn theta(before: &Fitness, after: &Fitness) -> Result<String> {
    let interval = |name: &str, e: &Estimate| Interval { name: name.into(), values: [e.q05, e.value, e.q95] };
    let row = |e: &Estimate| {
        let old = before.estimates.iter().find(|o| o.name == e.name);
        let own = old.map(|o| interval("before", o)).into_iter().chain([interval("with the effects", e)]);
        (e.name.clone(), own.collect())
    };
    intervals("parameters, 5 to 95 %", &after.estimates.iter().map(row).collect::<Vec<_>>())
}

fn gap(v: &Verification) -> Result<String> {
    let bar = |label: &str, mm: f64| Bar { label: label.into(), parts: vec![mm] };
    let mut all = vec![bar("present model", v.before.rmse_mm), bar("repaired model", v.after.rmse_mm)];
    all.extend(v.wrong_effect.as_ref().map(|(name, score)| bar(&format!("with {name} instead"), score.rmse_mm)));
    all.extend(v.black_box_mm.map(|mm| bar("regression without physics", mm)));
    bars("what is left of unseen episodes", "RMSE, mm", &["RMSE"], &all, Some(("noise floor", v.floor_mm)))
}

fn overlays(page: &mut Page, shown: &[Shown]) -> Result<()> {
    let (held_out, fitted): (Vec<_>, Vec<_>) = shown.iter().partition(|s| s.is_held_out);
    for (kind, list) in [("fitted", fitted), ("held-out", held_out)] {
        for (number, episode) in list.into_iter().enumerate().take(SHOWN) {
            let title = format!("{kind} episode {number}: keypoints, and 90 % of predictions");
            let all: Vec<Panel> = (0..4).flat_map(|k| [0, 1].map(|axis| panel(episode, k, axis))).collect();
            page.svg(&panels(&title, &episode.times_s, &all)?);
        }
    }
    Ok(())
}

fn panel(episode: &Shown, k: usize, axis: usize) -> Panel {
    let of = |places: &Places| -> Vec<f64> { places.iter().map(|p| p[k][axis]).collect() };
    let ribbon = |name: &str, band: &Band| {
        let [low, middle, high] = [&band.q05, &band.median, &band.q95].map(of);
        let values = low.iter().zip(middle).zip(high).map(|((l, m), h)| [*l, m, h]).collect();
        Ribbon { name: name.into(), values }
    };
    let after = episode.after.as_ref().map(|band| ribbon("with the effects", band));
    Panel {
        label: format!("keypoint {k}, {} in m", ["x", "z"][axis]),
        measured: of(&episode.measured),
        ribbons: std::iter::once(ribbon("present model", &episode.before)).chain(after).collect(),
    }
}

fn places(places: &[Place]) -> Result<String> {
    let bar = |p: &Place| Bar { label: part(&p.part), parts: vec![-p.p_value.max(LEAST_P).log10()] };
    let all: Vec<Bar> = places.iter().map(bar).collect();
    let level = Some(("p = 0.05", -(0.05f64.log10())));
    bars("disagreement by part", "-log10 p, corrected for the number of parts", &["part"], &all, level)
}

fn explanations(page: &mut Page, report: &Report) -> Result<()> {
    let finding = &report.finding;
    let bar = |label: String, parts: [f64; 2]| Bar { label, parts: parts.to_vec() };
    let mut ranked = vec![
        bar("none, and nothing else".into(), [finding.probability_of_none, 0.0]),
        bar("none, but something".into(), [0.0, finding.probability_of_unknown]),
    ];
    let all = finding.explanations.iter().take(RANKED);
    ranked.extend(all.map(|e| bar(e.names(), [e.probability, e.probability_in_part])));
    page.svg(&bars("what explains it", "probability", &["all there is", "with something else"], &ranked, None)?);
    if finding.found.iter().any(|alike| alike.len() > 1) {
        let groups: Vec<String> = finding.found.iter().map(|alike| alike.join(" or ")).collect();
        page.warning(&format!("cannot be told apart in these data: {}", groups.join("; ")));
    }
    let rows: Vec<Vec<String>> = finding
        .explanations
        .iter()
        .map(|e| {
            let sizes: Vec<String> =
                e.effects.iter().map(|m| format!("{} ± {}", figures(m.value), figures(m.sd))).collect();
            vec![
                e.names(),
                sizes.join(", "),
                format!("{:.2}", e.log_bayes_factor),
                format!("{:.3}", e.probability),
                format!("{:.3}", e.probability_in_part),
                format!("{:.2}", e.cosine_with_best),
            ]
        })
        .collect();
    let head = ["effects", "values", "log Bayes factor", "probability", "with something else", "cosine with the best"];
    page.table(&head, &rows);
    Ok(())
}

fn place(place: &Place) -> Vec<String> {
    vec![
        part(&place.part),
        format!("{:.2}", place.mean_square.sqrt()),
        format!("{:.1}", place.excess),
        format!("{:.3}", place.p_value),
    ]
}

fn part(part: &Part) -> String {
    match *part {
        Part::Quantity(Quantity::Keypoint { point, axis }) => format!("keypoint {point}, {}", ["x", "y"][axis]),
        Part::Quantity(Quantity::Pose { axis }) => format!("arm, {}", ["x", "z", "pitch"][axis]),
        Part::Window { episode, from_s, to_s } => format!("episode {episode}, {from_s:.2} to {to_s:.2} s"),
    }
}
