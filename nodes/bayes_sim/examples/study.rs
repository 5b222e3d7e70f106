#![allow(unsafe_code, warnings, clippy::all)]
use bayes_sim::embedding::*;
use bayes_sim::sequential::*;
use bayes_sim::settings::*;
use catenary_core::simulator::StartShape;
use catenary_core::track::End;
use catenary_core::*;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use std::ops::ControlFlow;
use std::time::Instant;

struct Linear {
    d: usize,
    sigma: f64,
}
const F: usize = 8;
impl Linear {
    fn coef(&self, f: usize, k: usize, j: usize) -> f64 {
        let mut r = seed::rng(99, (f * 100 + k * 10 + j) as u64);
        0.3 * r.sample::<f64, _>(StandardNormal)
    }
    fn base(k: usize) -> [f64; 2] {
        [0.1, -0.75 + 0.5 * k as f64]
    }
    fn one(&self, u: &[f64], s: u64, noise: bool) -> Track {
        let mut rng = seed::rng(s, 0);
        let frames = (0..F)
            .map(|f| {
                let mut dlo: [[f64; 2]; 4] = std::array::from_fn(|k| {
                    let b = Self::base(k);
                    let m: f64 = (0..self.d).map(|j| self.coef(f, k, j) * (u[j] - 0.5)).sum();
                    let e: f64 = rng.sample(StandardNormal);
                    [b[0] + m + if noise { self.sigma * e } else { 0.0 }, b[1]]
                });
                if rng.random::<bool>() {
                    dlo.reverse();
                }
                Frame { time_s: f as f64 * 0.1, dlo, target: [0.0; 2], eef: [0.4, 0.3, 0.0], action: [0.0; 2] }
            })
            .collect();
        Track { frames, end: End::Complete }
    }
    /// exact untruncated posterior mean, cov
    fn exact(&self, t: &Track) -> (nalgebra::DVector<f64>, nalgebra::DMatrix<f64>) {
        let d = self.d;
        let mut p = nalgebra::DMatrix::zeros(d, d);
        let mut h = nalgebra::DVector::zeros(d);
        for (f, fr) in t.frames.iter().enumerate() {
            let mut s = fr.dlo;
            s.sort_by(|a, b| a[1].total_cmp(&b[1]));
            for k in 0..4 {
                let c = nalgebra::DVector::from_fn(d, |j, _| self.coef(f, k, j));
                let off: f64 = c.iter().map(|v| v * 0.5).sum();
                let y = s[k][0] - Self::base(k)[0] + off;
                p += &c * c.transpose() / self.sigma.powi(2);
                h += &c * y / self.sigma.powi(2);
            }
        }
        let cov = p.try_inverse().unwrap();
        (&cov * h, cov)
    }
}
trait Toy: Simulator {
    fn one_u(&self, u: &[f64], s: u64) -> Track;
    fn space(&self) -> ParameterSpace;
    fn frames(&self) -> usize;
}
fn unit_space(d: usize) -> ParameterSpace {
    ParameterSpace::new(
        (0..d).map(|i| Parameter { name: format!("p{i}"), prior: Prior::Uniform { low: 0.0, high: 1.0 } }).collect(),
    )
    .unwrap()
}
impl Simulator for Linear {
    fn simulate(&self, r: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        Ok(r.thetas.iter().enumerate().map(|(i, u)| self.one(u, seed::derive(r.seed, i as u64), true)).collect())
    }
}
impl Toy for Linear {
    fn one_u(&self, u: &[f64], s: u64) -> Track {
        self.one(u, s, true)
    }
    fn space(&self) -> ParameterSpace {
        unit_space(self.d)
    }
    fn frames(&self) -> usize {
        F
    }
}

