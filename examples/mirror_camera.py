"""Mirror the person in front of a camera, all of whom must be in the picture: landmarks by MediaPipe, sent to a run.

flexmotion dry-run --mirror --view                          (in one terminal)
python examples/mirror_camera.py pose_landmarker_lite.task  (in another one; then the camera's number, if it is not 0)

The file is MediaPipe's model: https://ai.google.dev/edge/mediapipe/solutions/vision/pose_landmarker
"""

import json
import socket
import sys
import time

if len(sys.argv) < 2:
    sys.exit(__doc__)
try:
    import cv2
    import mediapipe as mp
except ImportError as error:
    sys.exit(f"mirror_camera.py needs {error.name}: pip install 'flexmotion[camera]'")

vision = mp.tasks.vision
options = vision.PoseLandmarkerOptions(
    base_options=mp.tasks.BaseOptions(model_asset_path=sys.argv[1]), running_mode=vision.RunningMode.VIDEO
)
camera = cv2.VideoCapture(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
with vision.PoseLandmarker.create_from_options(options) as landmarker:
    while camera.isOpened():
        taken, picture = camera.read()
        at = time.perf_counter()
        if not taken:
            sys.exit("the camera gives no picture")
        image = mp.Image(image_format=mp.ImageFormat.SRGB, data=cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
        for person in landmarker.detect_for_video(image, round(at * 1e3)).pose_world_landmarks[:1]:
            rows = [[one.x, one.y, one.z, one.visibility] for one in person]
            sender.sendto(json.dumps({"t": at, "landmarks": rows}).encode(), ("127.0.0.1", 39539))
sys.exit("the camera cannot be opened")
