"""Tables and pictures of a catenary graph: of its live topics by rclpy, or of a bag.

`bag` and `live` fill a `MessageLog`; the other modules each make a report of one, which has a table, figures for JSON, and a picture.
"""
