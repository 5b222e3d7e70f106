//! Open environment sets of all callers, by handle.

use catenary_simulator::VectorEnv;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use thiserror::Error;

/// Largest number of environment sets that may be open at once.
// A bound on memory: every set holds its own objects.
pub const MAX_OPEN: usize = 16;
/// Idle time after which an environment set is closed. Its trainer then counts as dead: between two steps a trainer needs
/// at most some minutes for an update of its networks.
pub const IDLE: Duration = Duration::from_secs(1800);

/// Error of a handle that cannot be given or found.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum HandleError {
    /// Too many open environment sets.
    #[error("{MAX_OPEN} sets of environments are open already: close one first")]
    Full,
    /// Handle without environments.
    #[error("handle {0}: no environments are open under it")]
    Unknown(u64),
}

/// Environment set of one caller.
struct Entry {
    env: Arc<Mutex<VectorEnv>>,
    /// Time of the last step, or of the opening.
    used: Instant,
}

/// Open environment sets by handle.
#[derive(Default)]
pub struct Environments {
    envs: BTreeMap<u64, Entry>,
    newest: u64,
}

impl Environments {
    /// Returns the number of open sets.
    pub fn count(&self) -> usize {
        self.envs.len()
    }

    /// Closes the sets that nobody has used for [`IDLE`]. Returns their handles.
    pub fn close_idle(&mut self, now: Instant) -> Vec<u64> {
        let idle = |entry: &Entry| now.saturating_duration_since(entry.used) > IDLE;
        let closed = self.envs.iter().filter(|(_, entry)| idle(entry)).map(|(handle, _)| *handle).collect();
        self.envs.retain(|_, entry| !idle(entry));
        closed
    }

    /// Stores environments under a new handle.
    ///
    /// # Errors
    /// [`HandleError::Full`] if [`MAX_OPEN`] sets are open.
    pub fn insert(&mut self, env: VectorEnv, now: Instant) -> Result<u64, HandleError> {
        if self.envs.len() >= MAX_OPEN {
            return Err(HandleError::Full);
        }
        self.newest += 1;
        self.envs.insert(self.newest, Entry { env: Arc::new(Mutex::new(env)), used: now });
        Ok(self.newest)
    }

    /// Returns the environments under a handle, and marks them as used.
    ///
    /// # Errors
    /// [`HandleError::Unknown`] if none are open under it.
    pub fn get(&mut self, handle: u64, now: Instant) -> Result<Arc<Mutex<VectorEnv>>, HandleError> {
        let entry = self.envs.get_mut(&handle).ok_or(HandleError::Unknown(handle))?;
        // Concurrent requests can reach this line in another order than their `now`.
        entry.used = entry.used.max(now);
        Ok(Arc::clone(&entry.env))
    }

    /// Closes the environments under a handle.
    ///
    /// # Errors
    /// [`HandleError::Unknown`] if none are open under it.
    pub fn close(&mut self, handle: u64) -> Result<(), HandleError> {
        self.envs.remove(&handle).map(drop).ok_or(HandleError::Unknown(handle))
    }
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "a test takes the time once, as any instant")]
mod tests {
    use super::*;
    use catenary_core::Fidelity;
    use catenary_simulator::model_text;

    const SOFT_BAR: &str = include_str!("../../../../launch_configs/models/soft_bar.yaml");

    fn env() -> VectorEnv {
        let model = model_text::read(SOFT_BAR).unwrap();
        VectorEnv::open(&model, 1, vec![vec![0.25, 1e4]], Fidelity::Fast, 1, 1).unwrap()
    }

    #[test]
    fn environments_of_a_dead_trainer_make_room() {
        let (mut opened, start) = (Environments::default(), Instant::now());
        let handles: Vec<u64> = (0..MAX_OPEN).map(|_| opened.insert(env(), start).unwrap()).collect();
        assert!(opened.insert(env(), start).unwrap_err().to_string().contains("close one first"));
        // Half the idle time: a trainer between two updates.
        let later = start + IDLE / 2;
        assert_eq!(opened.close_idle(later), [] as [u64; 0], "a trainer may think");
        opened.get(handles[3], later).unwrap();
        let closed = opened.close_idle(start + IDLE + Duration::from_secs(1));
        assert_eq!((closed.len(), closed.contains(&handles[3])), (MAX_OPEN - 1, false));
        assert!(opened.get(handles[0], later).map(drop).unwrap_err().to_string().contains("no environments are open"));
        let new = opened.insert(env(), later).unwrap();
        assert!(!handles.contains(&new), "handle {new} means something else to a trainer that lives on");
        assert_eq!((opened.close(new), opened.close(new)), (Ok(()), Err(HandleError::Unknown(new))));
    }
}
