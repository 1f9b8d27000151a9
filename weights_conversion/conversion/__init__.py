"""Converts trained networks between Caffe and other formats. See docs/MODELS.md.

The program `revisit` reads old files and runs networks; this package writes new ones and compares.
"""
