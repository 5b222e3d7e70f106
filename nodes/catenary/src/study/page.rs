//! Page of a study.

use super::deployment::Deployments;
use super::dtw;
use super::plan::{Knowledge, Models, Plan};
use super::results::{BestPlan, EvidenceGains, Gain, Pairs, PolicyScores, Study, TaskResult};
use super::work::{Inferred, Scored, acted};
use crate::graph::own::Cell;
use crate::report::number::plain;
use crate::report::palette::Role;
use crate::report::plots::policies::{MeanPath, Timelapse, grid, mean_paths, timelapses};
use crate::report::plots::search::{Interval as Row, intervals};
use crate::report::plots::{self, Series};
use crate::report::{Page, posterior};
use anyhow::{Context, Result};
use catenary_core::comparison::{Decision, Interval};
use catenary_core::statistics::mean;
use catenary_core::track::End;
use catenary_core::{Frame, Judge, Model, Track};

/// p-value below which a gain is marked.
const LEVEL: f64 = 0.01;
/// Samples of a posterior that a training takes.
const DOMAINS: usize = 12;

/// Data of the pictures.
pub struct Data<'a> {
    /// Posteriors by object and evidence.
    pub inferred: &'a [Vec<Inferred>],
    /// Scores of the chains of the plan.
    pub scores: &'a [Scored],
    /// Deployments by task, policy and place.
    pub deployments: &'a [Vec<Vec<Deployments>>],
    /// Models of the plan.
    pub models: &'a Models,
}

/// Answer in sentences, one a task.
pub fn words(study: &Study) -> String {
    study.tasks.iter().map(|task| sentence(study, task)).collect::<Vec<String>>().join("\n")
}

fn sentence(study: &Study, task: &TaskResult) -> String {
    let of = |against: &str| task.all.iter().find(|g| g.against == against);
    let Some(uniform) = of("U") else { return format!("{}: no result", task.task) };
    let better = task.objects.iter().filter(|o| o.gains.iter().any(|g| g.against == "U" && is_gain(g))).count();
    // The smallest p-value of n trainings is 2 / 2^n.
    let few =
        if 2.0_f64.powi(1 - study.plan.seeds as i32) < LEVEL { "" } else { " (so few trainings cannot reach that)" };
    let lost = of("mismatched").map_or_else(String::new, |g| {
        format!("; policies of other objects earn {} against it", interval(&turned(&g.gain), 2))
    });
    let deployed = task.deployments.iter().find(|pairs| pairs.object == "all").map_or_else(String::new, |pairs| {
        let (won, lost) = (pairs.signs.wins, pairs.signs.losses);
        format!(" Deployed {}, the own policy was better than U in {won} of {} pairs.", place(study.cell), won + lost)
    });
    format!(
        "{}: knowing the object is worth {} of reward, with p < {LEVEL} on {better} of {} objects{few}{lost}.{deployed}",
        task.task,
        interval(&uniform.gain, 2),
        study.plan.objects.len()
    )
}

/// Place of the deployments.
fn place(cell: Option<Cell>) -> &'static str {
    match cell {
        None => "in simulation at the highest fidelity",
        Some(Cell::Sim) => "on the whole graph, in the simulated cell",
        Some(Cell::Emulated) => "on the whole graph, with an emulated Panda",
    }
}

/// The difference the other way round.
fn turned(i: &Interval) -> Interval {
    Interval { value: -i.value, low: -i.high, high: -i.low }
}

/// True if the matched policy is better with a p-value below [`LEVEL`].
fn is_gain(gain: &Gain) -> bool {
    gain.gain.value > 0.0 && gain.p < LEVEL
}

fn interval(i: &Interval, decimals: usize) -> String {
    format!("{} ({} to {})", plain(i.value, decimals), plain(i.low, decimals), plain(i.high, decimals))
}

