"""What the nodes and the filters cost, as ratios taken in one run (`make bench`)."""
