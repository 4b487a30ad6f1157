"""The paper's tables and figures from finished trainings, beside the paper's own numbers."""