/// Renders the whole page.
pub fn page(study: &Study, data: &Data<'_>) -> Result<String> {
    let mut page = Page::new("What is it worth to know the object?");
    let sentences: Vec<String> = study.tasks.iter().map(|task| sentence(study, task)).collect();
    page.answer(&sentences, false);
    let plan = &study.plan;
    page.note(&format!(
        "{} trainings of each policy with at most {} environment steps, scored on {} episodes an object at the highest fidelity of the \
         simulation, with camera noise and nuisances drawn anew. Episodes of the same number have the same conditions for all policies. \
         Rewards are means over episodes, then interquartile means over trainings; brackets are intervals of 95 % by stratified \
         bootstrap over trainings; * is p < {LEVEL} of a paired test over trainings, not corrected for the number of rows.{}",
        plan.seeds,
        plan.steps,
        plan.episodes,
        match (plan.observes.history, plan.observes.time) {
            (0, false) => String::new(),
            (n, time) => {
                let time = if time { ", the time" } else { "" };
                let before = if n > 0 { format!(", and {n} before it") } else { String::new() };
                format!(" The policies see the newest observation{time}{before}.")
            }
        }
    ));
    for (index, task) in study.tasks.iter().enumerate() {
        of_task(&mut page, study, data, task, index)?;
    }
    posteriors(&mut page, study, data)?;
    Ok(page.finish())
}

fn of_task(page: &mut Page, study: &Study, data: &Data<'_>, task: &TaskResult, index: usize) -> Result<()> {
    page.heading(&format!("Task {}", task.task));
    page.paragraph(&task.aim);
    let gains = |gains: &[Gain]| -> Vec<String> {
        let words = |against: &str| {
            gains.iter().find(|g| g.against == against).map_or_else(String::new, |g| {
                let mark = if g.p < LEVEL { " *" } else { "" };
                format!("{}{mark}", interval(&g.gain, 3))
            })
        };
        task.all.iter().map(|g| words(g.against)).collect()
    };
    let mut rows: Vec<Vec<String>> =
        task.objects.iter().map(|o| [vec![o.object.clone(), interval(&o.own, 3)], gains(&o.gains)].concat()).collect();
    rows.push([vec!["all".to_owned(), String::new()], gains(&task.all)].concat());
    let minus: Vec<String> = task.all.iter().map(|g| format!("minus {}", g.against)).collect();
    let head: Vec<&str> = ["object", "own policy"].into_iter().chain(minus.iter().map(String::as_str)).collect();
    page.table(&head, &rows);
    page.note(
        "Own: trained over the posterior of the object. U: over the prior. mu: for the middle of the prior. Mismatched: mean of the \
         policies of the other objects' posteriors. True: told the hidden values.",
    );
    let shown: Vec<Row> = task
        .objects
        .iter()
        .filter_map(|o| {
            let gain = o.gains.iter().find(|g| g.against == "U")?;
            let role = if is_gain(gain) { Role::After } else { Role::Other };
            Some(Row { name: o.object.clone(), values: [gain.gain.low, gain.gain.value, gain.gain.high], role })
        })
        .collect();
    page.svg(&intervals("Own policy minus U", "reward", &shown));
    let profiles: Vec<Series> = task
        .profiles
        .iter()
        .map(|p| Series {
            name: p.group.to_owned(),
            points: p.thresholds.iter().copied().zip(p.shares.iter().map(|s| s.value)).collect(),
        })
        .collect();
    page.svg(&plots::lines("Share of trainings above a reward", "mean reward", "share", &profiles)?);
    page.svg(&plots::lines("Learning curves", "environment steps", "mean return", &curves(study, data, index))?);
    policies(page, study, task);
    evidence(page, study, task)?;
    deployments(page, study, data, task, index)
}

