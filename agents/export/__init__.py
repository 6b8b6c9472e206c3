"""Export a controller as a C header, and a policy's network also as ONNX; check the exported files."""
