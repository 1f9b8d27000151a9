"""Conversion of trained networks between Caffe and other formats; see docs/CONVERSION.md.

The libraries of `revisit` read old files and run networks. This package writes new files and compares outputs.
"""
