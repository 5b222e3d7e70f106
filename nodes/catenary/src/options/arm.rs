//! Option for the law of the arm that policies are trained for.

use crate::exit::{Given, WrongInput};
use crate::graph::arm_law::{self, Told};
use crate::inputs::shipped::LAUNCH_CONFIGS;
use crate::terminal::output;
use anyhow::{Context, Result, bail};
use catenary_core::Model;
use catenary_core::model::ArmLaw;
use catenary_shell::RosArgs;
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Names of the shipped parameter files of a bridge.
const SHIPPED: [&str; 2] = ["emulated", "lab"];

/// Arm in place of the model's.
#[derive(Debug, Args)]
pub struct ArmOption {
    /// Law of the arm: emulated, lab, or a parameter file (that of the bridge with these parameters), running (that of the arm in this ROS
    /// domain), or model; default: that of the graph if `catenary launch` runs on this computer, else the model's
    #[arg(long, value_name = "ARM")]
    pub arm: Option<PathBuf>,
}

impl ArmOption {
    /// The model with the law of the arm that was asked for. The law is printed if it is not the model's.
    ///
    /// # Errors
    /// A parameter file that cannot be read, no running arm.
    pub fn applied_to(&self, mut model: Model) -> Result<Model> {
        let Some((law, source)) = self.law(&model.arm.law).given()? else { return Ok(model) };
        if law != model.arm.law {
            output::tell(&format!("arm: {law}, {source}; --arm model keeps {}", model.arm.law));
            model.arm.law = law;
        }
        Ok(model)
    }

    /// Law and its source in words; `None`: the model's, which is `own`.
    fn law(&self, own: &ArmLaw) -> Result<Option<(ArmLaw, String)>> {
        let Some(arm) = &self.arm else {
            let Some((told, file)) = arm_law::of_launch()? else { return Ok(None) };
            return beside(&told, &file, own);
        };
        if !arm.is_file() {
            match arm.to_str() {
                Some("model") => return Ok(None),
                Some("running") => {
                    return match arm_law::of_domain()? {
                        Told::Law(law) => Ok(Some((law, "as in the running graph".to_owned()))),
                        other => {
                            bail!("--arm running: {other}: start the graph of one arm, or name its parameter file")
                        }
                    };
                }
                Some(name) if SHIPPED.contains(&name) => {
                    return Ok(Some((shipped(name)?, format!("of the bridge with params/{name}.yaml"))));
                }
                _ => {}
            }
            let expected = "model, running, emulated, lab, or a parameter file of the bridge";
            return Err(WrongInput::error(format!("--arm: expected {expected}, got {}", arm.display())));
        }
        let law =
            of_file(arm, &|path| std::fs::read_to_string(path)).with_context(|| format!("--arm {}", arm.display()))?;
        Ok(Some((law, format!("of the bridge with {}", arm.display()))))
    }
}

/// Law for a work beside the running graph of `file`, with its source, from what that graph told. None: the model's, `own`, which is then said.
fn beside(told: &Told, file: &str, own: &ArmLaw) -> Result<Option<(ArmLaw, String)>> {
    match told {
        Told::Law(law) => Ok(Some((*law, format!("as in the running graph of {file}")))),
        Told::Several(_) => bail!("the running graph of {file}: {told}: choose the arm with --arm"),
        Told::Nobody | Told::Nothing(_) => {
            output::tell(&format!(
                "arm: {own}, the model's, because the running graph of {file} does not tell its arm's law ({told})"
            ));
            Ok(None)
        }
    }
}

/// Arm of a simulation in its report.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(transparent)]
pub struct SimulatedArm {
    law: ArmLaw,
    /// Law of the model's own arm.
    #[serde(skip)]
    own: ArmLaw,
}

impl SimulatedArm {
    /// Arm of this law in place of the model's, `own`.
    pub fn new(law: ArmLaw, own: ArmLaw) -> Self {
        Self { law, own }
    }

    /// Line of a report. None for the model's own arm, of which a reader knows.
    pub fn words(&self) -> Option<String> {
        let Self { law, own } = self;
        (law != own).then(|| format!("simulated arm: {law}; the model's own: {own}"))
    }
}

/// Law of the bridge with the shipped parameters of a cell: `emulated` or `lab`.
pub fn shipped(name: &str) -> Result<ArmLaw> {
    let path = PathBuf::from(format!("params/{name}.yaml"));
    let found = LAUNCH_CONFIGS.iter().find(|(known, _)| Path::new(known) == path);
    let (_, bytes) = found.with_context(|| format!("{} is compiled into the program", path.display()))?;
    of_file(&path, &|_| Ok(String::from_utf8_lossy(bytes).into_owned()))
}

