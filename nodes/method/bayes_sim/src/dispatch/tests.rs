//! Assignment of parts to pools that answer, fall silent, leave and return.

use super::*;
use proptest::prelude::*;

const LIMITS: Limits = Limits {
    max_part: 10,
    first_part: 4,
    part_s: 1.0,
    patience_factor: 5.0,
    min_patience_s: 3.0,
    first_patience_s: 20.0,
    stall_s: 60.0,
};

fn names(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn begun(episodes: usize, pools: &[&str]) -> Dispatch {
    let mut dispatch = Dispatch::new(LIMITS);
    dispatch.set_pools(&names(pools));
    dispatch.begin(episodes, LIMITS, 0.0);
    dispatch
}

#[test]
fn every_free_pool_gets_a_part_and_no_pool_two() {
    let mut dispatch = begun(100, &["/a", "/b"]);
    let (first, second) = (dispatch.next(0.0).unwrap(), dispatch.next(0.0).unwrap());
    assert_ne!(first.pool, second.pool);
    assert_eq!((first.episodes, second.episodes), (0..4, 4..8));
    assert_eq!(dispatch.next(0.0), None, "both are at work");
    assert_eq!(dispatch.answered(first.call, 0.5), Answered::First(0..4));
    assert_eq!(dispatch.next(0.5).unwrap().pool, first.pool);
}

#[test]
fn a_faster_pool_does_more_and_the_last_parts_are_small() {
    // Pool /a needs 0.05 s for an episode, /b 0.5 s.
    let mut dispatch = begun(200, &["/a", "/b"]);
    let seconds = |pool: &str| if pool == "/a" { 0.05 } else { 0.5 };
    let mut due: Vec<(f64, Assignment)> = Vec::new();
    let (mut now_s, mut last) = (0.0, BTreeMap::new());
    while !dispatch.is_done() {
        while let Some(part) = dispatch.next(now_s) {
            last.insert(part.pool.clone(), part.episodes.len());
            due.push((now_s + seconds(&part.pool) * part.episodes.len() as f64, part));
        }
        due.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (at_s, part) = due.pop().unwrap();
        now_s = at_s;
        dispatch.answered(part.call, now_s);
    }
    let tallies: BTreeMap<&str, Tally> = dispatch.tallies().collect();
    assert_eq!(tallies["/a"].episodes + tallies["/b"].episodes, 200);
    assert!(tallies["/a"].episodes > 5 * tallies["/b"].episodes, "{tallies:?}");
    assert!(last.values().all(|size| *size <= 3), "{last:?}");
    let ideal_s = 200.0 / (1.0 / 0.05 + 1.0 / 0.5);
    assert!(now_s < ideal_s + 2.0, "{now_s} s, where {ideal_s} s is possible");
}

#[test]
fn a_silent_pool_is_noticed_by_the_times_that_were_measured_and_its_part_is_done_by_another() {
    let mut dispatch = begun(40, &["/a", "/b"]);
    let (a, b) = (dispatch.next(0.0).unwrap(), dispatch.next(0.0).unwrap());
    // Before any measurement, silence and work cannot be distinguished.
    assert_eq!(dispatch.expire(19.0), []);
    dispatch.answered(a.call, 4.0);
    dispatch.answered(b.call, 4.0);
    let lost = dispatch.next(4.0).unwrap();
    let n = lost.episodes.len() as f64;
    assert!((dispatch.wait_s(4.0) - 5.0 * n).abs() < 1e-9, "1 s an episode, five times");
    assert_eq!(dispatch.expire(4.0 + 5.0 * n - 0.1), []);
    let waited_s = 5.0 * n;
    let silent = Event::Silent { pool: lost.pool.clone(), episodes: lost.episodes.clone(), waited_s };
    let now_s = 4.0 + waited_s;
    assert_eq!(dispatch.expire(now_s), [silent]);
    let again = dispatch.next(now_s).unwrap();
    assert_eq!(again.episodes, lost.episodes);
    assert_ne!(again.pool, lost.pool);
    assert_eq!(dispatch.next(now_s), None, "the silent pool is left alone for now");
    assert_eq!(dispatch.next(now_s + 3.0).unwrap().pool, lost.pool, "and tried again after a while");
}

#[test]
fn the_first_of_two_answers_to_a_part_counts_and_is_in_the_tally() {
    for late_is_first in [false, true] {
        let mut dispatch = begun(4, &["/a"]);
        let silent = dispatch.next(0.0).unwrap();
        assert_eq!(silent.episodes, 0..2);
        assert_eq!(dispatch.expire(20.0).len(), 1);
        dispatch.set_pools(&names(&["/a", "/b"]));
        let again = dispatch.next(20.0).unwrap();
        assert_eq!((again.pool.as_str(), again.episodes.clone()), ("/b", 0..2));
        let (one, two) = if late_is_first { (&silent, &again) } else { (&again, &silent) };
        assert_eq!(dispatch.answered(one.call, 21.0), Answered::First(0..2));
        assert_eq!(dispatch.answered(two.call, 21.5), Answered::Late);
        assert_eq!(dispatch.answered(two.call, 22.0), Answered::Late);
        let a = dispatch.tallies().next().unwrap().1;
        assert_eq!(a, if late_is_first { Tally { episodes: 2, lost: 0 } } else { Tally { episodes: 0, lost: 2 } });
    }
}

#[test]
fn a_pool_that_leaves_is_not_awaited_and_one_that_joins_gets_work_at_once() {
    let mut dispatch = begun(4, &["/a"]);
    let part = dispatch.next(0.0).unwrap();
    let left = Event::Left { pool: "/a".into(), episodes: Some(part.episodes.clone()) };
    assert_eq!(dispatch.set_pools(&names(&["/b"])), [left, Event::Joined { pool: "/b".into() }]);
    let again = dispatch.next(0.1).unwrap();
    assert_eq!((again.pool.as_str(), again.episodes), ("/b", part.episodes));
    assert_eq!(dispatch.set_pools(&names(&["/a", "/b"])), [Event::Joined { pool: "/a".into() }]);
    assert_eq!(dispatch.next(0.2).unwrap().pool, "/a");
}

#[test]
fn an_answer_to_an_earlier_batch_does_not_count() {
    let mut dispatch = begun(4, &["/a"]);
    let old = dispatch.next(0.0).unwrap();
    dispatch.begin(4, LIMITS, 1.0);
    assert_eq!(dispatch.answered(old.call, 2.0), Answered::Late);
    let new = dispatch.next(2.0).unwrap();
    assert_eq!(dispatch.answered(new.call, 3.0), Answered::First(0..2));
}

#[test]
fn a_refused_pool_gets_no_more_parts_and_the_error_has_the_reason() {
    let mut dispatch = begun(4, &["/a"]);
    let part = dispatch.next(0.0).unwrap();
    dispatch.refused(part.call, "it is version 0.0.9");
    assert_eq!((dispatch.next(50.0), dispatch.stalled(59.0)), (None, None));
    let said = dispatch.stalled(60.0).unwrap();
    assert_eq!(said, "no pool has been at work for 60 s, 1 in the graph; /a: it is version 0.0.9");
    // After an absence it may be another pool.
    dispatch.set_pools(&names(&[]));
    dispatch.set_pools(&names(&["/a"]));
    assert_eq!(dispatch.next(61.0).unwrap().episodes, 0..2);
}

#[test]
fn the_wait_for_a_pool_ends_and_one_that_is_at_work_is_waited_for() {
    let mut dispatch = begun(4, &[]);
    assert_eq!(dispatch.stalled(59.9), None);
    assert_eq!(dispatch.stalled(60.0).unwrap(), "no pool has been at work for 60 s, 0 in the graph");
    dispatch.set_pools(&names(&["/a"]));
    let part = dispatch.next(61.0).unwrap();
    assert_eq!(dispatch.stalled(70.0), None, "it is at work");
    dispatch.failed(part.call, "/a: garbled", 71.0);
    assert_eq!(dispatch.stalled(129.0), None, "it was at work at 70 s");
    assert!(dispatch.stalled(130.0).unwrap().ends_with("1 in the graph; /a: garbled"));
}

/// Step of a random run.
#[derive(Debug, Clone)]
enum Step {
    Answer(usize),
    AnswerTwice(usize),
    Fail(usize),
    Refuse(usize),
    Pools(u8),
    Wait(f64),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        6 => any::<usize>().prop_map(Step::Answer),
        1 => any::<usize>().prop_map(Step::AnswerTwice),
        1 => any::<usize>().prop_map(Step::Fail),
        1 => any::<usize>().prop_map(Step::Refuse),
        2 => any::<u8>().prop_map(Step::Pools),
        3 => (0.0..40.0).prop_map(Step::Wait),
    ];
    proptest::collection::vec(step, 0..200)
}

