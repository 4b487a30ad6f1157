"""Estimators of the clearance: networks, forests, and the gauge that turns them into an instrument."""
