"""Export a controller as a C header, and the network of a policy also as ONNX; check the exported files."""