/// Mean learning curve of each group of policies.
fn curves(study: &Study, data: &Data<'_>, task: usize) -> Vec<Series> {
    let chains = study.plan.chains();
    let group = |name: &str, is_member: &dyn Fn(Knowledge) -> bool| {
        let members: Vec<&Scored> = chains
            .iter()
            .zip(data.scores)
            .filter(|(c, _)| c.task == task && is_member(c.knowledge))
            .map(|(_, s)| s)
            .collect();
        // A training that ended earlier keeps its last return.
        let longest = members.iter().map(|s| &s.curve).max_by_key(|curve| curve.len());
        let point = |(i, at): (usize, &(u64, f64, f64))| {
            let value = |s: &&Scored| s.curve.get(i).or(s.curve.last()).map(|p| p.1);
            (at.0 as f64, mean(&members.iter().filter_map(value).collect::<Vec<f64>>()))
        };
        let points = longest.map_or_else(Vec::new, |curve| curve.iter().enumerate().map(point).collect());
        Series { name: name.to_owned(), points }
    };
    let mut groups = vec![
        group("own", &|k| matches!(k, Knowledge::Posterior { evidence: 0, .. })),
        group("U", &|k| k == Knowledge::Prior),
        group("mu", &|k| k == Knowledge::Median),
        group("true", &|k| matches!(k, Knowledge::Truth(_))),
    ];
    groups.retain(|g| !g.points.is_empty());
    groups
}

/// Every policy on every object.
fn policies(page: &mut Page, study: &Study, task: &TaskResult) {
    let mut head = vec!["policy"];
    head.extend(study.plan.objects.iter().map(|o| o.name.as_str()));
    head.push("all");
    let row = |p: &PolicyScores| {
        let cell = |(returns, successes): (&Vec<f64>, &Vec<f64>)| {
            format!("{}, {} %", plain(mean(returns), 3), plain(100.0 * mean(successes), 0))
        };
        let cells = p.mean_returns.iter().zip(&p.successes).map(cell);
        std::iter::once(p.policy.clone()).chain(cells).chain([interval(&p.interquartile_mean, 3)]).collect()
    };
    // Policies of the further evidence have a table of their own.
    let shown = task.policies.iter().filter(|p| !matches!(p.knowledge, Knowledge::Posterior { evidence: 1.., .. }));
    let plan = |p: &BestPlan| format!("{}, {} %", plain(p.mean_return, 3), plain(100.0 * p.success, 0));
    let plans = std::iter::once("best plan found".to_owned()).chain(task.best_plans.iter().map(plan));
    let plans: Vec<String> = plans.chain([String::new()]).collect();
    let rows = shown.map(row).chain((!task.best_plans.is_empty()).then_some(plans));
    page.table(&head, &rows.collect::<Vec<Vec<String>>>());
    let of_plans = "Best plan found: for each object the plan that a search finds with its hidden values; it sees the target once, and nothing \
                    else.";
    page.note(&format!(
        "Mean reward and share of successes, over all trainings and episodes; at the end, the interquartile mean. {}",
        if task.best_plans.is_empty() { "" } else { of_plans }
    ));
}

