//! Policy with everything that is needed to run it, and its file format.

mod memory;
mod other_arm;
mod plan;
mod start_speed;

pub use memory::{Memory, Observes};
pub use other_arm::OtherArm;
pub use plan::Plan;
pub use start_speed::{GREATEST_START_SPEED_M_S, is_start_speed};

use crate::Observation;
use crate::mlp::{Layer, Mlp, MlpError};
use crate::model::ArmLaw;
use crate::task::{DeltaAnchor, Goal, MAX_DELTA_M, MOST_STEPS, REWARD_RANGE_M, STEP_PERIOD_S};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};
use thiserror::Error;

/// Value of the metadata entry `format` of a policy file that programs before plans can run, too.
const FORMAT: &str = "catenary policy 1";
/// Value of the entry in a file of a policy with a plan, or that observes the time. Earlier programs refuse it.
const FORMAT_WITH_TIME: &str = "catenary policy 2";
/// Greatest standard deviation of an action in a file, in units of the action limit.
const GREATEST_ACTION_SCALE: f32 = 100.0;

/// Greatest weight, bias and mean of an observation in a file: with larger ones an action could overflow to NaN.
const GREATEST_NUMBER: f32 = 1e6;
/// Most layers, and greatest width of one. They bound the time that a damaged file can claim of a step.
const MOST_LAYERS: usize = 16;
const GREATEST_WIDTH: usize = 8192;
/// Longest name, bytes.
const LONGEST_NAME: usize = 256;

/// Most observations before the newest that a policy may take.
pub const MOST_HISTORY: usize = 64;

/// Gaussian policy over actions (dx, dz). The mean, in units of the action limit, is the output of the network plus the action of the plan,
/// if there is one (residual policy learning, Johannink et al. 2019).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Policy {
    /// Name that episodes report.
    pub name: String,
    /// Actor network. Inputs: those of `observes`. Outputs: mean of dx and dz, where 1 is the action limit of 0.06 m.
    pub actor: Mlp,
    /// Inputs of the network.
    pub observes: Observes,
    /// Open-loop plan that the network corrects; none: the network alone acts.
    pub plan: Option<Plan>,
    /// Mean of each observation component in training.
    pub observation_mean: [f32; Observation::LEN],
    /// Standard deviation of each observation component in training.
    pub observation_scale: [f32; Observation::LEN],
    /// Standard deviation of the sampled action, in units of the action limit.
    pub action_scale: [f32; 2],
    /// Time between two actions in s. A delta is a motion within this time.
    pub step_period_s: f64,
    /// Pose that a delta is added to.
    pub delta_anchor: DeltaAnchor,
    /// Actions of an episode.
    pub steps: usize,
    /// Goal that it was trained for; none in files of earlier versions, which do not say it.
    pub goal: Option<Goal>,
    /// Law of the arm that it was trained for; none in files of earlier versions, which do not say it.
    pub arm: Option<ArmLaw>,
    /// Greatest speed of the object's tip at the starts of its training; none if the object was at rest.
    pub start_speed_m_s: Option<f64>,
}

/// Reason for which a policy file is refused.
#[derive(Debug, Error)]
pub enum PolicyError {
    /// Not a safetensors file, or a truncated one.
    #[error("is this a policy? It is not a safetensors file: {0}")]
    Format(safetensors::SafeTensorError),
    /// A metadata field or a tensor is missing or unusable.
    #[error("policy: `{field}`: expected {expected}, got {got}")]
    Field {
        /// Name of the field.
        field: String,
        /// Expected value.
        expected: String,
        /// Given value.
        got: String,
    },
    /// Tensors from which no network can be built.
    #[error("policy: {0}")]
    Network(MlpError),
}

// Both messages include their cause. With `#[from]` the cause would also be the source, and a printed chain of causes
// would state it twice.
impl From<safetensors::SafeTensorError> for PolicyError {
    fn from(error: safetensors::SafeTensorError) -> Self {
        Self::Format(error)
    }
}

impl From<MlpError> for PolicyError {
    fn from(error: MlpError) -> Self {
        Self::Network(error)
    }
}

impl Policy {
    /// Why an episode may begin while the object moves, in words; none for a policy that was trained for objects at rest.
    #[must_use]
    pub fn moving_start(&self) -> Option<String> {
        let speed = self.start_speed_m_s?;
        Some(format!("policy `{}` was trained for starts in motion, up to {speed} m/s at the tip", self.name))
    }

