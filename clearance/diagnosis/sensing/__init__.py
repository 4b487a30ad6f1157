"""What recordings say, and what instruments did to it."""