struct Swing {
    d: usize,
}
impl Swing {
    fn sim(&self, u: &[f64], s: u64) -> Track {
        let mut rng = seed::rng(s, 0);
        let l = 0.195 + 0.11 * u[0];
        let e = 1e3 * (u[1] * 50f64.ln()).exp();
        let lot: f64 = rng.random();
        let damp = 0.3 * ((if self.d > 2 { u[2] } else { lot }) * 5f64.ln()).exp();
        let fric: f64 = 0.5 + rng.random::<f64>();
        let stretch = 0.5 * 1055.0 * 9.81 * l * l / e * 0.3;
        let w2 = 1.5 * 9.81 / l + 0.02 * e / 1055.0 / l.powi(3) * 1e-2;
        let (mut q, mut v) = (0.0, 0.0);
        let dt = 0.005;
        let n = (8.0 / dt) as usize;
        let mut frames = vec![];
        let mut path: Vec<f64> = vec![0.4; 17];
        for i in 1..17 {
            let mut r = seed::rng(5, i as u64);
            path[i] = (path[i - 1] + 0.06 * (2.0 * r.random::<f64>() - 1.0)).clamp(0.3, 0.55);
        }
        let xg = |t: f64| {
            let i = (t / 0.5) as usize;
            let a = path[i.min(16)];
            let b = path[(i + 1).min(16)];
            let w = (t / 0.5 - i as f64).clamp(0.0, 1.0);
            let w = w * w * (3.0 - 2.0 * w);
            a + (b - a) * w
        };
        for i in 0..=n {
            let t = i as f64 * dt;
            let acc = (xg(t + dt) - 2.0 * xg(t) + xg((t - dt).max(0.0))) / dt / dt;
            if i % 50 == 0 {
                let ll = l * (1.0 + stretch);
                let mut dlo = [0.125, 0.375, 0.625, 0.875].map(|f: f64| {
                    let a = q * (0.5 + f);
                    let e1: f64 = rng.sample(StandardNormal);
                    let e2: f64 = rng.sample(StandardNormal);
                    [
                        (xg(t) - 0.44 + ll * f * (a as f64).sin()) / 0.45 + 0.0055 * e1,
                        (-0.15 + ll * f * (a as f64).cos()) / 0.45 + 0.0055 * e2,
                    ]
                });
                if rng.random::<bool>() {
                    dlo.reverse();
                }
                frames.push(Frame { time_s: t, dlo, target: [0.1, 0.5], eef: [xg(t), 0.42, 0.0], action: [0.0; 2] });
            }
            v += dt * (-w2 * (q as f64).sin() - damp * fric * v - acc * 1.5 / l);
            q += dt * v;
        }
        Track { frames, end: End::Complete }
    }
}
impl Simulator for Swing {
    fn simulate(&self, r: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let sp = self.space();
        Ok(r.thetas.iter().enumerate().map(|(i, u)| self.sim(&sp.to_unit(u), seed::derive(r.seed, i as u64))).collect())
    }
}
impl Toy for Swing {
    fn one_u(&self, u: &[f64], s: u64) -> Track {
        self.sim(u, s)
    }
    fn space(&self) -> ParameterSpace {
        unit_space(self.d)
    }
    fn frames(&self) -> usize {
        33
    }
}

