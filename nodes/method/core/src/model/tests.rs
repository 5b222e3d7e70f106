use super::*;
use crate::Goal;
use crate::camera::{Pinhole, Plane};
use crate::task::Workspace;
use proptest::prelude::*;

const SOFT_BAR: &str = include_str!("../../../../../launch_configs/models/soft_bar.yaml");
const CABLE: &str = include_str!("../../../../../launch_configs/models/measured_cable.yaml");

/// Text that identifies every bit: `{:?}` prints the shortest decimal that reads back as the same number.
fn bits(model: &Model) -> String {
    format!("{model:?}")
}

#[test]
fn shipped_models_are_valid_and_round_trip() {
    for text in [SOFT_BAR, CABLE] {
        let model = Model::from_yaml(text).unwrap();
        assert_eq!(bits(&Model::from_yaml(&model.to_yaml().unwrap()).unwrap()), bits(&model));
        assert_eq!(model.rewrite(text).unwrap(), text);
    }
}

/// Error message about the soft bar's file after `old` is replaced by `new`.
fn message(old: &str, new: &str) -> String {
    assert_eq!(SOFT_BAR.matches(old).count(), 1, "{old}");
    let error = Model::from_yaml(&SOFT_BAR.replace(old, new)).unwrap_err().to_string();
    // Errors of a command take one line.
    assert!(!error.contains('\n'), "{error}");
    error
}

const LENGTH: &str = "{name: length_m, prior: {uniform: {low: 0.195, high: 0.305}}}";

#[test]
fn a_newer_a_missing_and_a_strange_version_say_what_this_program_reads() {
    let newer = message("version: 1", "version: 2\nnew_section: {}");
    assert_eq!(
        newer,
        "line 2, `version`: expected 1, the version that this program reads, got 2: a newer catenary wrote it"
    );
    let missing = message("version: 1\n", "");
    assert!(missing.contains("`version`: expected 1, the version that this program reads, got none"), "{missing}");
    assert!(missing.contains("begin the file with `version: 1`"), "{missing}");
    assert!(message("version: 1", "version: soon").ends_with("got soon"));
}

#[test]
fn an_unknown_field_is_named_with_the_known_fields() {
    let e = message("axial_law:", "axial_lew:");
    assert_eq!(
        e,
        "line 6, `object.axial_lew`: unknown field `axial_lew`, expected one of section, axial_law, keypoint_fractions, hidden_length_m, grip_angle_rad; did you mean `axial_law`?"
    );
}

#[test]
fn a_wrong_word_is_named_with_the_valid_words() {
    let e = message("axial_law: neo_hookean", "axial_law: neohookean");
    assert_eq!(e, "line 6, `object.axial_law`: unknown variant `neohookean`, expected one of linear, neo_hookean");
    let e = message("{low: 0.3, high: 0.6}}}", "{low: 0.3, high: 0.6}}}".replace("low: 0.3", "lowest: 0.3").as_str());
    assert!(e.starts_with("line 21, `effects.table_friction.distribution.uniform.lowest`: unknown field"), "{e}");
}

#[test]
fn theta_without_a_prior_is_named() {
    assert_eq!(message(LENGTH, "{name: length_m}"), "line 16, `theta.length_m`: missing field `prior`");
    let gauss = LENGTH.replace("uniform", "gauss");
    let e = message(LENGTH, &gauss);
    assert_eq!(
        e,
        "line 16, `theta.length_m.prior.gauss`: unknown variant `gauss`, expected one of uniform, log_uniform, normal, mixture"
    );
    let none = SOFT_BAR.find("theta:").unwrap()..SOFT_BAR.find("effects:").unwrap();
    let mut text = SOFT_BAR.to_owned();
    text.replace_range(none, "theta: []\n");
    let e = Model::from_yaml(&text).unwrap_err().to_string();
    assert_eq!(e, "line 14, `theta`: expected at least one parameter with a prior, got none");
}

