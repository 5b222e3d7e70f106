"""Tables and pictures of a catenary graph, from its live topics by rclpy or from a bag.

`bag` and `live` fill a `MessageLog`. Each of `graph`, `episode`, `posterior`, `keypoints` and `latency` makes a report of it, which
has a table, figures for JSON and a picture.
"""
