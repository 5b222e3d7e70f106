//! Proximal policy optimisation over a vectorised environment.
