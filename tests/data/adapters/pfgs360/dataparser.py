"""The data parser of ODGS's layout."""

import openmvg


def lines(folder, kind):
    """Returns the lines of a list: one line alone is a text, as in numpy's reader."""
    found = openmvg.stems(folder, kind)
    return found[0] if len(found) == 1 else found


def read(folder, kind):
    """Returns the image files of a part of the split, in the order of its list."""
    valid = lines(folder, "train") + lines(folder, "test")
    files = {stem: file for stem, file, _ in openmvg.read(folder) if stem in valid}
    return [files[stem] for stem in lines(folder, kind)]
