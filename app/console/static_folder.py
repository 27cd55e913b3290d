"""Where the pages' files lie."""

from pathlib import Path


def static_folder() -> Path:
    """Where the pages lie: inside the installed package, else beside it in a checkout.

    Raises:
        FileNotFoundError: in neither place.
    """
    package = Path(__file__).resolve().parents[1]
    places = (package / "static", package.parent / "static")
    for folder in places:
        if (folder / "index.html").is_file():
            return folder
    raise FileNotFoundError(f"the pages are missing: there is no index.html in {places[0]} nor in {places[1]}")