    /// Computes the mean action (dx, dz) in m for the newest observation of an episode, within the action limits. To be called once for each
    /// observation, in order: `memory` holds those before it, and this one is added. An episode starts with an empty memory.
    pub fn act(&self, observation: &Observation, memory: &mut Memory) -> [f64; 2] {
        let mean = self.mean(observation, memory);
        [scaled_action(mean[0]), scaled_action(mean[1])]
    }

    /// As [`Policy::act`], with `noise` (two standard normal draws) times the standard deviation added before the limits.
    pub fn act_with_noise(&self, observation: &Observation, memory: &mut Memory, noise: [f32; 2]) -> [f64; 2] {
        let mean = self.mean(observation, memory);
        std::array::from_fn(|i| scaled_action(mean[i] + self.action_scale[i] * noise[i]))
    }

    fn mean(&self, observation: &Observation, memory: &mut Memory) -> [f32; 2] {
        memory.see(observation, self.observes.history);
        let mut x = Vec::with_capacity(self.observes.count());
        self.observes.append_inputs(memory, self.steps, &self.observation_mean, &self.observation_scale, &mut x);
        let mean = self.actor.forward(&x, 1);
        let planned = self.plan.as_ref().map_or([0.0; 2], |plan| plan.action(memory));
        std::array::from_fn(|i| mean[i] + planned[i])
    }

