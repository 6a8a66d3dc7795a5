"""Converts a file of Gaussians with gsply.

usage: convert_gsply.py FROM TO

Kinds follow from the endings, as those that omnilife gives.
"""

import sys

import gsply

source, target = sys.argv[1:]
if source.endswith(".sog"):
    from gsply.sog_reader import sogread

    gaussians = sogread(source)
elif source.endswith(".spz"):
    gaussians = gsply.read_spz(source)
else:
    gaussians = gsply.plyread(source)
if target.endswith(".spz"):
    gsply.write_spz(target, gaussians, version=3 if target.endswith(".v3.spz") else 4)
else:
    gsply.plywrite(target, gaussians, compressed=target.endswith(".compressed.ply"))
