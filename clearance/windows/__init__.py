"""What a model sees: recordings with known clearances, cut, split and scaled."""
