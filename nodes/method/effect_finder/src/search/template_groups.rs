//! Groups of templates that act together, and the linear models that they give.

use crate::evidence::LinearModel;
use crate::report::Form;
use crate::template::{Companion, Template};
use catenary_core::{Frame, Prior};
use track_fit::data::Candidate;
use track_fit::fitting::{Probe, Problem};

/// Places at which a template is tried, as fractions of the length: the first, the last, and the step.
// A template is a tenth of the length wide.
const PLACES: [f64; 3] = [0.05, 0.95, 0.05];
/// Number of the lowest frequencies, which are multiples of half a wave in an episode.
const HALF_WAVES: usize = 12;
/// Number of the lowest frequencies, from which on they grow by [`RATIO`]. Below it they grow by a whole wave in an episode:
/// a wave between two of them looks like both.
const WAVES: usize = 64;
const RATIO: f64 = 1.25;
/// Highest frequency, as a share of the frame rate, and in Hz.
// Above half the frame rate a wave looks like a slower one.
const GREATEST_SHARE: f64 = 0.4;
const GREATEST_HZ: f64 = 8.0;
/// Frequency in Hz above which a smooth function of time hardly changes.
const SMOOTH_HZ: f64 = 0.5;

/// Templates that act together, with their columns.
pub(super) struct Group<'a> {
    /// The templates.
    pub templates: Vec<&'a Template>,
    /// Tried values of their companion; empty without a companion.
    settings: Vec<f64>,
    /// Index of the first column. Settings are outside, templates inside.
    first: usize,
}

/// Models of one kind, which are equally likely.
pub(super) struct Kind<'a> {
    /// Part of the simulator.
    pub hook: &'a str,
    /// Index of the group whose settings are the models; none for a mixture of many columns.
    pub group: Option<usize>,
    /// The models.
    pub models: Vec<LinearModel>,
}

impl<'a> Group<'a> {
    /// Groups of `templates`, ordered by part of the simulator.
    pub fn all(templates: &'a [Template], problem: &Problem<'_>) -> Vec<Self> {
        let mut groups: Vec<Group<'a>> = Vec::new();
        for template in templates {
            match groups.iter_mut().find(|g| g.templates[0].is_with(template)) {
                Some(group) => group.templates.push(template),
                None => {
                    let settings = match template.companion {
                        None => Vec::new(),
                        Some((Companion::Place, _)) => places(),
                        Some((Companion::Frequency, _)) => frequencies_hz(longest_s(problem), frame_rate_hz(problem)),
                    };
                    groups.push(Group { templates: vec![template], settings, first: 0 });
                }
            }
        }
        groups.sort_by(|a, b| a.hook().cmp(b.hook()));
        let mut first = 0;
        for group in &mut groups {
            group.first = first;
            first += group.count() * group.templates.len();
        }
        groups
    }

