"""How good an estimate is: the metrics of the paper, and pictures."""
