"""Gestures that recordings lack: arms, head, trunk and knees moved over recorded standing and walking."""