    /// Part of the simulator in which the templates act.
    pub fn hook(&self) -> &'a str {
        &self.templates[0].hook
    }

    /// Derivatives that the models need, in the order of the columns. Each effect of the library has a probe of its own,
    /// because it may have nothing to act on.
    pub fn probes(&self) -> Vec<Probe<'a>> {
        let companion = self.templates[0].companion.as_ref();
        let settings = || companion.map(|(_, name)| (name.as_str(), self.settings.clone()));
        let probe =
            |of: &[&'a Template]| Probe { names: of.iter().map(|t| t.name.as_str()).collect(), settings: settings() };
        if self.is_known() { self.templates.chunks(1).map(probe).collect() } else { vec![probe(&self.templates)] }
    }

    /// Returns whether the templates act at a place.
    pub fn is_placed(&self) -> bool {
        self.companion() == Some(Companion::Place)
    }

    /// Returns whether the templates are effects of the library.
    fn is_known(&self) -> bool {
        self.templates[0].is_known
    }

    /// Columns with the scales that turn derivatives into changes by the largest sizes of the priors.
    pub fn scales(&self) -> impl Iterator<Item = (usize, f64)> {
        let mosts = self.templates.iter().map(|t| t.most).cycle();
        self.all_columns().into_iter().zip(mosts)
    }

    /// Number of settings.
    fn count(&self) -> usize {
        self.settings.len().max(1)
    }

    /// Columns of a setting.
    pub fn columns(&self, setting: usize) -> Vec<usize> {
        let width = self.templates.len();
        (0..width).map(|i| self.first + width * setting + i).collect()
    }

    fn all_columns(&self) -> Vec<usize> {
        (0..self.count()).flat_map(|setting| self.columns(setting)).collect()
    }

    fn companion(&self) -> Option<Companion> {
        self.templates[0].companion.as_ref().map(|(companion, _)| *companion)
    }

    /// Models of the settings, each with the templates at this setting alone.
    fn models(&self) -> Vec<LinearModel> {
        let count = self.templates.len();
        let is_positive = count == 1 && self.templates[0].is_positive();
        let model = |setting| LinearModel { columns: self.columns(setting), relative: vec![1.0; count], is_positive };
        (0..self.count()).map(model).collect()
    }

    /// Standard deviations of the sizes of a smooth function of place or time, relative to each other, a number a column.
    fn smooth(&self) -> Vec<f64> {
        let of = |setting: usize| match self.companion() {
            Some(Companion::Frequency) => 1.0 / (1.0 + (self.settings[setting] / SMOOTH_HZ).powi(2)).sqrt(),
            _ => 1.0,
        };
        (0..self.count()).flat_map(|setting| vec![of(setting); self.templates.len()]).collect()
    }

    /// Value of the companion at a setting; none without a companion.
    pub fn companion_at(&self, setting: usize) -> Option<f64> {
        self.settings.get(setting).copied()
    }

    /// Templates and their companion as effects that a fit finds, in this order.
    pub fn as_candidates(&self) -> Vec<Candidate> {
        let effect = |name: &str, prior, range| {
            let (name, title) = (name.to_owned(), name.to_owned());
            Candidate { name, title, prior, range, base: 0.0, odds: 1.0, companions: Vec::new() }
        };
        let template = |template: &&Template| {
            let low = template.range[0].max(-template.most);
            effect(&template.name, Prior::Uniform { low, high: template.most }, template.range)
        };
        let companion = self.templates[0].companion.as_ref().map(|(companion, name)| {
            let high =
                if *companion == Companion::Place { 1.0 } else { self.settings.iter().copied().fold(0.0, f64::max) };
            effect(name, Prior::Uniform { low: 0.0, high }, [0.0, high])
        });
        self.templates.iter().map(template).chain(companion).collect()
    }

    /// Form of the templates with sizes relative to the largest ones of the priors, and a value of the companion.
    pub fn form(&self, sizes: &[f64], companion: Option<f64>) -> Form {
        let sizes: Vec<f64> = sizes.iter().zip(&self.templates).map(|(size, template)| size * template.most).collect();
        let at = |wanted| companion.filter(|_| self.companion() == Some(wanted));
        Form::of(&self.templates, &sizes, at(Companion::Place), at(Companion::Frequency))
    }
}

