"""Which explanations are tried, in which order, and when it is enough."""
