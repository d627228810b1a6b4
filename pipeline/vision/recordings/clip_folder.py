"""Clips as a user keeps them: video files, and folders that each have a video and perhaps its masks."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import VideoError

VIDEO_SUFFIXES = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")
MASKS = ("masks.npz", "masks")


def find_clips(folder: Path) -> list[Path]:
    """The clips of a folder in the order of their names: videos, and folders with a video. Raises VideoError."""
    if not folder.is_dir():
        raise VideoError(f"suites.real.path: {folder} is not a folder; valid: a folder of videos, or null")
    return [p for p in sorted(folder.iterdir()) if _is_video(p) or (p.is_dir() and any(map(_is_video, p.iterdir())))]


def video_of(place: Path) -> Path:
    """The video itself, or the first one of a folder. Raises VideoError."""
    if not place.is_dir():
        return place
    videos = [p for p in sorted(place.iterdir()) if _is_video(p)]
    if not videos:
        raise VideoError(f"{place} has no video; valid: a file with one of {', '.join(VIDEO_SUFFIXES)}")
    return videos[0]


def masks_beside(place: Path) -> Path | None:
    """The masks in the folder of a clip: masks.npz, or a folder `masks`."""
    return next((place / name for name in MASKS if (place / name).exists()), None) if place.is_dir() else None


def _is_video(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES
