//! Likelihood-free inference: RKHS embedding, mixture density network, sequential posterior, diagnostics.
