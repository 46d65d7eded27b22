"""What `gameopt-im bench` compares beside the stages: ratios of two ways to do the same, and growth with traffic."""