/// Counts the episodes of an answer that is accepted.
fn book(dispatch: &mut Dispatch, part: &Assignment, now_s: f64, count: &mut [usize]) -> Result<(), TestCaseError> {
    if let Answered::First(episodes) = dispatch.answered(part.call, now_s) {
        prop_assert_eq!(&episodes, &part.episodes);
        episodes.for_each(|i| count[i] += 1);
    }
    Ok(())
}

proptest! {
    #[test]
    fn each_episode_counts_once_whatever_is_lost_doubled_late_or_joins(episodes in 0usize..120, steps in steps()) {
        let mut dispatch = Dispatch::new(LIMITS);
        dispatch.begin(episodes, LIMITS, 0.0);
        let (mut now_s, mut asked, mut count) = (0.0, Vec::<Assignment>::new(), vec![0; episodes]);
        for step in steps {
            dispatch.expire(now_s);
            while let Some(part) = dispatch.next(now_s) {
                asked.push(part);
            }
            // Any request may be answered at any time, and more than once.
            let pick = |k: usize| asked.get(k % asked.len().max(1)).cloned();
            match step {
                Step::Answer(k) => if let Some(part) = pick(k) { book(&mut dispatch, &part, now_s, &mut count)? },
                Step::AnswerTwice(k) => if let Some(part) = pick(k) {
                    book(&mut dispatch, &part, now_s, &mut count)?;
                    book(&mut dispatch, &part, now_s, &mut count)?;
                },
                Step::Fail(k) => if let Some(part) = pick(k) { dispatch.failed(part.call, "failed", now_s) },
                Step::Refuse(k) => if let Some(part) = pick(k) { dispatch.refused(part.call, "another version") },
                Step::Pools(bits) => {
                    let there = (0..4).filter(|i| bits >> i & 1 == 1).map(|i| format!("/pool{i}")).collect();
                    dispatch.set_pools(&there);
                }
                Step::Wait(seconds) => now_s += seconds,
            }
            prop_assert!(count.iter().all(|n| *n <= 1), "counted twice: {:?}", count);
            prop_assert_eq!(dispatch.is_done(), count.iter().all(|n| *n == 1));
        }
        // A new pool that answers everything must finish the batch.
        dispatch.set_pools(&names(&["/new"]));
        for _ in 0..10 * (episodes + 1) {
            dispatch.expire(now_s);
            let Some(part) = dispatch.next(now_s) else {
                now_s += dispatch.wait_s(now_s).max(0.1);
                if dispatch.is_done() { break } else { continue }
            };
            prop_assert_eq!(&part.pool, "/new");
            now_s += 0.1;
            book(&mut dispatch, &part, now_s, &mut count)?;
        }
        prop_assert!(dispatch.is_done() && count.iter().all(|n| *n == 1), "{:?}", count);
        prop_assert_eq!(dispatch.tallies().map(|(_, tally)| tally.episodes).sum::<usize>(), episodes);
    }
}