#[test]
fn swapped_bounds_are_named() {
    let e = message("low: 0.195, high: 0.305", "low: 0.305, high: 0.195");
    assert_eq!(e, "line 16, `theta.length_m.prior`: expected finite low < high, got low 0.305, high 0.195");
    let e = message("low: 1.0e+3", "low: 0.0");
    assert_eq!(e, "line 17, `theta.youngs_modulus_pa.prior`: log_uniform needs low > 0, got 0");
    let e = message("low: 0.3, high: 0.6", "low: 0.6, high: 0.6");
    assert!(e.starts_with("line 21, `effects.table_friction.distribution`: expected finite low < high"), "{e}");
    let e =
        message("  steps: 16\n", "  steps: 16\n  workspace: {x_m: [0.6, 0.3], y_m: [-0.1, 0.1], z_m: [0.1, 0.5]}\n");
    assert_eq!(e, "line 44, `task.workspace.x_m`: expected [low, high] with low < high, got [0.6, 0.3]");
}

#[test]
fn a_value_that_is_no_finite_number_is_named() {
    let e = message("density_kg_m3: 1055.0", "density_kg_m3: .nan");
    assert_eq!(e, "line 11, `parameters.density_kg_m3`: expected a finite number, got NaN");
    let e = message("density_kg_m3: 1055.0", "density_kg_m3: heavy");
    assert_eq!(e, "line 11, `parameters.density_kg_m3`: expected a number, got `heavy`");
    let e = message("density_kg_m3: 1055.0", "density_kg_m3: 1055,0");
    assert_eq!(e, "line 11, `parameters.density_kg_m3`: expected a number, got `1055,0`");
    let e = message("side_m: 0.015", "side_m: -.inf");
    assert_eq!(e, "line 5, `object.section.square.side_m`: expected 0.00001 to 0.1 m, got -inf");
    let e = message("low: 0.195", "low: .nan");
    assert_eq!(e, "line 16, `theta.length_m.prior`: expected finite low < high, got low NaN, high 0.305");
    let e = message("[0.44, 0.0, 0.27]", "[0.44, .inf, 0.27]");
    assert_eq!(e, "line 34, `camera.view.pinhole.look_at_m`: expected -20 to 20 m, got inf");
    let e = message("steps: 16", "steps: 16.5");
    assert_eq!(e, "line 43, `task.steps`: expected a whole number of at least 0, got `16.5`");
    let e = message("position_jitter_m: 0.005\narm:", "position_jitter_m: 0.005\narm: 3\nleft_over:");
    assert_eq!(e, "line 38, `arm`: expected fields of its own, got `3`");
}

#[test]
fn a_value_in_another_unit_is_named_with_its_limits() {
    for (from, to, expected) in [
        ("side_m: 0.015", "side_m: 15", "line 5, `object.section.square.side_m`: expected 0.00001 to 0.1 m, got 15"),
        ("hidden_length_m: 0.008", "hidden_length_m: 8", "`object.hidden_length_m`: expected 0 to 0.1 m, got 8"),
        (
            "grip_angle_rad: 0.0",
            "grip_angle_rad: -90",
            "`object.grip_angle_rad`: expected -6.28319 to 6.28319 rad, got -90",
        ),
        ("x_m: 0.40", "x_m: 400", "`arm.start.x_m`: expected -10 to 10 m, got 400"),
        ("pitch_rad: 0.0", "pitch_rad: 45", "`arm.start.pitch_rad`: expected -6.28319 to 6.28319 rad, got 45"),
        (
            "frame_period_s: 0.25",
            "frame_period_s: 250",
            "`observation.frame_period_s`: expected 0.0001 to 5 s, got 250",
        ),
        ("step_period_s: 0.5", "step_period_s: 500", "`task.step_period_s`: expected 0.001 to 10 s, got 500"),
        ("target_m: [0.50", "target_m: [500", "`task.target_m`: expected -10 to 10 m, got 500"),
        ("focal_px: 615.0", "focal_px: 1.93", "`camera.view.pinhole.focal_px`: expected 128 to 12800 px, got 1.93"),
        ("time_constant_s: 0.16", "time_constant_s: 160", "`arm.law.lag.time_constant_s`: expected 0 to 5 s, got 160"),
        ("target_jitter_m: 0.02", "target_jitter_m: 20", "`task.target_jitter_m`: expected 0 to 0.5 m, got 20"),
        ("[0.44, -1.15", "[440, -1150", "`camera.view.pinhole.position_m`: expected -20 to 20 m, got 440"),
    ] {
        let e = message(from, to);
        assert!(e.ends_with(expected), "{e}");
    }
}

