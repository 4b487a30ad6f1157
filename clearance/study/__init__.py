"""The paper's study: its trainings in order of value, as many as fit into the time that is given."""