fn main() {
    let a: Vec<String> = std::env::args().collect();
    let get = |k: &str, d: f64| -> f64 {
        a.iter().find_map(|s| s.strip_prefix(&format!("{k}="))).map_or(d, |v| v.parse().unwrap())
    };
    let toy: Box<dyn Toy> = match a[1].as_str() {
        "lin" => Box::new(Linear { d: get("d", 2.0) as usize, sigma: get("sigma", 0.1) }),
        _ => Box::new(Swing { d: get("d", 2.0) as usize }),
    };
    let mut st = if get("paper", 0.0) > 0.0 { Settings::paper() } else { Settings::default() };
    st.iterations = get("it", st.iterations as f64) as usize;
    st.simulations = get("n", st.simulations as f64) as usize;
    st.embedding.frequencies = get("m", st.embedding.frequencies as f64) as usize;
    if get("sin", 0.0) > 0.0 {
        st.embedding.fourier = Fourier::CosSin;
    }
    st.length_scale = get("ls", st.length_scale);
    let h = get("h", st.hidden[0] as f64) as usize;
    st.hidden = vec![h; get("layers", st.hidden.len() as f64) as usize];
    st.ensemble = get("ens", st.ensemble as f64) as usize;
    st.components = get("k", st.components as f64) as usize;
    st.projection = match get("p", st.projection.unwrap_or(0) as f64) as usize {
        0 => None,
        n => Some(n),
    };
    st.schedule.train_embedding = get("te", st.schedule.train_embedding as u8 as f64) > 0.0;
    st.skip = get("skip", st.skip as u8 as f64) > 0.0;
    st.warm_start = get("warm", st.warm_start as u8 as f64) > 0.0;
    st.held_out_share = get("ho", st.held_out_share);
    st.schedule.learning_rate = get("lr", st.schedule.learning_rate);
    st.schedule.weight_decay = get("wd", st.schedule.weight_decay);
    st.schedule.batch_size = get("bs", st.schedule.batch_size as f64) as usize;
    st.schedule.max_epochs = get("ep", st.schedule.max_epochs as f64) as usize;
    st.schedule.patience_epochs = get("pat", st.schedule.patience_epochs as f64) as usize;
    if get("post", 0.0) > 0.0 {
        st.proposal = ProposalKind::Posterior { prior_share: get("post", 0.1) };
    } else {
        st.proposal = ProposalKind::Truncated { tail: get("tail", 1e-3), least_shrink: get("shrink", 0.25) };
    }
    st.schedule.max_gradient_norm = get("gn", st.schedule.max_gradient_norm);
    let reps = get("reps", 20.0) as usize;
    let verbose = get("v", 0.0) > 0.0;
    let space = toy.space();
    let d = space.dimension();
    let (mut slp, mut cov50, mut cov90, mut cov99, mut z2, mut err) = (0.0, 0, 0, 0, 0.0, vec![0.0; d]);
    let mut time = 0.0;
    let mut sds = vec![0.0; d];
    let mut me = 0.0;
    let mut sr = 0.0;
    let mut fails = 0;
    let mut elq = 0.0;
    let mut losts = vec![];
    let mut lps = vec![];
    for rep in 0..reps {
        let mut rng = seed::rng(1000 + rep as u64, 7);
        let truth: Vec<f64> = (0..d).map(|_| rng.random::<f64>()).collect();
        let obs = toy.one_u(&truth, rng.random());
        st.seed = rep as u64;
        let t0 = Instant::now();
        let mut seq = Sequential::new(&space, &obs, toy.frames(), &st).unwrap();
        let template = SimulationRequest {
            thetas: vec![],
            effects: vec![],
            drive: Drive::Actions(vec![]),
            start: StartShape::HangingAtRest,
            frame_times_s: vec![],
            target_m: None,
            fidelity: Fidelity::Standard,
            seed: 0,
            noise: true,
        };
        let mut last = None;
        let mut bad = false;
        let mut lost = 0;
        for _ in 0..st.iterations {
            match seq.step(&template, SimRef(&*toy).get(), &mut |_| ControlFlow::Continue(())) {
                Ok((it, p)) => {
                    if lost == 0 && !seq.proposal().unwrap().covers(&truth) {
                        lost = it.iteration;
                    }
                    if verbose {
                        let m = p.marginals().unwrap();
                        eprintln!(
                            "{it:?} truth {truth:.3?} {:?}",
                            m.iter().map(|m| (m.mean, m.sd)).collect::<Vec<_>>()
                        );
                    }
                    last = Some(p);
                }
                Err(e) => {
                    eprintln!("rep {rep}: {e}");
                    bad = true;
                    break;
                }
            }
        }
        time += t0.elapsed().as_secs_f64();
        if bad {
            fails += 1;
            continue;
        }
        let p = last.unwrap();
        let inside = 1.0 - p.mixture.mass_outside(4000, &mut seed::rng(1, 1));
        let lq = p.log_density_unit(&truth) - inside.ln();
        slp += lq;
        lps.push(lq);
        let draws = p.sample(2000, 3).unwrap();
        let above = draws.iter().filter(|t| p.log_density_unit(t) - inside.ln() > lq).count() as f64 / 2000.0;
        cov50 += (above < 0.5) as usize;
        cov90 += (above < 0.9) as usize;
        cov99 += (above < 0.99) as usize;
        let m = p.marginals().unwrap();
        if lost > 0 {
            losts.push((rep, lost, (lq * 10.0).round() / 10.0));
        }
        for j in 0..d {
            let e = m[j].mean - truth[j];
            err[j] += e * e;
            sds[j] += m[j].sd;
            z2 += (e / m[j].sd).powi(2) / d as f64;
        }
        if a[1] == "lin" {
            let l = Linear { d, sigma: get("sigma", 0.1) };
            let (em, ec) = l.exact(&obs);
            // truncated exact moments by sampling
            let ex = Posterior {
                parameters: space.clone(),
                mixture: Mixture::new(&[1.0], vec![em], vec![(&ec + ec.transpose()) * 0.5]).unwrap(),
            };
            let mm = ex.marginals().unwrap();
            elq += ex.log_density_unit(&truth) - (1.0 - ex.mixture.mass_outside(4000, &mut seed::rng(1, 1))).ln();
            for j in 0..d {
                me += ((m[j].mean - mm[j].mean) / mm[j].sd).powi(2) / d as f64;
                sr += (m[j].sd / mm[j].sd).ln() / d as f64;
            }
        }
    }
    let r = (reps - fails) as f64;
    lps.sort_by(f64::total_cmp);
    println!(
        "{} | logq {:.3} (min {:.2}) cov50 {:.2} cov90 {:.2} cov99 {:.2} z2 {:.2} rmse {:?} sd {:?} | exact: logq {:.3} mean err {:.2} sd, sd ratio {:.2} | lost {losts:?} | fails {fails} time/inf {:.1}s",
        a[1..].join(" "),
        slp / r,
        lps[0],
        cov50 as f64 / r,
        cov90 as f64 / r,
        cov99 as f64 / r,
        z2 / r,
        err.iter().map(|e| (1e4 * (e / r).sqrt()).round() / 1e4).collect::<Vec<_>>(),
        sds.iter().map(|e| (1e4 * e / r).round() / 1e4).collect::<Vec<_>>(),
        elq / r,
        (me / r).sqrt(),
        (sr / r).exp(),
        time / reps as f64
    );
}
struct SimRef<'a>(&'a dyn Toy);
impl<'a> SimRef<'a> {
    fn get(&self) -> &'a dyn Simulator {
        self.0
    }
}
