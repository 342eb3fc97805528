"""The names of the files of wrinkle maps, by which a folder of maps is known before they are made."""

import os
import re

from wrinklecli.files.outputs import Outputs

MAPS_JSON = "maps.json"
_IMAGE = re.compile(r"\w+_[1-9][0-9]*_(normal|height|ao|mask_[1-9][0-9]*)\.png", re.ASCII)


def image_name(owner: str, number: int, kind: str) -> str:
    """The name of an image: of a material's name in letters, digits and `_`, the set's number, and what it shows."""
    return f"{owner}_{number}_{kind}.png"


def is_map_file(name: str) -> bool:
    """True if a file of maps may have this name."""
    return name == MAPS_JSON or _IMAGE.fullmatch(name) is not None


def claim_folder(folder: str, outputs: Outputs) -> None:
    """Announce the files of maps in a folder, which is made if it is missing, before anything is known of the asset.

    Of the images, those that exist are announced: no other can be an input of the run.

    Raises:
        BakeError: The folder cannot be made, or a file there is an input or another output, or cannot be written.
    """
    outputs.make_folders(folder)
    outputs.claim(os.path.join(folder, MAPS_JSON))
    try:
        names = sorted(os.listdir(folder or os.curdir))
    except OSError:  # a folder that may be written but not listed: each image is claimed when it is written
        return
    for name in names:
        if name != MAPS_JSON and is_map_file(name):
            outputs.claim(os.path.join(folder, name))
