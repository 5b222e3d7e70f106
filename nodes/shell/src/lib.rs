//! Everything ROS 2, once: participant, names, QoS, parameters, arguments, clocks, watchdogs and ordered shutdown.
