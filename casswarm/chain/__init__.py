"""The controlled Markov chain of destructions, sampled and enumerated."""