impl<'a> Kind<'a> {
    /// Kinds of models, by part of the simulator: each group alone; all settings of a group together, as a smooth function of
    /// place or time; the effects of the library together; and all groups of a part together.
    pub fn all(groups: &[Group<'a>]) -> Vec<Self> {
        let mut kinds = Vec::new();
        let mut from = 0;
        for own in groups.chunk_by(|a, b| a.hook() == b.hook()) {
            let hook = own[0].hook();
            let mixture = |of: &[Group<'_>]| LinearModel {
                columns: of.iter().flat_map(Group::all_columns).collect(),
                relative: of.iter().flat_map(Group::smooth).collect(),
                is_positive: false,
            };
            for (i, group) in own.iter().enumerate() {
                if !group.is_known() {
                    kinds.push(Kind { hook, group: Some(from + i), models: group.models() });
                }
                if group.is_known() || group.count() > 1 {
                    kinds.push(Kind { hook, group: None, models: vec![mixture(std::slice::from_ref(group))] });
                }
            }
            if own.len() > 1 {
                kinds.push(Kind { hook, group: None, models: vec![mixture(own)] });
            }
            from += own.len();
        }
        kinds
    }
}

fn places() -> Vec<f64> {
    let [from, to, step] = PLACES;
    let count = ((to - from) / step).round() as usize;
    (0..=count).map(|i| from + step * i as f64).collect()
}

/// Duration of the longest episode, s.
fn longest_s(problem: &Problem<'_>) -> f64 {
    let last = problem.episodes.iter().filter_map(|e| e.measured.frames.last());
    last.map(|frame| frame.time_s).fold(0.0, f64::max)
}

/// Greatest mean frame rate of an episode; zero without frames.
fn frame_rate_hz(problem: &Problem<'_>) -> f64 {
    let rate = |frames: &[Frame]| {
        let (first, last) = (frames.first()?, frames.last()?);
        Some((frames.len() - 1) as f64 / (last.time_s - first.time_s)).filter(|rate| rate.is_finite())
    };
    problem.episodes.iter().filter_map(|e| rate(&e.measured.frames)).fold(0.0, f64::max)
}

/// Tried frequencies for episodes of `longest_s` with a frame rate, in Hz; empty for episodes without a duration.
fn frequencies_hz(longest_s: f64, frame_rate_hz: f64) -> Vec<f64> {
    let greatest_hz = GREATEST_HZ.min(GREATEST_SHARE * frame_rate_hz);
    let mut all = Vec::new();
    let mut next_hz = 0.5 / longest_s;
    while next_hz <= greatest_hz {
        all.push(next_hz);
        next_hz = match all.len() {
            few if few < HALF_WAVES => next_hz + 0.5 / longest_s,
            some if some < WAVES => next_hz + 1.0 / longest_s,
            _ => RATIO * next_hz,
        };
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequencies_resolve_slow_waves_and_end_at_the_highest() {
        let all = frequencies_hz(8.0, 30.0);
        assert!((all[0] - 0.0625).abs() < 1e-12 && (all[11] - 0.75).abs() < 1e-12, "{all:?}");
        let gaps: Vec<f64> = all.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(gaps.iter().all(|gap| *gap <= 0.125 + 1e-12), "a wave between two looks like both");
        assert!(all.last().is_some_and(|hz| (7.0..=8.0).contains(hz)));
        let long = frequencies_hz(60.0, 30.0);
        assert!(long.len() < 90 && long.last().is_some_and(|hz| *hz > 6.0), "{}", long.len());
        assert!(frequencies_hz(0.0, 30.0).is_empty() && frequencies_hz(8.0, 0.0).is_empty());
        assert!(frequencies_hz(8.0, 4.0).last().is_some_and(|hz| *hz <= 1.6), "half the frame rate is 2 Hz");
    }

    fn template(name: &str, hook: &str, companion: Option<Companion>) -> Template {
        Template {
            name: name.into(),
            title: format!("{name}, one"),
            unit: "N".into(),
            hook: hook.into(),
            most: 2.0,
            range: [-10.0, 10.0],
            is_known: false,
            companion: companion.map(|c| (c, format!("{c:?}"))),
        }
    }

    fn group<'a>(templates: Vec<&'a Template>, settings: Vec<f64>, first: usize) -> Group<'a> {
        Group { templates, settings, first }
    }

    #[test]
    fn each_part_has_its_groups_alone_as_functions_and_together() {
        let wave = ["sin", "cos"].map(|name| template(name, "force", Some(Companion::Frequency)));
        let (mass, gain) = (template("mass", "force", Some(Companion::Place)), template("gain", "actuation", None));
        let groups = [
            group(vec![&gain], Vec::new(), 0),
            group(vec![&mass], vec![0.2, 0.5, 0.8], 1),
            group(wave.iter().collect(), vec![0.5, 2.0], 4),
        ];
        let kinds = Kind::all(&groups);
        let seen: Vec<_> = kinds.iter().map(|k| (k.hook, k.group, k.models.len(), k.models[0].columns.len())).collect();
        let expected = [
            ("actuation", Some(0), 1, 1),
            ("force", Some(1), 3, 1),
            ("force", None, 1, 3),
            ("force", Some(2), 2, 2),
            ("force", None, 1, 4),
            ("force", None, 1, 7),
        ];
        assert_eq!(seen, expected);
        assert_eq!(kinds[3].models[1].columns, [6, 7]);
        // Fast waves are smaller in a smooth function.
        assert!(kinds[4].models[0].relative[2] < 0.5 * kinds[4].models[0].relative[0]);
    }

    #[test]
    fn a_form_has_the_place_or_the_frequency_and_the_common_size() {
        let wave = ["sin", "cos"].map(|name| template(name, "force", Some(Companion::Frequency)));
        let group = group(wave.iter().collect(), vec![0.5, 2.0], 0);
        let form = group.form(&[0.3, -0.4], group.companion_at(1));
        let names: Vec<String> = group.as_candidates().into_iter().map(|c| c.name).collect();
        assert_eq!(names, ["sin", "cos", "Frequency"]);
        assert_eq!((form.template.as_str(), form.title.as_str()), ("cos", "cos"));
        assert!((form.size - 1.0).abs() < 1e-12 && form.frequency_hz == Some(2.0) && form.place.is_none());
    }
}
