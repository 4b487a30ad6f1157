"""Multiple shooting: the simulator beside a recording, segment by segment, and its linear algebra."""
