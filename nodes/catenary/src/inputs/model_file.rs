//! Models, read from a file or by the name of a shipped one.

use super::shipped::Kind;
use crate::exit::Given;
use crate::report::quantity::learn_stated;
use anyhow::{Context, Result};
use catenary_core::Model;
use catenary_simulator::model_text;
use std::path::Path;

/// Text of the shipped soft bar.
pub const SOFT_BAR: &str = include_str!("../../../../launch_configs/models/soft_bar.yaml");

/// Model that `--model` names. Its physical parameters are checked too.
pub fn read(path: &Path) -> Result<Model> {
    read_with_text(path).map(|(model, _)| model)
}

/// Model that `--model` names, with its text: the file at `path`, else the shipped model of this name.
pub fn read_with_text(path: &Path) -> Result<(Model, String)> {
    let read = || {
        let text = Kind::Model.text(path)?;
        let model = model_text::read(&text).with_context(|| format!("model {}", path.display()))?;
        learn_stated(&model);
        Ok::<_, anyhow::Error>((model, text))
    };
    read().given()
}

/// Error text for a model without a task, in a command that trains or runs policies.
pub fn no_task(path: &Path) -> String {
    format!("model {}: it has no task: no policy runs on it", path.display())
}

/// Model that `--model` names, or the soft bar.
pub fn read_or_soft_bar(path: Option<&Path>) -> Result<Model> {
    path.map_or_else(|| Ok(model_text::read(SOFT_BAR)?), read)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch_configs/models")
    }

    #[test]
    fn every_shipped_model_reads_and_is_written_back_as_it_is() {
        let mut models = 0;
        for entry in std::fs::read_dir(folder()).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "yaml") {
                let model = read(&path).unwrap();
                assert_eq!(path.file_stem().unwrap().to_str(), Some(model.name.as_str()));
                let text = std::fs::read_to_string(&path).unwrap();
                assert_eq!(model.rewrite(&text).unwrap(), text);
                models += 1;
            }
        }
        assert!(models >= 6, "{models}");
    }

    #[test]
    fn a_shipped_model_is_read_by_its_name_and_an_unknown_one_lists_them() {
        assert_eq!(read(Path::new("soft_bar")).unwrap().name, "soft_bar");
        let error = read(Path::new("softbar")).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("model softbar: No such file") && text.contains("dlo_0, dlo_1"), "{text}");
        assert!(text.ends_with("did you mean `soft_bar`?"), "{text}");
        assert!(crate::exit::WrongInput::is(&error));
        let elsewhere = read(Path::new("/nowhere/softbar")).unwrap_err().to_string();
        assert!(!elsewhere.contains("shipped"), "{elsewhere}");
    }

    #[test]
    fn the_four_bars_differ_from_the_soft_bar_in_nominal_values_alone() {
        let bar = read(&folder().join("soft_bar.yaml")).unwrap();
        let bars: Vec<Model> = (0..4).map(|i| read(&folder().join(format!("dlo_{i}.yaml"))).unwrap()).collect();
        for model in &bars {
            let same = Model { name: bar.name.clone(), nominal: bar.nominal.clone(), ..model.clone() };
            assert_eq!(same, bar, "{}", model.name);
            assert_eq!(model.nominal.len(), 2, "{}", model.name);
        }
        let of = |name: &str| -> Vec<f64> { bars.iter().map(|m| m.nominal[name]).collect() };
        assert_eq!(of("length_m"), [0.2, 0.2, 0.27, 0.29]);
        let e = of("youngs_modulus_pa");
        // Shore hardness A-40, 00-20, 00-50 and 00-20.
        assert!(e[0] > e[2] && e[2] > e[1] && e[1] == e[3], "{e:?}");
        // A square section of 15 mm, 0.2 m long.
        let mass_kg = bar.parameters["density_kg_m3"] * 0.015 * 0.015 * 0.2;
        // The mass of the bar of the paper.
        assert!((mass_kg - 0.04747).abs() < 1e-5, "{mass_kg}");
    }
}