#[test]
fn a_file_of_another_kind_is_quoted_at_its_beginning_only() {
    let e = Model::from_yaml(&"dx_m,dz_m\n0.06,0.0\n".repeat(1000)).unwrap_err().to_string();
    assert!(
        e.starts_with("line 1: expected fields of its own, got `dx_m,dz_m 0.06,0.0 dx_m") && e.ends_with(" ...`"),
        "{e}"
    );
    assert!(e.len() < 120, "{e}");
}

#[test]
fn duplicate_names_are_named() {
    let e = message("name: table_friction", "name: length_m");
    assert_eq!(
        e,
        "line 21, `effects.1`: expected each name once among parameters, theta and effects, got `length_m` once more"
    );
    let e = message("name: youngs_modulus_pa", "name: length_m");
    assert!(e.starts_with("line 17, `theta.1`: ") && e.ends_with("`length_m` once more"), "{e}");
    let e = message("poisson_ratio: 0.45", "density_kg_m3: 0.45");
    assert_eq!(e, "line 12, `parameters.density_kg_m3`: duplicate mapping key: density_kg_m3 not allowed here");
}

#[test]
fn a_tab_is_named() {
    let e = message("  density_kg_m3: 1055.0", "\tdensity_kg_m3: 1055.0");
    assert_eq!(e, "line 11: expected spaces before the field, got a tab");
    let e = message("  poisson_ratio: 0.45", " \tpoisson_ratio: 0.45");
    assert!(e.starts_with("line 12") && e.ends_with("got a tab"), "{e}");
}

#[test]
fn missing_fields_and_open_brackets_are_named() {
    let e = message("  rate_hz: 60.0\n", "");
    assert!(e.ends_with("`camera`: missing field `rate_hz`"), "{e}");
    let e = message("{low: 0.3, high: 0.6}", "{low: 0.3, high: 0.6");
    assert!(e.starts_with("line 21: ") && e.contains("bracket"), "{e}");
}

#[test]
fn nominal_values_belong_to_parameters_that_vary_and_lie_in_their_priors() {
    let nominal = |text: &str| Model::from_yaml(&SOFT_BAR.replace("theta:\n", &format!("nominal: {text}\ntheta:\n")));
    let model = nominal("{youngs_modulus_pa: 2.0e+4, table_friction: 0.4}").unwrap();
    assert_eq!(model.nominal_theta(), [0.25, 2e4]);
    let e = nominal("{density_kg_m3: 1000.0}").unwrap_err().to_string();
    assert!(
        e.contains("line 14, `nominal.density_kg_m3`: expected the name of a parameter in theta or effects"),
        "{e}"
    );
    let e = nominal("{youngs_modulus_pa: 2.0e+6}").unwrap_err().to_string();
    assert_eq!(e, "line 14, `nominal.youngs_modulus_pa`: expected 1000 to 50000, where its prior lies, got 2000000");
}

