//! Journal of a simulator's answers in a file, so that a killed search goes on after a restart.
//!
//! A search is deterministic: restarted, it asks the simulator the same questions, and reads the answers from the
//! journal.

use crate::{Question, Settings};
use catenary_core::hash::fnv1a;
use catenary_core::identity;
use catenary_core::simulator::{TrackSensitivities, Until};
use catenary_core::{DifferentiableSimulator, SimulationRequest, Simulator, SimulatorError, Track};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::HashMap;
use std::fs::File;
use std::io::{Result as IoResult, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::UNIX_EPOCH;

/// File extension of journals.
pub const EXTENSION: &str = "journal";

/// Bytes before an answer: fingerprint of the question, length of the answer, checksum of its bytes.
const HEAD: usize = 24;

/// Simulator that answers from a journal, and records the answers of another simulator.
pub struct Journal<'a> {
    simulator: &'a dyn DifferentiableSimulator,
    path: PathBuf,
    kept: Mutex<Kept>,
}

/// Open journal file with its index.
struct Kept {
    /// Journal file; none once writing has failed.
    file: Option<File>,
    /// Offset and length of each answer, by the fingerprint of its question.
    answers: HashMap<u64, (u64, usize)>,
    /// Offset of the next answer.
    end: u64,
}

/// Fingerprint of a search: its input, and everything else that the simulator's answers depend on (program and
/// machine).
pub fn fingerprint(question: &Question<'_>, settings: &Settings) -> u64 {
    let build = std::env::current_exe().and_then(|program| program.metadata()).ok().map(|m| {
        let modified = m.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        (m.len(), modified)
    });
    let Question { model, measured, validation, held_out, candidates, templates } = question;
    let machine = catenary_simulator::fingerprint(model);
    identity::fingerprint(&(build, machine, measured, validation, held_out, candidates, templates, settings))
}

impl<'a> Journal<'a> {
    /// Opens the journal at `path`. A file of the search `fingerprint` is continued; any other is overwritten, with a
    /// warning. If that fails, the reason is logged, and the search runs without a journal.
    pub fn open(path: PathBuf, fingerprint: u64, simulator: &'a dyn DifferentiableSimulator) -> Self {
        let kept = Kept::open(&path, fingerprint).unwrap_or_else(|error| {
            warn(&path, &error);
            Kept { file: None, answers: HashMap::new(), end: 0 }
        });
        Self { simulator, path, kept: Mutex::new(kept) }
    }

    /// Number of recorded answers.
    pub fn len(&self) -> usize {
        self.lock().answers.len()
    }

    /// Returns whether no answer is recorded.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns whether the journal is written, so that a killed search could go on.
    pub fn is_kept(&self) -> bool {
        self.lock().file.is_some()
    }

