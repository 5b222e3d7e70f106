//! Motion without contact compared with theory. It reveals a wrong inertia, a lossy time step or a force without
//! reaction.

use super::comparison::Comparison;
use super::error::VerificationError;
use super::specimen::{DOWN_RAD, GRAVITY_M_S2, at_rest, bar, grip};
use super::vibration::{self, Mode};
use crate::beam::{Beam, BeamParameters, Discretisation, GripState};
use std::f64::consts::PI;

/// Amplitude of a small vibration, as a share of the length.
const SMALL: f64 = 1e-3;
/// Passages through zero over which a frequency is measured: two periods.
const PASSAGES: usize = 5;

/// First three bending frequencies of the weightless cantilever, compared with Timoshenko's beam with rotary inertia.
pub(super) fn bending_frequencies(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    // The shortest and stiffest bar of the prior, whose vibrations are the fastest.
    let p = BeamParameters { gravity_m_s2: [0.0; 2], ..bar(0.195, 5e4) };
    let modes = vibration::modes::<3>(&p, 0.0).ok_or(VerificationError::NoFrequency)?;
    let mut rows = Vec::new();
    for (mode, name) in modes.iter().zip(["first", "second", "third"]) {
        let beam = Beam::new(p, *d, grip(0.0))?;
        let frequency_rad_s = frequency(beam, mode)?;
        rows.push(Comparison::new(format!("{name} mode, 5e4 Pa"), "rad/s", frequency_rad_s, mode.frequency_rad_s));
    }
    Ok(rows)
}

/// First swing of a hanging bar, compared with the first mode of the heavy, extensible, shearable beam.
pub(super) fn swing_period(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let mut rows = Vec::new();
    for youngs_modulus_pa in [1e3, 1e4, 5e4] {
        let p = bar(0.25, youngs_modulus_pa);
        let [mode] = vibration::modes::<1>(&p, GRAVITY_M_S2).ok_or(VerificationError::NoFrequency)?;
        let frequency_rad_s = frequency(at_rest(p, d, grip(DOWN_RAD))?, &mode)?;
        let period_s = 2.0 * PI / frequency_rad_s;
        rows.push(Comparison::new(format!("{youngs_modulus_pa:e} Pa"), "s", period_s, 2.0 * PI / mode.frequency_rad_s));
    }
    Ok(rows)
}

/// Measures the angular frequency in rad/s of a straight beam that was bent into a mode's shape, from the zero
/// crossings of the motion's projection on the mode.
pub(super) fn frequency(mut beam: Beam, mode: &Mode) -> Result<f64, VerificationError> {
    let rest = beam.nodes().to_vec();
    let clamp = rest[0];
    let normal = [-clamp[2].sin(), clamp[2].cos()];
    let shape: Vec<f64> = (0..rest.len()).map(|k| mode.at(k as f64 / (rest.len() - 1) as f64).across).collect();
    let bent = mode.bend(&rest, SMALL * beam.parameters().length_m);
    beam.start_from(&bent, &vec![[0.0; 3]; rest.len()])?;
    let at = GripState { x_m: clamp[0], z_m: clamp[1], tangent_rad: clamp[2] };
    let step_s = beam.discretisation().time_step_s;
    let period_s = 2.0 * PI / mode.frequency_rad_s;
    let mut passages_s = Vec::with_capacity(PASSAGES);
    let mut before = 1.0;
    while passages_s.len() < PASSAGES {
        beam.advance_to(beam.time_s() + step_s, |_| at);
        let amount: f64 = (0..rest.len())
            .map(|k| {
                let q = beam.nodes()[k];
                let across = (q[0] - rest[k][0]) * normal[0] + (q[1] - rest[k][1]) * normal[1];
                // The last node has half the mass of the others.
                let mass = if k + 1 == rest.len() { 0.5 } else { 1.0 };
                mass * shape[k] * across
            })
            .sum();
        if amount * before < 0.0 {
            passages_s.push(beam.time_s() - step_s * amount / (amount - before));
        }
        if beam.time_s() > PASSAGES as f64 * period_s {
            return Err(VerificationError::NoFrequency);
        }
        before = amount;
    }
    Ok(PI * (PASSAGES - 1) as f64 / (passages_s[PASSAGES - 1] - passages_s[0]))
}

/// Energy above rest of an undamped bar that swings freely, compared with its value a second earlier. Growth fails too.
pub(super) fn energy_drift(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let mut rows = Vec::new();
    for youngs_modulus_pa in [1e3, 1e4, 5e4] {
        let p = bar(0.2, youngs_modulus_pa);
        let at_rest_j = at_rest(p, d, grip(DOWN_RAD))?.energy().total_j();
        // The bar is released from its equilibrium under an additional side wind of 3 m/s^2.
        let blown = at_rest(BeamParameters { gravity_m_s2: [3.0, -GRAVITY_M_S2], ..p }, d, grip(DOWN_RAD))?;
        let mut beam = Beam::new(p, *d, grip(DOWN_RAD))?;
        beam.start_from(blown.nodes(), &vec![[0.0; 3]; blown.nodes().len()])?;
        let energy_j = [0.5, 1.5].map(|time_s| {
            beam.advance_to(time_s, |_| grip(DOWN_RAD));
            beam.energy().total_j() - at_rest_j
        });
        let what = format!("energy after 1 s, {youngs_modulus_pa:e} Pa");
        rows.push(Comparison::new(what, "J", energy_j[1], energy_j[0]));
    }
    Ok(rows)
}

/// Fall of a bar without a grip, compared with g t^2 / 2.
pub(super) fn free_fall(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let p = BeamParameters { clamped: false, ..bar(0.2, 1e4) };
    let mut beam = Beam::new(p, *d, grip(0.7))?;
    let (from, time_s) = (beam.tip()[1], 0.4);
    beam.advance_to(time_s, |_| grip(0.0));
    let fall_m = 0.5 * GRAVITY_M_S2 * time_s * time_s;
    Ok(vec![Comparison::new("fall in 0.4 s".into(), "m", from - beam.tip()[1], fall_m)])
}

/// Momentum and angular momentum of a weightless, curved bar that tumbles, bends and stretches, compared with a second
/// earlier.
pub(super) fn free_momentum(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let p = BeamParameters { clamped: false, gravity_m_s2: [0.0; 2], rest_curvature_per_m: 6.0, ..bar(0.2, 1e4) };
    let mut beam = Beam::new(p, *d, grip(0.4))?;
    let nodes = beam.nodes().to_vec();
    let last = (nodes.len() - 1) as f64;
    let velocities: Vec<[f64; 3]> =
        (0..nodes.len()).map(|k| k as f64 / last).map(|s| [0.3 - 0.4 * s, 0.1 + s, 3.0]).collect();
    beam.start_from(&nodes, &velocities)?;
    let (linear, angular) = (beam.momentum_kg_m_s(), beam.angular_momentum_kg_m2_s());
    beam.advance_to(1.0, |_| grip(0.0));
    let later = beam.momentum_kg_m_s();
    Ok(vec![
        Comparison::new("x after 1 s".into(), "kg m/s", later[0], linear[0]),
        Comparison::new("z after 1 s".into(), "kg m/s", later[1], linear[1]),
        Comparison::new("angular after 1 s".into(), "kg m^2/s", beam.angular_momentum_kg_m2_s(), angular),
    ])
}