#[test]
fn writing_back_keeps_comments_order_and_spelling() {
    let mut model = Model::from_yaml(SOFT_BAR).unwrap();
    model.name = "soft bar: # 2".into();
    model.parameters.insert("density_kg_m3".into(), 1.0 / 3.0);
    model.parameters.insert("tip_mass_kg".into(), 0.01);
    model.parameters.remove("table_height_m");
    model.theta = ParameterSpace::new(vec![
        Parameter { name: "length_m".into(), prior: Prior::LogUniform { low: 0.2, high: 0.25 } },
        Parameter { name: "youngs_modulus_pa".into(), prior: Prior::LogUniform { low: 1e3, high: 4e4 } },
    ])
    .unwrap();
    model.effects[1].name = "linear_drag_n_s_m2".into();
    model.object.axial_law = AxialLaw::Linear;
    model.observation.start_velocity_sd_m_s = 0.01;
    model.nominal.insert("length_m".into(), 0.21);
    let text = model.rewrite(SOFT_BAR).unwrap();
    assert_eq!(bits(&Model::from_yaml(&text).unwrap()), bits(&model));
    let expected = SOFT_BAR
        .replace("name: soft_bar", "name: \"soft bar: # 2\"")
        .replace("density_kg_m3: 1055.0 ", "density_kg_m3: 0.3333333333333333 ")
        .replace("  table_height_m: 0.0\n", "  tip_mass_kg: 0.01\n")
        .replace("{uniform: {low: 0.195, high: 0.305}}", "{log_uniform: {low: 0.2, high: 0.25}}")
        .replace("high: 5.0e+4", "high: 40000.0")
        .replace("name: table_friction", "name: linear_drag_n_s_m2")
        .replace("axial_law: neo_hookean", "axial_law: linear")
        .replace("frame_period_s: 0.25\n", "frame_period_s: 0.25\n  start_velocity_sd_m_s: 0.01\n");
    assert_eq!(text, expected + "nominal: {length_m: 0.21}\n");
}

#[test]
fn effects_are_added_and_taken_out_by_lines() {
    let mut model = Model::from_yaml(CABLE).unwrap();
    let drag = model.effects.remove(1);
    let text = model.rewrite(CABLE).unwrap();
    assert_eq!(
        text,
        CABLE.lines().filter(|l| !l.contains("linear_drag")).map(|l| format!("{l}\n")).collect::<String>()
    );
    model.effects.clear();
    assert_eq!(Model::from_yaml(&model.rewrite(CABLE).unwrap()).unwrap(), model);
    model.effects = vec![drag.clone(), Effect { name: "tip_mass_two_kg".into(), ..drag }];
    let text = model.rewrite(CABLE).unwrap();
    assert!(
        text.contains("\n  - {name: tip_mass_two_kg, distribution: {log_uniform: {low: 0.001, high: 0.3}}}\n"),
        "{text}"
    );
    assert!(text.contains("# The tilt of the cable in the clamp"), "{text}");
    assert_eq!(Model::from_yaml(&text).unwrap(), model);
}

#[test]
fn a_text_with_anchors_is_written_anew() {
    let mut model = Model::from_yaml(SOFT_BAR).unwrap();
    let text = SOFT_BAR
        .replace("time_constant_s: 0.16", "time_constant_s: &t 0.16")
        .replace("frame_period_s: 0.25", "frame_period_s: *t");
    assert!(Model::from_yaml(&text).is_err(), "the anchor stands after its use");
    let text = SOFT_BAR
        .replace("keypoint_noise_px: 0.7", "keypoint_noise_px: &t 0.7")
        .replace("time_constant_s: 0.16", "time_constant_s: *t");
    model.arm.law = ArmLaw::Lag { time_constant_s: 0.7, max_speed_m_s: 0.4 };
    let written = model.rewrite(&text).unwrap();
    assert_eq!(Model::from_yaml(&written).unwrap(), model);
    assert!(!written.contains('#'));
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![any::<f64>().prop_filter("finite", |v| v.is_finite()), -1e3..1e3f64, Just(0.0), Just(-0.0)]
}

fn positive() -> impl Strategy<Value = f64> {
    number().prop_map(f64::abs).prop_filter("positive", |v| *v > 0.0)
}

fn prior() -> impl Strategy<Value = Prior> {
    (number(), number(), any::<bool>()).prop_filter_map("low < high", |(a, b, log)| {
        let (low, high) = (a.min(b), a.max(b));
        let prior = if log { Prior::LogUniform { low, high } } else { Prior::Uniform { low, high } };
        prior.check().ok().map(|()| prior)
    })
}

