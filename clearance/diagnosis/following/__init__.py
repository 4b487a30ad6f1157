"""From a guess to a path that follows a recording through its impacts."""
