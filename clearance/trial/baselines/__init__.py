"""What a user would do today: a fit of the trajectory, sparse regression, a two-sample test."""
