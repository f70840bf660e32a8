"""The figures and tables of the papers once more, side by side with what is printed."""
