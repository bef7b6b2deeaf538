"""Whole controllers, wired from their parts."""
