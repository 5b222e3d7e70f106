//! The ROS side: the pool's services, and the simulated cell.

pub mod cell;
mod cell_arm;
mod cell_camera;
pub mod pool;
