//! Option for the law of the arm that policies are trained for.

use crate::exit::{Given, WrongInput};
use crate::graph::arm_law;
use crate::inputs::shipped::LAUNCH_CONFIGS;
use crate::terminal::output;
use anyhow::{Context, Result};
use catenary_core::Model;
use catenary_core::model::ArmLaw;
use catenary_shell::RosArgs;
use clap::Args;
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
    /// The model with the law of the arm that was asked for. The law is told if it is not the model's own.
    ///
    /// # Errors
    /// A parameter file that cannot be read, no running arm.
    pub fn applied_to(&self, mut model: Model) -> Result<Model> {
        let Some((law, source)) = self.law().given()? else { return Ok(model) };
        if law != model.arm.law {
            output::tell(&format!("arm: {law}, {source}; --arm model keeps {}", model.arm.law));
            model.arm.law = law;
        }
        Ok(model)
    }

    /// Law and its source in words; `None`: the model's.
    fn law(&self) -> Result<Option<(ArmLaw, String)>> {
        let Some(arm) = &self.arm else {
            return Ok(arm_law::of_launch()?.map(|(law, file)| (law, format!("as in the running graph of {file}"))));
        };
        if !arm.is_file() {
            match arm.to_str() {
                Some("model") => return Ok(None),
                Some("running") => {
                    let law = arm_law::of_domain()?.context(
                        "--arm running: no arm of this ROS domain tells its law: start its graph, or name its parameter file",
                    )?;
                    return Ok(Some((law, "as in the running graph".to_owned())));
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
        let ArmLaw::Impedance(lab) = law("lab").unwrap() else { panic!("the bridge has an impedance law") };
        assert_eq!(lab.clip_m, 0.01);
        assert_eq!(law("model").unwrap(), read_or_soft_bar(None).unwrap().arm.law);
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