    /// Removes the file of a finished search, unless another process holds it.
    pub fn remove(self) {
        if self.is_kept() {
            catenary_shell::remove_state(&self.path);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Recorded answer to the question `asked`; without one, the answer of `ask`, which is then recorded.
    fn answer<T: Serialize + DeserializeOwned>(
        &self,
        asked: u64,
        ask: impl FnOnce() -> Result<T, SimulatorError>,
    ) -> Result<T, SimulatorError> {
        if let Some(known) = self.lock().find(asked) {
            return Ok(known);
        }
        // The lock is free while the simulator works. Errors are not recorded, so that they are tried again.
        let answer = ask()?;
        let mut kept = self.lock();
        if let Err(error) = kept.keep(asked, &answer) {
            warn(&self.path, &error);
            kept.file = None;
        }
        Ok(answer)
    }
}

fn warn(path: &Path, error: &dyn std::error::Error) {
    tracing::warn!("{}: {error}; a killed search will start again from the beginning", path.display());
}

impl Kept {
    fn open(path: &Path, fingerprint: u64) -> IoResult<Self> {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let file = File::options().read(true).write(true).create(true).truncate(false).open(path)?;
        // A second process would overwrite the answers of the first.
        file.try_lock().map_err(|_| std::io::Error::other("another search has it"))?;
        let mut kept = Self { file: None, answers: HashMap::new(), end: 8 };
        let mut asked = [0; 8];
        if file.read_exact_at(&mut asked, 0).is_ok() && u64::from_le_bytes(asked) == fingerprint {
            kept.read(&file)?;
        } else {
            if file.metadata()?.len() > kept.end {
                tracing::warn!("{}: the answers of another search; this one starts over", path.display());
            }
            file.set_len(0)?;
            file.write_all_at(&fingerprint.to_le_bytes(), 0)?;
        }
        // A killed process may have left part of an answer.
        file.set_len(kept.end)?;
        kept.file = Some(file);
        Ok(kept)
    }

    /// Indexes the complete answers of a file, in order.
    fn read(&mut self, file: &File) -> IoResult<()> {
        let length = file.metadata()?.len();
        let mut head = [0; HEAD];
        while self.end + HEAD as u64 <= length {
            file.read_exact_at(&mut head, self.end)?;
            let [asked, count, sum] = [0, 8, 16].map(|at| value(&head[at..at + 8]));
            let from = self.end + HEAD as u64;
            if count > length - from {
                break;
            }
            let mut bytes = vec![0; count as usize];
            file.read_exact_at(&mut bytes, from)?;
            // After a damaged record no offset is known.
            if fnv1a(bytes) != sum {
                break;
            }
            self.answers.insert(asked, (from, count as usize));
            self.end = from + count;
        }
        Ok(())
    }

    fn find<T: DeserializeOwned>(&self, asked: u64) -> Option<T> {
        let (from, count) = *self.answers.get(&asked)?;
        let mut bytes = vec![0; count];
        self.file.as_ref()?.read_exact_at(&mut bytes, from).ok()?;
        postcard::from_bytes(&bytes).ok()
    }

    fn keep<T: Serialize>(&mut self, asked: u64, answer: &T) -> IoResult<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let bytes = postcard::to_stdvec(answer).map_err(std::io::Error::other)?;
        let count = bytes.len();
        let mut record = Vec::with_capacity(HEAD + count);
        for value in [asked, count as u64, fnv1a(bytes.iter().copied())] {
            record.write_all(&value.to_le_bytes())?;
        }
        record.extend(bytes);
        file.write_all_at(&record, self.end)?;
        self.answers.insert(asked, (self.end + HEAD as u64, count));
        self.end += record.len() as u64;
        Ok(())
    }
}

/// Number in eight bytes, little-endian.
fn value(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
}

impl Simulator for Journal<'_> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.answer(identity::fingerprint(request), || self.simulator.simulate(request))
    }

    fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
        let asked = identity::fingerprint(&(until.number, request));
        self.answer(asked, || self.simulator.simulate_until(request, until))
    }
}

