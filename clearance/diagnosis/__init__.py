"""What was left out of the simulator: found in recordings, named, modelled, and shown."""
