"""Scores of answers, their summaries, tables, plots and pictures, and the report."""
