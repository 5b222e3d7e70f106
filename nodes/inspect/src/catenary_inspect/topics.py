"""Names and types of the topics that reports read."""

IMAGE = ("/camera/camera/color/image_raw", "sensor_msgs/msg/Image")
MASK = ("/dlo/mask", "sensor_msgs/msg/Image")
KEYPOINTS = ("/dlo/keypoints", "catenary_msgs/msg/Keypoints")
POSE = ("/panda/current_pose", "geometry_msgs/msg/PoseStamped")
JOINTS = ("/panda/joint_states", "sensor_msgs/msg/JointState")
ARM_STATE = ("/panda/arm_state", "catenary_msgs/msg/ArmState")
TARGET = ("/panda/target_pose", "geometry_msgs/msg/PoseStamped")
ACCEPTED = ("/panda/accepted_target", "catenary_msgs/msg/AcceptedTarget")
ACTION = ("/policy/action", "catenary_msgs/msg/EefDelta")
OBSERVATION = ("/policy/observation", "catenary_msgs/msg/Observation")
EVENT = ("/episode/event", "catenary_msgs/msg/EpisodeEvent")
POSTERIOR = ("/bayes_sim/posterior", "catenary_msgs/msg/Mixture")
