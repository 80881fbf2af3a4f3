"""The controlled Markov chain of destructions."""
