"""The commands of `flexmotion`, one module each; `streamer.cli` puts them together."""