    /// Writes the policy as a safetensors file. Equal policies give equal bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
        let mut add = |name: String, shape: Vec<usize>, values: &[f32]| {
            tensors.push((name, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect()));
        };
        for (i, l) in self.actor.layers().iter().enumerate() {
            add(format!("actor.{i}.weight"), vec![l.outputs, l.inputs], &l.weight);
            add(format!("actor.{i}.bias"), vec![l.outputs], &l.bias);
        }
        add("observation_mean".into(), vec![Observation::LEN], &self.observation_mean);
        add("observation_scale".into(), vec![Observation::LEN], &self.observation_scale);
        add("action_scale".into(), vec![2], &self.action_scale);
        if let Some(plan) = &self.plan {
            add("plan".into(), vec![plan.steps.len(), 2, 3], &plan.numbers());
        }
        let format = if self.plan.is_some() || self.observes.time { FORMAT_WITH_TIME } else { FORMAT };
        let mut metadata = HashMap::from([
            ("format".to_owned(), format.to_owned()),
            ("name".to_owned(), self.name.clone()),
            ("step_period_s".to_owned(), self.step_period_s.to_string()),
            ("delta_anchor".to_owned(), anchor_name(self.delta_anchor).to_owned()),
            ("steps".to_owned(), self.steps.to_string()),
        ]);
        // Files of policies without a history stay as those of earlier versions, which do not know the entry.
        if self.observes.history > 0 {
            metadata.insert("history".to_owned(), self.observes.history.to_string());
        }
        if self.observes.time {
            metadata.insert("time".to_owned(), "true".to_owned());
        }
        if let Some(goal) = &self.goal {
            metadata
                .insert("goal".to_owned(), serde_json::to_string(goal).expect("a goal has names and numbers alone"));
        }
        if let Some(law) = &self.arm {
            metadata.insert("arm".to_owned(), law.to_text());
        }
        if let Some(speed) = self.start_speed_m_s {
            metadata.insert(start_speed::ENTRY.to_owned(), speed.to_string());
        }
        let views = tensors.iter().map(|(name, shape, data)| {
            let view = TensorView::new(Dtype::F32, shape.clone(), data).expect("shape and data were made together");
            (name.as_str(), view)
        });
        in_order(&safetensors::serialize(views, Some(metadata)).expect("the tensors are valid and named once"))
    }

    /// Reads a safetensors file written by [`Policy::to_bytes`].
    ///
    /// # Errors
    /// [`PolicyError`] if the file is damaged, or a field is missing or out of range.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PolicyError> {
        let (_, header) = SafeTensors::read_metadata(bytes)?;
        let file = SafeTensors::deserialize(bytes)?;
        let metadata = header.metadata().clone().unwrap_or_default();
        let text = |field: &str| metadata.get(field).cloned().ok_or_else(|| bad(field, "a metadata entry", "none"));
        match text("format")? {
            format if [FORMAT, FORMAT_WITH_TIME].contains(&format.as_str()) => {}
            other => return Err(bad("format", &format!("{FORMAT} or {FORMAT_WITH_TIME}"), &other)),
        }
        let mut layers = Vec::new();
        // Layers are numbered from 0; the first number without a tensor ends them.
        while file.tensor(&format!("actor.{}.weight", layers.len())).is_ok() {
            layers.push(layer(&file, layers.len())?);
            if layers.len() > MOST_LAYERS {
                return Err(bad("actor", &format!("at most {MOST_LAYERS} layers"), "more"));
            }
        }
        let actor = Mlp::new(layers)?;
        let history = metadata.get("history").map_or("0", String::as_str);
        let history = history
            .parse()
            .ok()
            .filter(|n| *n <= MOST_HISTORY)
            .ok_or_else(|| bad("history", &format!("a whole number from 0 to {MOST_HISTORY}"), history))?;
        let time = match metadata.get("time").map_or("false", String::as_str) {
            "true" => true,
            "false" => false,
            other => return Err(bad("time", "true or false", other)),
        };
        let observes = Observes { history, time };
        let inputs = observes.count();
        if actor.inputs() != inputs || actor.outputs() != 2 {
            let got = format!("{} and {}", actor.inputs(), actor.outputs());
            return Err(bad("actor", &format!("{inputs} inputs and 2 outputs"), &got));
        }
        let period = text("step_period_s")?;
        let [shortest, longest] = STEP_PERIOD_S;
        let step_period_s = period.parse().ok().filter(|p: &f64| (shortest..=longest).contains(p));
        let steps = text("steps")?;
        let steps = steps
            .parse()
            .ok()
            .filter(|n| (1..=MOST_STEPS).contains(n))
            .ok_or_else(|| bad("steps", &format!("a whole number from 1 to {MOST_STEPS}"), &steps))?;
        let plan = if file.tensor("plan").is_ok() { Some(plan(&file, steps)?) } else { None };
        let anchor = text("delta_anchor")?;
        let goal = metadata.get("goal").map(|text| {
            let goal: Goal = serde_json::from_str(text)
                .map_err(|error| bad("goal", "a goal as a model file has it", &format!("{text}: {error}")))?;
            let [least, most] = REWARD_RANGE_M;
            match goal.reward_range_m().filter(|range_m| !(least..=most).contains(range_m)) {
                Some(got) => Err(bad("goal", &format!("a reward_range_m of {least} to {most} m"), &got.to_string())),
                None => Ok(goal),
            }
        });
        let arm = metadata.get("arm").map(|text| {
            let wrong = |error| bad("arm", "the law of an arm as a model file has it", &format!("{text}: {error}"));
            ArmLaw::from_text(text).map_err(wrong)
        });
        let start_speed_m_s = metadata
            .get(start_speed::ENTRY)
            .map(|text| start_speed::of(text).map_err(|expected| bad(start_speed::ENTRY, &expected, text)));
        let name = text("name")?;
        // Events, logs and pages show it.
        if name.len() > LONGEST_NAME || name.chars().any(char::is_control) {
            let got = format!("{} bytes: {:?}", name.len(), name.chars().take(40).collect::<String>());
            return Err(bad("name", &format!("at most {LONGEST_NAME} bytes of text in one line"), &got));
        }
        Ok(Self {
            name,
            actor,
            observes,
            plan,
            observation_mean: within(
                fixed(&file, "observation_mean")?,
                "observation_mean",
                &format!("numbers of -{GREATEST_NUMBER} to {GREATEST_NUMBER}"),
                |v| v.abs() <= GREATEST_NUMBER,
            )?,
            observation_scale: within(
                fixed(&file, "observation_scale")?,
                "observation_scale",
                &format!("positive numbers of at most {GREATEST_NUMBER}"),
                |v| v > 0.0 && v <= GREATEST_NUMBER,
            )?,
            action_scale: within(fixed(&file, "action_scale")?, "action_scale", "numbers from 0 to 100", |v| {
                (0.0..=GREATEST_ACTION_SCALE).contains(&v)
            })?,
            step_period_s: step_period_s
                .ok_or_else(|| bad("step_period_s", &format!("{shortest} to {longest} s"), &period))?,
            delta_anchor: match anchor.as_str() {
                "measured" => DeltaAnchor::Measured,
                "last_target" => DeltaAnchor::LastTarget,
                other => return Err(bad("delta_anchor", "measured or last_target", other)),
            },
            steps,
            goal: goal.transpose()?,
            arm: arm.transpose()?,
            start_speed_m_s: start_speed_m_s.transpose()?,
        })
    }
}

