//! Between target poses and a Panda: the safety gate, and the relay to a ROS 2 Cartesian controller.
