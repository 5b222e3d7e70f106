//! Predictions of recordings that the inference has not seen: made, in words, and as rows of a table.

use crate::exit::Interrupted;
use crate::report::number::{millimetres, percent, plain};
use crate::report::quantity::Quantity;
use anyhow::Result;
use bayes_sim::prediction::Prediction;
use bayes_sim::{InferenceError, InferenceResult, Settings, Unseen};
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use catenary_shell::Shutdown;
use catenary_simulator::{BeamSimulator, workers};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Head of the table of predictions.
pub const HEAD: [&str; 7] = [
    "recording",
    "RMSE, mm",
    "90 % band, mm",
    "in the 90 % band",
    "in the 50 % band",
    "p of the check",
    "width from parameters",
];

/// Recording that the inference has not seen, with its prediction.
#[derive(Debug, Serialize)]
pub struct Predicted {
    /// Bag, and the number of its episode in words.
    bag: PathBuf,
    episode: String,
    /// Prediction; none if it could not be compared with the recording.
    #[serde(flatten)]
    prediction: Option<Prediction>,
    /// Reason for which there is no prediction.
    unpredicted: Option<String>,
    /// Doubts about the recording.
    recording_warnings: Vec<String>,
}

/// Bag of each of the recordings `others`: several bags have one each, and a single bag may have several.
pub fn bags<'a>(bags: &'a [PathBuf], others: &'a [MeasuredTrack]) -> Vec<(&'a Path, &'a MeasuredTrack)> {
    let bag = |i: usize| bags.get(i).or(bags.last()).map(PathBuf::as_path);
    others.iter().enumerate().filter_map(|(i, other)| bag(i).map(|bag| (bag, other))).collect()
}