/// Reward against what the posterior knows. Nothing for a study of one evidence.
fn evidence(page: &mut Page, study: &Study, task: &TaskResult) -> Result<()> {
    if task.evidence.len() < 2 {
        return Ok(());
    }
    page.heading(&format!("What evidence is worth in {}", task.task));
    let nats = |evidence: usize| -> Vec<f64> {
        study.objects.iter().map(|o| o.posteriors[evidence].information_nat).collect()
    };
    let of = |gains: &[Gain], against: &str| {
        let found = gains.iter().find(|g| g.against == against);
        found.map_or_else(String::new, |g| format!("{}{}", interval(&g.gain, 3), if g.p < LEVEL { " *" } else { "" }))
    };
    let row = |(i, e): (usize, &EvidenceGains)| {
        let by_object = nats(i).iter().map(|n| plain(*n, 1)).collect::<Vec<String>>().join(", ");
        let own = if i == 0 { "-".to_owned() } else { of(&e.all, "own") };
        vec![e.evidence.words(), by_object, of(&e.all, "U"), own, of(&e.all, "true")]
    };
    page.table(
        &["evidence", "information, nat", "minus U", "minus own", "minus true"],
        &task.evidence.iter().enumerate().map(row).collect::<Vec<Vec<String>>>(),
    );
    page.note(
        "Each policy on the object that its posterior is of, over all objects. Own: the first evidence. Information: the Kullback-Leibler \
         divergence of the posterior from the prior, by object.",
    );
    let shown = task.evidence.iter().enumerate().filter_map(|(i, e)| {
        let gain = &e.all.iter().find(|g| g.against == "U")?.gain;
        let role = if i == 0 { Role::After } else { Role::Posterior };
        Some(Row { name: e.evidence.words(), values: [gain.low, gain.value, gain.high], role })
    });
    let told = task.told.as_ref().map(|Gain { gain, .. }| Row {
        name: "told the hidden values".to_owned(),
        values: [gain.low, gain.value, gain.high],
        role: Role::Truth,
    });
    page.svg(&intervals("Reward minus that of U, by evidence", "reward", &shown.chain(told).collect::<Vec<Row>>()));
    let series = |(object, name): (usize, &str)| {
        let of = |(i, e): (usize, &EvidenceGains)| (nats(i)[object], e.objects[object].gain.value);
        let mut points: Vec<(f64, f64)> =
            std::iter::once((0.0, 0.0)).chain(task.evidence.iter().enumerate().map(of)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Series { name: name.to_owned(), points }
    };
    let series: Vec<Series> = study.objects.iter().map(|o| o.object.as_str()).enumerate().map(series).collect();
    page.svg(&plots::lines("Reward minus that of U, by information", "nat", "reward", &series)?);
    Ok(())
}

fn deployments(page: &mut Page, study: &Study, data: &Data<'_>, task: &TaskResult, index: usize) -> Result<()> {
    let plan = &study.plan;
    page.heading(&format!("Deployments in {}", task.task));
    page.paragraph(&format!(
        "The first training of each of these policies ran {} times on each object, {}. Paths are those of the commanded poses.",
        plan.repeats,
        place(study.cell)
    ));
    rewards(page, plan, &data.deployments[index]);
    page.table(
        &["object", "own better than U", "worse", "decision"],
        &task.deployments.iter().map(decision).collect::<Vec<Vec<String>>>(),
    );
    page.note(
        "A sequential sign test with an error of 5 %, looked at after every pair: it says when more pairs would decide nothing. Eight pairs \
         of one sign decide.",
    );
    let model = &data.models.tasks[index];
    let judge = Judge::of(model).context("a task file has a task")?;
    let target_m = judge.task().target_m;
    let knowledge = plan.deployed();
    let deployed = |wanted: Knowledge, object: usize| -> Option<&Deployments> {
        let policy = knowledge.iter().position(|k| *k == wanted)?;
        Some(&data.deployments[index][policy][object])
    };
    let farthest_m = judge.task().goal.reward_range_m().unwrap_or(0.3);
    for (object, hidden) in plan.objects.iter().enumerate() {
        let shown: Vec<(&str, Role, &Deployments)> = [
            ("own", Role::After, Knowledge::own(object)),
            ("U", Role::Before, Knowledge::Prior),
            ("mu", Role::Noise, Knowledge::Median),
        ]
        .into_iter()
        .filter_map(|(name, role, k)| Some((name, role, deployed(k, object)?)))
        .collect();
        let paths: Vec<MeanPath> =
            shown.iter().map(|(name, role, d)| mean_path(name, *role, &judge, &d.tracks)).collect();
        page.svg(&mean_paths(&format!("Commanded paths on {}", hidden.name), &paths, target_m, farthest_m)?);
        page.svg(&by_step(&hidden.name, &judge, &shown)?);
        let episodes: Vec<Timelapse> = shown
            .iter()
            .filter(|(name, ..)| *name != "mu")
            .filter_map(|(name, role, d)| timelapse(name, *role, model, d.tracks.first()?))
            .collect();
        page.svg(&timelapses(&format!("First deployments on {}", hidden.name), &episodes, target_m)?);
    }
    page.note(
        "First deployments: the object at each step, the later the darker, with a dot at the hand. \
         Commanded paths: a disc is as wide as the paths of one policy differ, and the darker, the nearer the object is to its goal.",
    );
    let names: Vec<String> = knowledge.iter().map(|k| plan.policy_name(*k)).collect();
    let paths = |k: Knowledge| -> Vec<Vec<[f64; 2]>> {
        (0..plan.objects.len())
            .filter_map(|object| deployed(k, object))
            .flat_map(|d| d.tracks.iter().map(|track| commanded(&judge, track)))
            .collect()
    };
    let all: Vec<Vec<Vec<[f64; 2]>>> = knowledge.iter().map(|k| paths(*k)).collect();
    // Deployments of the same number are on the same object in the same conditions.
    let between = |a: &[Vec<[f64; 2]>], b: &[Vec<[f64; 2]>]| {
        1e3 * mean(&a.iter().zip(b).map(|(a, b)| dtw::distance(a, b)).collect::<Vec<f64>>())
    };
    let values: Vec<Vec<f64>> = all.iter().map(|a| all.iter().map(|b| between(a, b)).collect()).collect();
    page.svg(&grid("Distance of commanded paths by time warping, mm", &names, &values, 0));
    Ok(())
}

/// Mean reward of the deployments of each policy at each place.
fn rewards(page: &mut Page, plan: &Plan, deployments: &[Vec<Deployments>]) {
    let mut head = vec!["policy"];
    head.extend(plan.objects.iter().map(|o| o.name.as_str()));
    head.push("own simulation");
    let cell = |d: &Deployments| {
        let returns: Vec<f64> = d.rewards.iter().map(|r| r.iter().sum()).collect();
        plain(mean(&returns), 2)
    };
    let row = |(knowledge, places): (&Knowledge, &Vec<Deployments>)| {
        std::iter::once(plan.policy_name(*knowledge)).chain(places.iter().map(cell)).collect()
    };
    page.table(&head, &plan.deployed().iter().zip(deployments).map(row).collect::<Vec<Vec<String>>>());
    page.note("Mean reward of the deployments. Own simulation: samples of what the policy was trained over, at the training's fidelity.");
}

/// The object at each step of an episode; nothing if the camera cannot place a keypoint in the plane.
fn timelapse(name: &str, role: Role, model: &Model, track: &Track) -> Option<Timelapse> {
    let line = |frame: &Frame| -> Option<Vec<[f64; 2]>> {
        let mut line = vec![[frame.eef[0], frame.eef[1]]];
        let mut left: Vec<[f64; 2]> =
            frame.dlo.iter().map(|p| model.camera.view.plane_from_scaled(*p)).collect::<Option<_>>()?;
        // The keypoints are a set: the line goes to the nearest one that is left.
        while !left.is_empty() {
            let at = line[line.len() - 1];
            let distance = |p: &[f64; 2]| (p[0] - at[0]).hypot(p[1] - at[1]);
            let nearest = (0..left.len()).min_by(|a, b| distance(&left[*a]).total_cmp(&distance(&left[*b])))?;
            line.push(left.swap_remove(nearest));
        }
        Some(line)
    };
    let lines_m = track.frames.iter().map(line).collect::<Option<_>>()?;
    Some(Timelapse { name: name.to_owned(), role, lines_m })
}

fn decision(pairs: &Pairs) -> Vec<String> {
    let after = pairs.after.map_or_else(String::new, |n| format!(" after {n} pair{}", if n == 1 { "" } else { "s" }));
    let words = match pairs.decision {
        Decision::First => format!("own is better{after}"),
        Decision::Second => format!("U is better{after}"),
        Decision::Open => "open: more pairs may decide".to_owned(),
        Decision::Hopeless => format!("not decided:{after} the pairs that were left could not decide"),
    };
    vec![pairs.object.clone(), pairs.signs.wins.to_string(), pairs.signs.losses.to_string(), words]
}

/// Commanded places (x, z) in m: the start, and the target of each action.
fn commanded(judge: &Judge, track: &Track) -> Vec<[f64; 2]> {
    let Some(first) = track.frames.first() else { return Vec::new() };
    let task = judge.task();
    let mut points = vec![[first.eef[0], first.eef[1]]];
    for frame in acted(task, track) {
        let last = points[points.len() - 1];
        points.push(task.delta_anchor.target_m(frame.action, [frame.eef[0], frame.eef[1]], last, 0.0));
    }
    points
}

fn mean_path(name: &str, role: Role, judge: &Judge, tracks: &[Track]) -> MeanPath {
    let paths: Vec<Vec<[f64; 2]>> = tracks.iter().map(|track| commanded(judge, track)).collect();
    let steps = paths.iter().map(Vec::len).min().unwrap_or(0);
    let at =
        |step: usize| -> [f64; 2] { [0, 1].map(|i| mean(&paths.iter().map(|p| p[step][i]).collect::<Vec<f64>>())) };
    let points_m: Vec<[f64; 2]> = (0..steps).map(at).collect();
    let deviation = |step: usize| {
        let m = points_m[step];
        let squares: Vec<f64> =
            paths.iter().map(|p| (p[step][0] - m[0]).powi(2) + (p[step][1] - m[1]).powi(2)).collect();
        mean(&squares).sqrt()
    };
    let distance = |step: usize| {
        let now = |t: &Track| {
            let left = t.end == End::LeftWorkspace;
            t.frames.get(step).map_or(f64::INFINITY, |f| judge.distance_m(&judge.moment(f, step, left)))
        };
        mean(&tracks.iter().map(now).collect::<Vec<f64>>())
    };
    MeanPath {
        name: name.to_owned(),
        role,
        deviations_m: (0..steps).map(deviation).collect(),
        distances_m: (0..steps).map(distance).collect(),
        points_m,
    }
}

/// Picture of the steps of deployments: the mean reward of `reach`, and the mean distance from the goal of the others, which are
/// paid at their end.
fn by_step(object: &str, judge: &Judge, deployed: &[(&str, Role, &Deployments)]) -> Result<String> {
    let is_paid_by_step = judge.task().goal.reward_range_m().is_none();
    let series = |(name, _, deployed): &(&str, Role, &Deployments)| {
        let steps = deployed.rewards.iter().map(Vec::len).min().unwrap_or(0);
        let distance_mm = |track: &Track, step: usize| {
            track.frames.get(step).map_or(f64::NAN, |f| 1e3 * judge.distance_m(&judge.moment(f, step, false)))
        };
        let value = |step: usize| {
            let values: Vec<f64> = if is_paid_by_step {
                deployed.rewards.iter().map(|r| r[step - 1]).collect()
            } else {
                deployed.tracks.iter().map(|t| distance_mm(t, step)).collect()
            };
            (step as f64, mean(&values))
        };
        Series { name: (*name).to_owned(), points: (1..=steps).map(value).collect() }
    };
    let (title, label) = if is_paid_by_step { ("Reward", "reward") } else { ("Distance from the goal", "mm") };
    let series: Vec<Series> = deployed.iter().map(series).collect();
    plots::lines(&format!("{title} by step on {object}"), "step", label, &series)
}

fn posteriors(page: &mut Page, study: &Study, data: &Data<'_>) -> Result<()> {
    page.heading("Posteriors");
    for (object, inferred) in study.objects.iter().zip(data.inferred) {
        for (evidence, inferred) in study.plan.evidence.iter().zip(inferred) {
            let posterior = inferred.posterior();
            page.heading(&format!("{}: {}", object.object, evidence.words()));
            page.warnings(inferred.misfit.as_slice());
            if posterior.parameters.dimension() >= 2 {
                let domains = posterior.sample_low_variance(DOMAINS, study.plan.seed)?;
                page.wide(&plots::corner(&posterior, &domains, Some(&object.truth))?);
            }
            page.table(&posterior::HEAD, &posterior::rows(&posterior, &inferred.marginals, Some(&object.truth)));
        }
    }
    Ok(())
}
