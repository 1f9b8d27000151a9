"""Converts trained networks between Caffe and other formats. See docs/MODELS.md.

The libraries of `revisit` read old files and run networks; this package writes new ones and compares.
"""
