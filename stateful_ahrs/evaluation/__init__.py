"""Estimates against the truth: metrics, tables and pictures."""
