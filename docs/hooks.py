"""Lets the pages show the figures of results/, which stay where their raw numbers are."""

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files


def on_files(files: Files, config: Any) -> Files:
    """Adds the pictures and films of results/ to the site, as results/..."""
    root = Path(config.config_file_path).parent
    for path in sorted((root / "results").rglob("*")):
        if path.suffix in (".png", ".mp4"):
            uri = path.relative_to(root).as_posix()
            files.append(File.generated(config, uri, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """From docs/ they are in ../results, also on GitHub; on the site in results."""
    return markdown.replace("](../results/", "](results/")
