"""Campaigns: a grid of scenarios times many seeds, in parallel, as tables with intervals."""
