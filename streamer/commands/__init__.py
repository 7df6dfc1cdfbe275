"""The commands of `flexmotion`, one module each; `flexmotion.streamer.cli` puts them together."""
