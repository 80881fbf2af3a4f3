"""Files in AMPL's ``.nl`` format: problems of other tools, and casswarm's problems for them.

D. M. Gay, Writing .nl Files, Sandia National Laboratories, SAND2005-7907P, 2005.
"""