/// Sorts the entries of a safetensors file's header by name, because the library writes the metadata in a random order.
///
/// The header is a length in eight bytes and a JSON object, padded with spaces to a multiple of eight bytes.
fn in_order(file: &[u8]) -> Vec<u8> {
    const VALID: &str = "the library wrote a valid header";
    let (length, rest) = file.split_first_chunk::<8>().expect(VALID);
    let (header, data) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let mut header: BTreeMap<String, serde_json::Value> = serde_json::from_slice(header).expect(VALID);
    if let Some(metadata) = header.get_mut("__metadata__") {
        let entries: BTreeMap<String, String> = serde_json::from_value(metadata.take()).expect(VALID);
        *metadata = entries.into_iter().collect();
    }
    let mut text = serde_json::to_vec(&header).expect(VALID);
    text.resize(text.len().next_multiple_of(8), b' ');
    [&(text.len() as u64).to_le_bytes()[..], &text, data].concat()
}

/// Converts a network output (1 is the action limit) to m, within the limits.
fn scaled_action(output: f32) -> f64 {
    f64::from(output.clamp(-1.0, 1.0)) * MAX_DELTA_M
}

/// Name of an anchor in files.
fn anchor_name(anchor: DeltaAnchor) -> &'static str {
    match anchor {
        DeltaAnchor::Measured => "measured",
        DeltaAnchor::LastTarget => "last_target",
    }
}

fn bad(field: &str, expected: &str, got: &str) -> PolicyError {
    PolicyError::Field { field: field.into(), expected: expected.into(), got: got.into() }
}

/// Shape and values of a tensor.
fn values(file: &SafeTensors<'_>, name: &str) -> Result<(Vec<usize>, Vec<f32>), PolicyError> {
    let view = file.tensor(name).map_err(|_| bad(name, "a tensor", "none"))?;
    if view.dtype() != Dtype::F32 {
        return Err(bad(name, "F32", &format!("{:?}", view.dtype())));
    }
    let data: Vec<f32> = view.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    if !data.iter().all(|v| v.is_finite()) {
        return Err(bad(name, "finite values", "NaN or infinity"));
    }
    Ok((view.shape().to_vec(), data))
}

fn fixed<const N: usize>(file: &SafeTensors<'_>, name: &str) -> Result<[f32; N], PolicyError> {
    let (_, data) = values(file, name)?;
    let got = data.len();
    data.try_into().map_err(|_| bad(name, &format!("{N} values"), &got.to_string()))
}

/// Returns the values if each of them passes `is_good`.
fn within<const N: usize>(
    values: [f32; N],
    name: &str,
    expected: &str,
    is_good: impl Fn(f32) -> bool,
) -> Result<[f32; N], PolicyError> {
    match values.into_iter().find(|v| !is_good(*v)) {
        Some(got) => Err(bad(name, expected, &got.to_string())),
        None => Ok(values),
    }
}

fn layer(file: &SafeTensors<'_>, index: usize) -> Result<Layer, PolicyError> {
    let name = format!("actor.{index}.weight");
    let (shape, weight) = values(file, &name)?;
    let [outputs, inputs] = shape[..] else {
        return Err(bad(&name, "a matrix", &format!("{shape:?}")));
    };
    if inputs.max(outputs) > GREATEST_WIDTH {
        return Err(bad(&name, &format!("at most {GREATEST_WIDTH} rows and columns"), &format!("{shape:?}")));
    }
    let bias_name = format!("actor.{index}.bias");
    let (_, bias) = values(file, &bias_name)?;
    for (name, numbers) in [(&name, &weight), (&bias_name, &bias)] {
        if let Some(got) = numbers.iter().find(|v| v.abs() > GREATEST_NUMBER) {
            return Err(bad(name, &format!("numbers of -{GREATEST_NUMBER} to {GREATEST_NUMBER}"), &got.to_string()));
        }
    }
    Ok(Layer { inputs, outputs, weight, bias })
}

