"""What may be missing: named effects, faults of sensors, forces of free form."""
