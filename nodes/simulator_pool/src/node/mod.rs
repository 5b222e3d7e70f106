//! The ROS side: the pool's services, and the simulated cell.

pub mod cell;
pub mod pool;