/// Predicts all recordings `unseen`, which `bags` names. A recording that cannot be compared with its prediction does not spoil the result:
/// the reason stands in its place. `kept` is the file from which an interrupted inference goes on.
pub fn all(
    bags: Vec<(&Path, &MeasuredTrack)>,
    unseen: &[Unseen<'_>],
    model: &Model,
    inferred: (&InferenceResult, &Settings),
    (shutdown, kept): (&Shutdown, &Path),
) -> Result<Vec<Predicted>> {
    let simulator = BeamSimulator::new(model, workers::available())?;
    let simulations = inferred.0.simulations();
    let mut tick = || match shutdown.is_triggered() {
        true => Err(InferenceError::Cancelled { simulations }),
        false => Ok(()),
    };
    let mut predicted = Vec::new();
    for (number, ((bag, measured), unseen)) in bags.into_iter().zip(unseen).enumerate() {
        let (prediction, unpredicted) = match unseen.predicted(model, inferred, number as u64, &simulator, &mut tick) {
            Ok(prediction) => (Some(prediction), None),
            Err(InferenceError::Cancelled { .. }) => {
                let done = format!("the inference and {number} of its predictions");
                return Err(Interrupted::kept(done, format!("{} (the iterations)", kept.display()), "").into());
            }
            Err(error) => (None, Some(error.to_string())),
        };
        predicted.push(Predicted {
            bag: bag.to_owned(),
            episode: measured.name.clone(),
            prediction,
            unpredicted,
            recording_warnings: measured.warnings.clone(),
        });
    }
    Ok(predicted)
}

impl Predicted {
    /// Name of the recording.
    fn name(&self) -> String {
        format!("{}, {}", self.bag.display(), self.episode)
    }

    /// Reasons not to trust the prediction.
    fn warnings(&self) -> impl Iterator<Item = &String> {
        let doubts = self.prediction.iter().flat_map(|p| &p.warnings);
        doubts.chain(&self.unpredicted).chain(&self.recording_warnings)
    }

    /// Warnings with the name of the recording.
    pub fn named_warnings(&self) -> Vec<String> {
        self.warnings().map(|w| format!("prediction of {}: {w}", self.name())).collect()
    }

    /// Lines for the terminal.
    pub fn lines(&self) -> Vec<String> {
        let figures = self.prediction.iter().map(|p| {
            let (f, shares) = (&p.figures, &p.shares);
            format!(
                "prediction of {}, which the fit has not seen: RMSE {:.1} mm; {:.0} % in the 90 % band (half width {:.1} mm rms: {:.0} % of its variance from the parameters, {:.0} % from what is drawn for each episode, {:.0} % noise), {:.0} % in the 50 % band; p = {:.3}",
                self.name(),
                f.rmse_mm,
                100.0 * f.coverage,
                f.half_width_mm,
                100.0 * shares.parameters,
                100.0 * shares.episode,
                100.0 * shares.noise,
                100.0 * p.bands.coverage_50,
                f.p_value
            )
        });
        let warnings = self.named_warnings().into_iter().map(|w| format!("warning: {w}"));
        figures.chain(warnings).collect()
    }

    /// Row of the table of predictions.
    pub fn row(&self) -> Vec<String> {
        let Some(p) = &self.prediction else {
            return std::iter::once(self.name()).chain((1..HEAD.len()).map(|_| "–".to_owned())).collect();
        };
        let f = &p.figures;
        vec![
            self.name(),
            millimetres(f.rmse_mm),
            format!("± {}", millimetres(f.half_width_mm)),
            percent(f.coverage),
            percent(p.bands.coverage_50),
            plain(f.p_value, 3),
            percent(p.shares.parameters),
        ]
    }

    /// Sentence on the prediction; none if there is no prediction.
    pub fn sentence(&self) -> Option<String> {
        let p = self.prediction.as_ref()?;
        let verdict = if p.is_overconfident() {
            "is more certain than it may be"
        } else if p.is_open() {
            "is honest and wide: the fitted recording does not determine this motion"
        } else {
            "holds what its bands say"
        };
        let title = |name: &String| match name.split_once('.') {
            // Fields of the model file that are no quantities of the simulator.
            Some((_, "position_jitter_m")) => "displacement of the camera".to_owned(),
            Some((_, _)) => "velocities at the start".to_owned(),
            None => Quantity::of(name).title,
        };
        let anew = match p.drawn_anew.as_slice() {
            [] => "Nothing else was drawn for it.".to_owned(),
            names => {
                let titles: Vec<String> = names.iter().map(title).collect();
                format!("Drawn anew for it, from the model file's distributions: {}.", titles.join(", "))
            }
        };
        Some(format!(
            "The prediction of {} {verdict}: {} mm off (root mean square), with {} of the motion in the 90 % band. Its coverage is \
             worth that of {} independent coordinates. The noise alone would make the band ± {} mm wide. {anew}",
            self.name(),
            millimetres(p.figures.rmse_mm),
            percent(p.figures.coverage),
            plain(p.bands.effective_coordinates, 0),
            millimetres(p.noise_half_width_mm)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bayes_sim::Predictive;
    use bayes_sim::diagnostics::Bands;
    use bayes_sim::prediction::Shares;

    fn predicted(coverage: f64, p_value: f64) -> Predicted {
        let figures = Predictive {
            rmse_mm: 12.3,
            coverage,
            half_width_mm: 20.5,
            spread_mm: 90.0,
            p_value,
            draws: 199,
            parts: vec![],
        };
        let prediction = Prediction {
            figures,
            bands: Bands { coverage_50: 0.45, coverage_p_value: p_value, effective_coordinates: 17.0 },
            shares: Shares { parameters: 0.25, episode: 0.65, noise: 0.1, by_parameter: vec![] },
            noise_half_width_mm: 6.5,
            drawn_anew: vec!["linear_drag_n_s_m2".into(), "camera.position_jitter_m".into()],
            undetermined: vec![],
            warnings: vec!["doubtful".into()],
        };
        Predicted {
            bag: "bags/swing".into(),
            episode: "episode 1".into(),
            prediction: Some(prediction),
            unpredicted: None,
            recording_warnings: vec!["held frames".into()],
        }
    }

    #[test]
    fn a_prediction_is_told_with_its_recording_its_bands_and_its_warnings() {
        let predicted = predicted(0.91, 0.4);
        let lines = predicted.lines();
        assert_eq!(
            lines[0],
            "prediction of bags/swing, episode 1, which the fit has not seen: RMSE 12.3 mm; 91 % in the 90 % band (half width 20.5 mm rms: 25 % of its variance from the parameters, 65 % from what is drawn for each episode, 10 % noise), 45 % in the 50 % band; p = 0.400"
        );
        assert_eq!(
            lines[1..],
            [
                "warning: prediction of bags/swing, episode 1: doubtful".to_owned(),
                "warning: prediction of bags/swing, episode 1: held frames".to_owned()
            ]
        );
        let row = predicted.row();
        assert_eq!(row.len(), HEAD.len());
        assert_eq!(row[..4], ["bags/swing, episode 1", "12", "± 20", "91 %"]);
        let sentence = predicted.sentence().unwrap();
        assert!(
            sentence.contains("holds what its bands say") && sentence.contains("displacement of the camera"),
            "{sentence}"
        );
    }

    #[test]
    fn an_overconfident_prediction_is_called_so_and_a_missing_one_has_its_reason() {
        let overconfident = predicted(0.4, 0.005).sentence().unwrap();
        assert!(overconfident.contains("is more certain than it may be"), "{overconfident}");
        let missing = Predicted { prediction: None, unpredicted: Some("no draw".into()), ..predicted(0.9, 0.5) };
        assert_eq!(
            missing.lines(),
            [
                "warning: prediction of bags/swing, episode 1: no draw",
                "warning: prediction of bags/swing, episode 1: held frames"
            ]
        );
        assert!(missing.sentence().is_none() && missing.row().len() == HEAD.len());
    }

    #[test]
    fn a_single_bag_may_have_several_recordings() {
        let track = || MeasuredTrack {
            name: "episode 1".into(),
            track: catenary_core::Track { frames: vec![], end: catenary_core::track::End::Complete },
            grip: catenary_core::GripTrajectory::new(vec![0.0, 1.0], vec![Default::default(); 2]).unwrap(),
            actions: vec![],
            start: catenary_core::simulator::StartShape::HangingAtRest,
            target_m: None,
            warnings: vec![],
        };
        let others = [track(), track()];
        let names = |of: &[PathBuf]| bags(of, &others).into_iter().map(|(bag, _)| bag.to_owned()).collect::<Vec<_>>();
        assert_eq!(names(&["a".into()]), [PathBuf::from("a"), "a".into()]);
        assert_eq!(names(&["a".into(), "b".into()]), [PathBuf::from("a"), "b".into()]);
    }
}
