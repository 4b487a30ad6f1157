"""What the simulator costs, measured beside a general multibody code."""