prop_compose! {
    fn models()(
        name in ".{0,30}",
        names in prop::collection::btree_set("[a-z][a-z0-9_]{0,12}|.{1,8}", 6),
        priors in prop::collection::vec(prior(), 4),
        split in 1usize..4,
        fixed in prop::collection::vec(number(), 2),
        nominal in prop::option::of(0.0..=1.0f64),
        round in any::<bool>(),
        lengths in prop::collection::vec(positive(), 12),
        angles in prop::collection::vec(number(), 6),
        frames in 2usize..10_000,
        task in prop::option::of((1usize..100, any::<bool>())),
        fractions in prop::collection::btree_set(0u32..=1_000_000, 4),
    ) -> Model {
        let names: Vec<String> = names.into_iter().collect();
        let f: Vec<f64> = fractions.into_iter().map(|v| f64::from(v) / 1e6).collect();
        let effect = |i: usize| Effect { name: names[i].clone(), distribution: priors[i].clone() };
        let theta = (0..split).map(|i| Parameter { name: names[i].clone(), prior: priors[i].clone() }).collect();
        let (low, high) = priors[0].bounds();
        Model {
            version: MODEL_VERSION,
            name,
            object: Object {
                section: if round { Section::Round { diameter_m: lengths[0].clamp(1e-5, 0.1) } } else { Section::Square { side_m: lengths[0].clamp(1e-5, 0.1) } },
                axial_law: if round { AxialLaw::Linear } else { AxialLaw::NeoHookean },
                keypoint_fractions: [f[0], f[1], f[2], f[3]],
                hidden_length_m: lengths[1].min(0.1),
                grip_angle_rad: angles[0].clamp(-6.0, 6.0),
            },
            parameters: names[4..].iter().cloned().zip(fixed).collect(),
            theta: ParameterSpace::new(theta).unwrap(),
            nominal: nominal.map(|u| (names[0].clone(), if u < 0.5 { low } else { high })).into_iter().collect(),
            effects: (split..4).map(effect).collect(),
            observation: ObservationModel {
                grip_position_sd_m: 1e-3,
                grip_pitch_sd_rad: 1e-4,
                drive: if round { DriveKind::Grip } else { DriveKind::Policy },
                start: if round { StartKind::Measured } else { StartKind::HangingAtRest },
                frames,
                frame_period_s: lengths[2].clamp(1e-4, 5.0),
                start_velocity_sd_m_s: lengths[3].min(5.0),
                keypoints: !round || frames % 2 == 0,
                wrench: round.then(|| WrenchNoise { force_sd_n: [0.5, lengths[3].clamp(1e-4, 1e3)], torque_sd_n_m: 0.1 }),
            },
            camera: CameraModel {
                view: if round {
                    Camera::Plane(Plane { centre_m: [angles[1], angles[2]].map(|v| v.clamp(-20.0, 20.0)), side_m: lengths[4].clamp(0.01, 20.0), ..Plane::default() })
                } else {
                    Camera::Pinhole(Pinhole {
                        image_width_px: 640,
                        image_height_px: 480,
                        focal_px: lengths[4].clamp(128.0, 12_800.0),
                        position_m: [0.1, -1.0, lengths[5].min(1.0)],
                        look_at_m: [0.3, 1.0 / 3.0, 0.27],
                        ..Pinhole::default()
                    })
                },
                rate_hz: lengths[6].clamp(0.1, 1e4),
                keypoint_noise_px: lengths[7].min(100.0),
                position_jitter_m: lengths[8].min(0.5),
            },
            arm: Arm {
                law: ArmLaw::Lag { time_constant_s: lengths[9].min(5.0), max_speed_m_s: lengths[10].clamp(1e-3, 5.0) },
                start: GripPose { x_m: angles[3].clamp(-10.0, 10.0), z_m: angles[4].clamp(-10.0, 10.0), pitch_rad: angles[5].clamp(-6.0, 6.0) },
                pose_noise_m: lengths[3].min(0.1),
            },
            task: task.map(|(steps, measured)| Task {
                goal: if measured { Goal::Settle { reward_range_m: lengths[6].clamp(1e-3, 10.0) } } else { Goal::Reach },
                steps,
                rest_steps: if measured { 2 } else { 0 },
                step_period_s: lengths[11].clamp(1e-3, 10.0),
                delta_anchor: if measured { DeltaAnchor::Measured } else { DeltaAnchor::LastTarget },
                workspace: Workspace::default(),
                target_m: [angles[0], angles[1]].map(|v| v.clamp(-10.0, 10.0)),
                target_jitter_m: lengths[0].min(0.5),
                success_reward: if measured { lengths[5] } else { angles[2] }.min(1.0),
                ends_at_success: !measured,
            }),
            lacking: match nominal {
                Some(u) => Lacking { vetoes: vec![names[5].clone()], prior_odds: [(names[4].clone(), 0.1 + u)].into() },
                None => Lacking::default(),
            },
            expressions: if round { vec![expression(&priors[1])] } else { Vec::new() },
        }
    }
}

