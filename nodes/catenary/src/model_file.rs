//! Reading model files.

use anyhow::Result;
use catenary_core::Model;
use simulator_pool::model_text;
use std::path::Path;

/// The soft bar, carried inside the program.
pub const SOFT_BAR: &str = include_str!("../../../launch_configs/models/soft_bar.yaml");

/// The model in the file at `path`, its physical parameters checked too.
pub fn read(path: &Path) -> Result<Model> {
    catenary_shell::read_model("model", path, model_text::read)
}

/// The model in the file at `path`, or the soft bar.
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
    fn the_four_bars_are_the_soft_bar_with_values_of_their_own() {
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
        // Shore A-40, 00-20, 00-50, 00-20.
        assert!(e[0] > e[2] && e[2] > e[1] && e[1] == e[3], "{e:?}");
        let mass_kg = bar.parameters["density_kg_m3"] * 0.015 * 0.015 * 0.2;
        assert!((mass_kg - 0.04747).abs() < 1e-5, "{mass_kg}");
    }
}