fn of_file(path: &Path, read: &dyn Fn(&Path) -> std::io::Result<String>) -> Result<ArmLaw> {
    let arguments = ["--ros-args".to_owned(), "--params-file".to_owned(), path.display().to_string()];
    let (arguments, _) = RosArgs::parse_with(arguments, read)?;
    panda_bridge::node::law_of(&arguments)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::model_file::read_or_soft_bar;

    fn law(arm: &str) -> Result<ArmLaw> {
        let model = read_or_soft_bar(None).unwrap();
        ArmOption { arm: Some(arm.into()) }.applied_to(model).map(|model| model.arm.law)
    }

    #[test]
    fn the_arm_of_a_cell_is_the_law_of_its_bridge() {
        let ArmLaw::Impedance(emulated) = law("emulated").unwrap() else { panic!("the bridge has an impedance law") };
        assert_eq!((emulated.clip_m, emulated.stiffness_n_m, emulated.reference_time_constant_s), (0.02, 2000.0, 0.2));
        assert_eq!(emulated.max_speed_m_s, Some(0.5), "follow_speed_m_s");
        let ArmLaw::Impedance(lab) = law("lab").unwrap() else { panic!("the bridge has an impedance law") };
        assert_eq!(lab.clip_m, 0.01);
        assert_eq!(law("model").unwrap(), read_or_soft_bar(None).unwrap().arm.law);
    }

    #[test]
    fn a_work_beside_a_graph_takes_its_law_and_keeps_the_models_beside_one_that_tells_none() {
        let [own, other] = [0.16, 0.08].map(|time_constant_s| ArmLaw::Lag { time_constant_s, max_speed_m_s: 0.5 });
        let (law, source) = beside(&Told::Law(other), "lab.launch.xml", &own).unwrap().unwrap();
        assert_eq!((law, source.as_str()), (other, "as in the running graph of lab.launch.xml"));
        assert_eq!(beside(&Told::Nobody, "lab.launch.xml", &own).unwrap(), None);
        let error = beside(&Told::Several(Vec::new()), "lab.launch.xml", &own).unwrap_err().to_string();
        assert!(error.ends_with("choose the arm with --arm"), "{error}");
    }

    #[test]
    fn a_report_says_the_law_of_the_simulated_arm_in_words_if_it_is_not_the_models() {
        let [own, other] = [0.16, 0.08].map(|time_constant_s| ArmLaw::Lag { time_constant_s, max_speed_m_s: 0.5 });
        assert_eq!(SimulatedArm::new(own, own).words(), None);
        let arm = SimulatedArm::new(other, own);
        let words = arm.words().unwrap();
        assert!(
            words.starts_with("simulated arm: a lag of 0.08 s") && words.contains("own: a lag of 0.16 s"),
            "{words}"
        );
        assert_eq!(serde_json::to_string(&arm).unwrap(), other.to_text());
    }

    #[test]
    fn a_parameter_file_may_have_other_gains_or_the_law_of_the_relays_controller() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("params.yaml");
        let of = |text: &str| {
            std::fs::write(&path, format!("panda_bridge:\n  ros__parameters:\n{text}")).unwrap();
            law(path.to_str().unwrap())
        };
        let ArmLaw::Impedance(soft) = of("    transport: fci\n    fci.error_clip_m: 0.03\n").unwrap() else {
            panic!("the bridge has an impedance law")
        };
        assert_eq!(soft.clip_m, 0.03);
        let ArmLaw::Impedance(slow) = of("    transport: fci\n    follow_speed_m_s: 0.1\n").unwrap() else {
            panic!("the bridge has an impedance law")
        };
        assert_eq!(slow.max_speed_m_s, Some(0.1));
        let lag = of("    controller.arm_law: '{lag: {time_constant_s: 0.1, max_speed_m_s: 0.5}}'\n").unwrap();
        assert_eq!(lag, ArmLaw::Lag { time_constant_s: 0.1, max_speed_m_s: 0.5 });
        let error = format!("{:#}", of("    transport: fci\n    fci.error_clip_m: 3.0\n").unwrap_err());
        assert!(error.contains("params.yaml") && error.contains("fci.error_clip_m"), "{error}");
        let error = law("emulatd").unwrap_err().to_string();
        assert_eq!(
            error,
            "--arm: expected model, running, emulated, lab, or a parameter file of the bridge, got emulatd"
        );
    }
}
