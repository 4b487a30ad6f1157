"""What may be asserted: intervals, verdict, held-out recordings, and the evidence that is shown."""
