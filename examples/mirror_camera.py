"""Mirror the person in front of a camera: landmarks by MediaPipe, sent to a run.

pip install 'flexmotion[camera]'
flexmotion dry-run --mirror --view                          (in one terminal)
python examples/mirror_camera.py pose_landmarker_lite.task  (in another one; then the camera's number, if it is not 0)

The file is MediaPipe's model, which its guide to the pose landmarker offers:
https://ai.google.dev/edge/mediapipe/solutions/vision/pose_landmarker. The whole person must be in the picture.
"""

from __future__ import annotations

import json
import socket
import sys
import time
from importlib.util import find_spec
from pathlib import Path

ADDRESS = ("127.0.0.1", 39539)


def main(model: Path, camera: int) -> None:
    missing = [name for name in ("cv2", "mediapipe") if find_spec(name) is None]
    if missing:
        sys.exit(f"mirror_camera.py needs {' and '.join(missing)}: pip install 'flexmotion[camera]'")
    if not model.is_file():
        sys.exit(f"{model}: no such file; expected MediaPipe's pose_landmarker_*.task (see --help)")
    import cv2
    from mediapipe import Image, ImageFormat
    from mediapipe.tasks.python import BaseOptions, vision

    options = vision.PoseLandmarkerOptions(
        base_options=BaseOptions(model_asset_path=str(model)), running_mode=vision.RunningMode.VIDEO
    )
    pictures = cv2.VideoCapture(camera)
    if not pictures.isOpened():
        sys.exit(f"camera {camera} cannot be opened")
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        vision.PoseLandmarker.create_from_options(options) as landmarker,
    ):
        while pictures.isOpened():
            taken, picture = pictures.read()
            at = time.perf_counter()
            if not taken:
                break
            picture = Image(image_format=ImageFormat.SRGB, data=cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
            people = landmarker.detect_for_video(picture, round(at * 1e3)).pose_world_landmarks
            if people:
                rows = [[one.x, one.y, one.z, one.visibility] for one in people[0]]
                sender.sendto(json.dumps({"t": at, "landmarks": rows}).encode(), ADDRESS)
    pictures.release()


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] in ("-h", "--help"):
        sys.exit(__doc__)
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