/// Effect that a model file states, with this prior.
fn expression(prior: &Prior) -> Expression {
    let companion = ExpressionCompanion { name: "pace_hz".into(), unit: "Hz".into(), prior: prior.clone() };
    Expression {
        name: "flutter_n_m".into(),
        title: Some("flutter: \"wind\"".into()),
        unit: "N/m".into(),
        force_x_n_m: Some("s * sin(pace_hz * t)".into()),
        force_z_n_m: None,
        couple_n_m_m: None,
        moment_n_m: Some("-1e-3 * curvature # ^ 3".into()),
        prior: prior.clone(),
        companions: vec![companion],
    }
}

#[test]
fn stated_effects_are_checked_as_far_as_their_texts_need_not_be_read() {
    let of = |fields: &str| {
        let text = format!(
            "{SOFT_BAR}\nexpressions:\n  - {{name: flutter_n_m, prior: {{uniform: {{low: 0.0, high: 1.0}}}}{fields}}}\n"
        );
        Model::from_yaml(&text).map(|model| model.expressions.len()).map_err(|e| e.to_string())
    };
    assert_eq!(of(", force_x_n_m: \"s\""), Ok(1));
    let e = of("").unwrap_err();
    assert!(
        e.ends_with("expected an expression: force_x_n_m, force_z_n_m, couple_n_m_m or moment_n_m, got none"),
        "{e}"
    );
    let e = of(", force_x_n_m: s, companions: [{name: a b, prior: {uniform: {low: 0.0, high: 1.0}}}]").unwrap_err();
    assert!(e.ends_with("expected a name of letters, digits and underscores, got `a b`"), "{e}");
    let e =
        of(", force_x_n_m: s, companions: [{name: flutter_n_m, prior: {uniform: {low: 0.0, high: 1.0}}}]").unwrap_err();
    assert!(e.ends_with("expected each name once among expressions, got `flutter_n_m` once more"), "{e}");
    let e = of(", force_x_n_m: s, companions: [{name: pace, prior: {uniform: {low: 1.0, high: 0.0}}}]").unwrap_err();
    assert!(e.contains("`expressions.flutter_n_m.companions.pace.prior`"), "{e}");
    let e = of(", force_y_n_m: s").unwrap_err();
    assert!(e.contains("force_y_n_m"), "{e}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn models_round_trip_to_the_bit(model in models()) {
        let read = Model::from_yaml(&model.to_yaml().unwrap()).unwrap();
        prop_assert_eq!(bits(&read), bits(&model));
    }

    #[test]
    fn any_model_can_be_written_over_any_other(model in models(), other in models(), bar in any::<bool>()) {
        let text = if bar { SOFT_BAR.to_owned() } else { other.to_yaml().unwrap() };
        let written = model.rewrite(&text).unwrap();
        prop_assert_eq!(bits(&Model::from_yaml(&written).unwrap()), bits(&model));
        prop_assert!(!bar || written.contains("# A soft silicone bar"), "{}", written);
    }
}