impl DifferentiableSimulator for Journal<'_> {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let asked = identity::fingerprint(&(names, request));
        self.answer(asked, || self.simulator.sensitivities(request, names))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use track_fit::toy::{self, Toy};

    /// Toy that counts its questions.
    struct Counted {
        toy: Toy,
        times: AtomicUsize,
    }

    impl Counted {
        fn new() -> Self {
            Self { toy: Toy { gain: 1.0 }, times: AtomicUsize::new(0) }
        }

        fn times(&self) -> usize {
            self.times.load(Ordering::Relaxed)
        }
    }

    impl Simulator for Counted {
        fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
            self.times.fetch_add(1, Ordering::Relaxed);
            self.toy.simulate(request)
        }
    }

    impl DifferentiableSimulator for Counted {
        fn sensitivities(
            &self,
            request: &SimulationRequest,
            names: &[&str],
        ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
            self.times.fetch_add(1, Ordering::Relaxed);
            self.toy.sensitivities(request, names)
        }
    }

    fn request(lengths_m: &[f64]) -> SimulationRequest {
        let thetas = lengths_m.iter().map(|l| vec![*l, 9e3]).collect();
        SimulationRequest { thetas, ..toy::episode(&Toy { gain: 1.0 }, [0.25, 9e3], &[]).template }
    }

    /// Temporary folder, and the path of a journal in a subfolder that does not exist yet.
    fn path() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("journals/search.{EXTENSION}"));
        (folder, path)
    }

    #[test]
    fn recorded_answers_are_repeated_to_the_bit_without_asking() {
        let (_folder, path) = path();
        let simulator = Counted::new();
        let ask = |journal: &Journal<'_>| {
            let tracks = [&[0.3, 0.31][..], &[0.1 + 0.2]].map(|l| journal.simulate(&request(l)).unwrap());
            let names = [&["length_m"][..], &["length_m", "tip_mass_kg"]];
            (tracks, names.map(|n| journal.sensitivities(&request(&[0.3]), n).unwrap()))
        };
        let first = ask(&Journal::open(path.clone(), 7, &simulator));
        assert_eq!(simulator.times(), 4);
        let again = Journal::open(path.clone(), 7, &simulator);
        assert_eq!((again.len(), ask(&again) == first, simulator.times()), (4, true, 4));
        drop(again);
        let other = Journal::open(path.clone(), 8, &simulator);
        assert!(other.is_empty(), "of another search");
        assert!(ask(&other) == first && simulator.times() == 8);
        other.remove();
        assert!(!path.exists());
    }

    #[test]
    fn an_early_end_makes_another_question() {
        let (_folder, path) = path();
        let simulator = Counted::new();
        let journal = Journal::open(path, 7, &simulator);
        let until = |number| Until { is_enough: &|_, _| false, number };
        journal.simulate(&request(&[0.3])).unwrap();
        for (number, times) in [(1, 2), (2, 3), (1, 3)] {
            journal.simulate_until(&request(&[0.3]), until(number)).unwrap();
            assert_eq!(simulator.times(), times);
        }
    }

    #[test]
    fn a_killed_process_loses_at_most_its_last_answer() {
        let (_folder, path) = path();
        let simulator = Counted::new();
        let journal = Journal::open(path.clone(), 7, &simulator);
        for length in [0.3, 0.31, 0.32] {
            journal.simulate(&request(&[length])).unwrap();
        }
        drop(journal);
        let whole = std::fs::read(&path).unwrap();
        let third = 8 + (whole.len() - 8) / 3 * 2;
        for end in [third, third + 1, third + HEAD, whole.len() - 1] {
            std::fs::write(&path, &whole[..end]).unwrap();
            assert_eq!(Journal::open(path.clone(), 7, &simulator).len(), 2, "{end} bytes");
        }
        let mut wrong = whole.clone();
        wrong[third + HEAD + 5] ^= 1;
        std::fs::write(&path, &wrong).unwrap();
        let journal = Journal::open(path.clone(), 7, &simulator);
        assert_eq!(journal.len(), 2, "a byte that is not what was written");
        journal.simulate(&request(&[0.32])).unwrap();
        drop(journal);
        assert_eq!(std::fs::read(&path).unwrap(), whole);
        // A header alone, and part of one.
        for end in [0, 5, 8] {
            std::fs::write(&path, &whole[..end]).unwrap();
            assert!(Journal::open(path.clone(), 7, &simulator).is_empty(), "{end} bytes");
        }
    }

    #[test]
    fn errors_are_not_recorded_and_an_unwritable_journal_is_harmless() {
        let simulator = Counted::new();
        let (_folder, path) = path();
        let journal = Journal::open(path.clone(), 7, &simulator);
        for _ in 0..2 {
            journal.simulate(&request(&[0.1])).unwrap_err();
        }
        assert_eq!((simulator.times(), journal.len()), (2, 0));
        drop(journal);
        // The second journal locks the file.
        let second = Journal::open(path, 7, &simulator);
        let taken = Journal::open(second.path.clone(), 7, &simulator);
        for journal in [&taken, &Journal::open(PathBuf::from("/dev/null/journal"), 7, &simulator)] {
            let before = simulator.times();
            (0..2).for_each(|_| assert_eq!(journal.simulate(&request(&[0.3])).unwrap().len(), 1));
            assert_eq!((simulator.times() - before, journal.len(), journal.is_kept()), (2, 0, false));
        }
        taken.remove();
        assert!(second.is_kept() && second.path.exists(), "it is another's");
        second.remove();
    }
}
