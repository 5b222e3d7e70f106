"""Shared parts of the tests and benches: the program, processes in a domain of their own, rclpy, stand-ins, bags, hosts, a browser."""
