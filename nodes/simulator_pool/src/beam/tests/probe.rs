use super::*;
use crate::beam::Table;
use catenary_core::model::AxialLaw;

pub fn run(index: u64, d: Discretisation, law: AxialLaw, kv: Option<f64>) -> (Beam, Vec<[[f64; 2]; 4]>) {
    let [l, e, mu, tau] = episode::draw(index);
    let path = episode::grip_path(index);
    let p = BeamParameters {
        axial_law: law,
        kelvin_voigt_time_s: kv.unwrap_or(tau),
        table: Some(Table::new(0.0, mu)),
        ..bar(l, e)
    };
    let at = |t: f64| GripState::from_pose(path.at(t), 0.0);
    let mut b = Beam::new(p, d, at(0.0)).unwrap();
    b.hang_at_rest(at(0.0));
    let mut tr = vec![];
    for k in 1..=80 {
        b.advance_to(k as f64 * 0.1, &at);
        tr.push(b.centre_line_at_deformed_fraction([0.125, 0.375, 0.625, 0.875]));
    }
    (b, tr)
}

#[test]
fn probe() {
    for (name, law, kv) in [("lin kv0", AxialLaw::Linear, Some(0.0)), ("neo kv", AxialLaw::NeoHookean, None)] {
        for f in [Fidelity::Fast, Fidelity::Standard] {
            let t = cpu();
            let mut c = [0u64; 4];
            let mut touch = 0;
            let n = 24;
            let mut worst = 0;
            for i in 0..n {
                let (b, _) = run(i, Discretisation::of(f), law, kv);
                let k = b.counters();
                worst = worst.max(k.unconverged_steps);
                c[0] += k.steps;
                c[1] += k.newton_iterations;
                c[2] += k.unconverged_steps;
                c[3] += k.line_search_halvings;
                touch += (b.table_force().normal_n > 0.0) as u32;
                assert!(b.nodes().iter().flatten().all(|v| v.is_finite()));
            }
            let dt = cpu() - t;
            println!(
                "{name} {f:?}: {:.1} ep/s  newton/step {:.3} unconv {:.2e} (worst {worst}) halv {:.3e} touching at end {touch}/{n}",
                n as f64 / dt,
                c[1] as f64 / c[0] as f64,
                c[2] as f64 / c[0] as f64,
                c[3] as f64 / c[0] as f64
            );
        }
    }
}

fn rms(a: &[[[f64; 2]; 4]], b: &[[[f64; 2]; 4]]) -> f64 {
    let mut s = 0.0;
    let mut n = 0.0;
    for (x, y) in a.iter().flatten().zip(b.iter().flatten()) {
        s += (x[0] - y[0]).powi(2) + (x[1] - y[1]).powi(2);
        n += 1.0;
    }
    1e3 * (s / n as f64).sqrt()
}

#[test]
fn accuracy() {
    for (name, law, kv) in [("neo kv", AxialLaw::NeoHookean, None), ("lin kv0", AxialLaw::Linear, Some(0.0))] {
        for i in 0..8 {
            let s = standard();
            let base = run(i, s, law, kv).1;
            let strict = run(i, Discretisation { tolerance_m: 1e-12, ..s }, law, kv).1;
            let fast = run(i, Discretisation::of(Fidelity::Fast), law, kv).1;
            let fine = run(i, Discretisation { time_step_s: 5e-4, ..s }, law, kv).1;
            let mesh = run(i, Discretisation { elements: 40, ..s }, law, kv).1;
            let reference = run(i, Discretisation::of(Fidelity::Reference), law, kv).1;
            println!(
                "{name} {:?}: strict {:.4} fast {:.3} dt/4 {:.3} mesh {:.3} ref {:.3} mm RMS",
                episode::draw(i),
                rms(&base, &strict),
                rms(&base, &fast),
                rms(&base, &fine),
                rms(&base, &mesh),
                rms(&base, &reference)
            );
        }
    }
}

#[test]
fn published() {
    for (a, g) in [(1.0, 1.0), (1e5, 1e5), (1.0, 1e5), (1e5, 1.0)] {
        for e in [1e6, 5e4] {
            let p = bar(0.2, e);
            let p = BeamParameters {
                axial_stiffness_n: a * p.axial_stiffness_n,
                shear_stiffness_n: g * p.shear_stiffness_n,
                ..p
            };
            println!("EAx{a} GAx{g} E {e} {:?}", boundary_value::clamped_tip(&p));
        }
    }
}

