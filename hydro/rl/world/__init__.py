"""World of the policies: all settings, and the path planner."""
