"""The last stage: key points that lean one way, depending on the side they are seen from."""