fn cpu() -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat").unwrap().split(' ').next().unwrap().parse::<f64>().unwrap()
        * 1e-9
}

#[test]
fn micro() {
    let p = BeamParameters {
        axial_law: AxialLaw::NeoHookean,
        kelvin_voigt_time_s: 0.02,
        table: Some(Table::new(0.0, 0.5)),
        ..bar(0.25, 1e4)
    };
    let g = GripState { z_m: 0.4, ..grip(0.0) };
    let mut b = hanging(p, standard(), g);
    b.advance_to(0.1, |t| GripState { x_m: 0.1 * t, ..g });
    let n = 200_000;
    let t = cpu();
    for _ in 0..n {
        std::hint::black_box(b.evaluate());
    }
    println!("evaluate {:.0} ns", (cpu() - t) / n as f64 * 1e9);
    let sys = b.system.clone();
    let t = cpu();
    for _ in 0..n {
        b.system.gradient.copy_from_slice(&sys.gradient);
        b.system.matrix.diagonal.copy_from_slice(&sys.matrix.diagonal);
        b.system.matrix.coupling.copy_from_slice(&sys.matrix.coupling);
        std::hint::black_box(&mut b.system);
    }
    let copy = cpu() - t;
    let t = cpu();
    for _ in 0..n {
        b.system.gradient.copy_from_slice(&sys.gradient);
        b.system.matrix.diagonal.copy_from_slice(&sys.matrix.diagonal);
        b.system.matrix.coupling.copy_from_slice(&sys.matrix.coupling);
        std::hint::black_box(&mut b.system);
        b.system.matrix.solve(&mut b.system.gradient);
    }
    println!("solve {:.0} ns", (cpu() - t - copy) / n as f64 * 1e9);
    let mut q = b.clone();
    let t = cpu();
    for _ in 0..n {
        q.finish();
        std::hint::black_box(&mut q);
    }
    println!("finish {:.0} ns", (cpu() - t) / n as f64 * 1e9);
    let mut q = b.clone();
    let t = cpu();
    for _ in 0..n / 10 {
        q.step(g);
    }
    println!(
        "step {:.0} ns, newton/step {}",
        (cpu() - t) / (n / 10) as f64 * 1e9,
        (q.counters().newton_iterations - b.counters().newton_iterations) as f64 / (n / 10) as f64
    );
}

#[test]
fn wide() {
    use rand::RngExt;
    let n: u64 = 600;
    for f in [Fidelity::Fast, Fidelity::Standard] {
        let (mut steps, mut bad, mut worst, mut statics, mut far) = (0, 0, 0, 0, 0);
        for i in 0..n {
            let mut rng = catenary_core::seed::rng(77, i);
            let [l, e, mu, tau] = episode::draw(i);
            let mut on = |v: f64| if rng.random_range(0.0..1.0) < 0.3 { v } else { 0.0 };
            let mut p = bar(l, e);
            p.kelvin_voigt_time_s = on(tau * 2.0);
            p.linear_drag_n_s_m2 = on(0.5);
            p.quadratic_drag_n_s2_m3 = on(1.0);
            p.rest_curvature_per_m = on(10.0) - on(10.0);
            p.tip_mass_kg = on(0.02);
            p.overhang_m = on(0.03) + on(0.0007);
            p.gravity_m_s2[0] = on(1.0);
            p.axial_law = if i % 2 == 0 { AxialLaw::NeoHookean } else { AxialLaw::Linear };
            let mut t = Table::new(on(0.1), mu + on(0.6));
            t.damping_time_s = on(0.01);
            p.table = Some(t);
            let path = episode::grip_path(i + 1000);
            let at = |t: f64| GripState::from_pose(path.at(t), 0.0);
            let mut b = Beam::new(p, Discretisation::of(f), at(0.0)).unwrap();
            let q = b.hang_at_rest(at(0.0));
            if !q.converged {
                statics += 1;
                println!("{i} {q:?} {p:?}");
            }
            b.advance_to(8.0, at);
            assert!(b.nodes().iter().flatten().all(|v| v.is_finite()), "{i}");
            if !b.nodes().iter().all(|v| v[0].abs() < 3.0 && v[1].abs() < 3.0) {
                far += 1;
                println!("far {i} {p:?} {:?}", b.tip());
            }
            let c = b.counters();
            steps += c.steps;
            bad += c.unconverged_steps;
            if c.unconverged_steps > worst {
                worst = c.unconverged_steps;
                println!("worst {i} {worst} l {l} {p:?}");
            }
        }
        println!(
            "{f:?} steps {steps} bad {bad} = {:.1e} worst {worst} statics not converged {statics} far {far}",
            bad as f64 / steps as f64
        );
    }
}

