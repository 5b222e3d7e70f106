//! The simulator: planar beam physics, effects, scene, rendering, the vectorised environment, the pool and the simulated cell.