/// Plan of a file: a row of three numbers for dx and one for dz, at each step.
fn plan(file: &SafeTensors<'_>, steps: usize) -> Result<Plan, PolicyError> {
    let (shape, numbers) = values(file, "plan")?;
    if shape != [steps, 2, 3] {
        return Err(bad("plan", &format!("the shape {:?}", [steps, 2, 3]), &format!("{shape:?}")));
    }
    if let Some(got) = numbers.iter().find(|v| v.abs() > GREATEST_NUMBER) {
        return Err(bad("plan", &format!("numbers of -{GREATEST_NUMBER} to {GREATEST_NUMBER}"), &got.to_string()));
    }
    Ok(Plan::of_numbers(&numbers))
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn policy() -> Policy {
        let l = |inputs: usize, outputs: usize| Layer {
            inputs,
            outputs,
            weight: (0..inputs * outputs).map(|i| (i as f32 * 0.37).sin()).collect(),
            bias: vec![0.1; outputs],
        };
        Policy {
            name: "pi0".into(),
            actor: Mlp::new(vec![l(12, 5), l(5, 2)]).unwrap(),
            observes: Observes::default(),
            plan: None,
            observation_mean: [0.1; 12],
            observation_scale: [2.0; 12],
            action_scale: [0.5, 0.4],
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
            steps: 16,
            goal: Some(Goal::PlaceTip { reward_range_m: 0.4 }),
            arm: Some(ArmLaw::Lag { time_constant_s: 0.16, max_speed_m_s: 0.5 }),
            start_speed_m_s: None,
        }
    }

    #[test]
    fn file_round_trip_keeps_every_bit() {
        let p = policy();
        assert_eq!(Policy::from_bytes(&p.to_bytes()).unwrap(), p);
        let silent = Policy { goal: None, arm: None, ..p.clone() };
        assert_eq!(Policy::from_bytes(&silent.to_bytes()).unwrap(), silent);
        assert!((0..8).all(|_| p.to_bytes() == p.to_bytes()), "the same policy gave other bytes");
    }

    #[test]
    fn truncated_and_foreign_files_are_refused() {
        let bytes = policy().to_bytes();
        assert!(Policy::from_bytes(&bytes[..bytes.len() / 2]).is_err());
        assert!(Policy::from_bytes(b"not a policy").is_err());
    }

    #[test]
    fn every_field_of_a_file_is_checked() {
        type Change = fn(&mut Policy);
        let cases: [(Change, &str); 13] = [
            (|p| p.step_period_s = 1e9, "`step_period_s`: expected 0.001 to 10 s, got 1000000000"),
            (
                |p| p.goal = Some(Goal::PlaceTip { reward_range_m: 0.0 }),
                "`goal`: expected a reward_range_m of 0.001 to 10 m, got 0",
            ),
            (
                |p| p.actor.layers_mut()[1].weight[0] = 1e38,
                "`actor.1.weight`: expected numbers of -1000000 to 1000000, got 100000000000000000000000000000000000000",
            ),
            (
                |p| p.observation_mean[2] = -2e6,
                "`observation_mean`: expected numbers of -1000000 to 1000000, got -2000000",
            ),
            (
                |p| p.name = "a\nb".into(),
                "`name`: expected at most 256 bytes of text in one line, got 3 bytes: \"a\\nb\"",
            ),
            (|p| p.steps = 0, "`steps`: expected a whole number from 1 to 100000, got 0"),
            (|p| p.steps = 1_000_000, "`steps`: expected a whole number from 1 to 100000, got 1000000"),
            (
                |p| p.observation_scale = [0.0; 12],
                "`observation_scale`: expected positive numbers of at most 1000000, got 0",
            ),
            (
                |p| p.observation_scale[3] = -1.0,
                "`observation_scale`: expected positive numbers of at most 1000000, got -1",
            ),
            (|p| p.action_scale = [1e9, 0.1], "`action_scale`: expected numbers from 0 to 100, got 1000000000"),
            (|p| p.action_scale[1] = -0.5, "`action_scale`: expected numbers from 0 to 100, got -0.5"),
            (
                |p| p.arm = Some(ArmLaw::Lag { time_constant_s: -1.0, max_speed_m_s: 0.5 }),
                "`arm`: expected the law of an arm as a model file has it, got \
                 {\"lag\":{\"time_constant_s\":-1.0,\"max_speed_m_s\":0.5}}: model, `arm_law.lag.time_constant_s`: expected 0 to 5 s, got -1",
            ),
            (|p| p.step_period_s = 0.0, "`step_period_s`: expected 0.001 to 10 s, got 0"),
        ];
        for (change, words) in cases {
            let mut p = policy();
            change(&mut p);
            assert_eq!(Policy::from_bytes(&p.to_bytes()).unwrap_err().to_string(), format!("policy: {words}"));
        }
        let bytes = policy().to_bytes();
        let place = bytes.windows(FORMAT.len()).position(|w| w == FORMAT.as_bytes()).unwrap();
        let mut other = bytes.clone();
        other[place + FORMAT.len() - 1] = b'3';
        let words = Policy::from_bytes(&other).unwrap_err().to_string();
        assert_eq!(words, "policy: `format`: expected catenary policy 1 or catenary policy 2, got catenary policy 3");
    }

    #[test]
    fn actions_stay_within_the_limits() {
        let p = policy();
        let a = p.act_with_noise(&Observation([5.0; 12]), &mut Memory::default(), [100.0, -100.0]);
        assert_eq!(a, [MAX_DELTA_M, -MAX_DELTA_M]);
    }

    #[test]
    fn a_policy_with_a_history_acts_on_it_and_its_file_keeps_it() {
        // dx is the change of x, dz that of z, between the newest observation and the one before it.
        let mut weight = vec![0.0; 48];
        (weight[0], weight[12], weight[24 + 1], weight[24 + 13]) = (1.0, -1.0, 1.0, -1.0);
        let actor = Mlp::new(vec![Layer { inputs: 24, outputs: 2, weight, bias: vec![0.0; 2] }]).unwrap();
        let (observation_mean, observation_scale) = ([0.0; 12], [1.0; 12]);
        let observes = Observes { history: 1, time: false };
        let p = Policy { actor, observes, observation_mean, observation_scale, ..policy() };
        let at = |x: f64, z: f64| Observation::new([x, z], &[[0.0; 2]; 4], [0.0; 2]);
        let mut memory = Memory::default();
        assert_eq!(p.act(&at(0.4, 0.3), &mut memory), [0.0, 0.0]);
        let action = p.act(&at(0.5, 0.1), &mut memory);
        assert!((action[0] - 0.1 * MAX_DELTA_M).abs() < 1e-8 && (action[1] + 0.2 * MAX_DELTA_M).abs() < 1e-8);
        assert_eq!(Policy::from_bytes(&p.to_bytes()).unwrap(), p);
        let wrong = Policy { observes: Observes { history: 2, time: false }, ..p.clone() };
        let words = Policy::from_bytes(&wrong.to_bytes()).unwrap_err().to_string();
        assert_eq!(words, "policy: `actor`: expected 36 inputs and 2 outputs, got 24 and 2");
        let wrong = Policy { observes: Observes { history: 65, time: false }, ..p };
        let words = Policy::from_bytes(&wrong.to_bytes()).unwrap_err().to_string();
        assert_eq!(words, "policy: `history`: expected a whole number from 0 to 64, got 65");
    }

    #[test]
    fn a_plan_and_the_time_add_to_the_network_and_earlier_programs_refuse_their_files() {
        // dx is the time, dz nothing; the plan adds half the limit to dz of the first step.
        let mut weight = vec![0.0; 26];
        weight[12] = 1.0;
        let actor = Mlp::new(vec![Layer { inputs: 13, outputs: 2, weight, bias: vec![0.0; 2] }]).unwrap();
        let plan = Plan { steps: vec![[[0.0; 3], [0.5, 0.0, 0.0]], [[0.0; 3]; 2]] };
        let observes = Observes { history: 0, time: true };
        let p = Policy { actor, observes, plan: Some(plan), steps: 2, ..policy() };
        let mut memory = Memory::default();
        let actions = [(); 2].map(|()| p.act(&Observation::default(), &mut memory));
        assert_eq!(actions, [[-MAX_DELTA_M, 0.5 * MAX_DELTA_M], [0.0, 0.0]]);
        let bytes = p.to_bytes();
        assert_eq!(Policy::from_bytes(&bytes).unwrap(), p);
        assert!(bytes.windows(FORMAT.len()).any(|w| w == FORMAT_WITH_TIME.as_bytes()));
        assert!(policy().to_bytes().windows(FORMAT.len()).any(|w| w == FORMAT.as_bytes()));
        let words = |p: Policy| Policy::from_bytes(&p.to_bytes()).unwrap_err().to_string();
        assert_eq!(
            words(Policy { steps: 3, ..p.clone() }),
            "policy: `plan`: expected the shape [3, 2, 3], got [2, 2, 3]"
        );
        let huge = Plan { steps: vec![[[1e9, 0.0, 0.0]; 2]; 2] };
        assert_eq!(
            words(Policy { plan: Some(huge), ..p }),
            "policy: `plan`: expected numbers of -1000000 to 1000000, got 1000000000"
        );
    }
}