#[test]
fn cable() {
    for (file, tip) in
        [("swing_bare", 0.03), ("swing_tip_mass", 0.23), ("moving_grip_bare", 0.03), ("moving_grip_tip_mass", 0.23)]
    {
        let text = std::fs::read_to_string(format!("/work/shared/data/measured_cable/{file}.csv")).unwrap();
        let head: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let col = |n: &str| head.iter().position(|h| h.starts_with(n)).unwrap_or_else(|| panic!("{n} {head:?}"));
        let rows: Vec<Vec<f64>> =
            text.lines().skip(1).map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
        let (tc, gx, gz, gp) = (0, col("grip_x"), col("grip_z"), col("grip_pitch"));
        let t0 = rows[0][tc];
        let path = catenary_core::GripTrajectory::new(
            rows.iter().map(|r| r[tc] - t0).collect(),
            rows.iter().map(|r| catenary_core::GripPose { x_m: r[gx], z_m: r[gz], pitch_rad: r[gp] }).collect(),
        )
        .unwrap();
        let at = |t: f64| GripState::from_pose(path.at(t), DOWN);
        let pt = |r: &Vec<f64>, i: usize| {
            let c = col("p1_x");
            [r[c + 2 * i], r[c + 2 * i + 1]]
        };
        let dt = rows[1][tc] - rows[0][tc];
        let fr = [0.25, 0.5, 0.75, 1.0];
        let pts: Vec<_> = (0..4)
            .map(|i| crate::beam::MeasuredPoint {
                fraction: fr[i],
                position_m: pt(&rows[0], i),
                velocity_m_s: [0, 1].map(|a| (pt(&rows[2], i)[a] - pt(&rows[0], i)[a]) / (2.0 * dt)),
            })
            .collect();
        let mut best = (1e9, 0.0, 0.0, 0.0);
        let mut n = 0;
        let t = cpu();
        for ei in [0.05, 0.065, 0.08, 0.1, 0.12, 0.14, 0.17] {
            for kv in [0.05, 0.1, 0.15, 0.2, 0.3] {
                for k0 in [-3.0, -2.0, -1.5, -1.0, -0.5] {
                    let p = BeamParameters {
                        kelvin_voigt_time_s: kv,
                        tip_mass_kg: tip,
                        rest_curvature_per_m: k0,
                        ..BeamParameters::from_bending_stiffness(
                            0.4,
                            Section::Round { diameter_m: 0.02 },
                            3342.25,
                            ei,
                            4e3,
                            0.45,
                        )
                    };
                    let mut b = Beam::new(p, standard(), at(0.0)).unwrap();
                    let (g0, g1) = (at(0.0), at(2.0 * dt));
                    let q = b.set_shape(
                        g0,
                        [
                            (g1.x_m - g0.x_m) / (2.0 * dt),
                            (g1.z_m - g0.z_m) / (2.0 * dt),
                            (g1.tangent_rad - g0.tangent_rad) / (2.0 * dt),
                        ],
                        &pts,
                    );
                    assert!(q.converged, "{q:?}");
                    let mut s = 0.0;
                    for r in &rows {
                        b.advance_to(r[tc] - t0, at);
                        let c = b.centre_line_at_deformed_fraction(fr);
                        for i in 0..4 {
                            let m = pt(r, i);
                            s += (c[i][0] - m[0]).powi(2) + (c[i][1] - m[1]).powi(2);
                        }
                    }
                    let rms = (s / rows.len() as f64 / 4.0).sqrt();
                    n += 1;
                    if rms < best.0 {
                        best = (rms, ei, kv, k0);
                    }
                }
            }
        }
        println!(
            "{file}: best rms {:.2} mm at EI {} kv {} k0 {}; {:.1} ms each, {:.1} s long",
            1e3 * best.0,
            best.1,
            best.2,
            best.3,
            1e3 * (cpu() - t) / n as f64,
            rows.len() as f64 * dt
        );
    }
}
