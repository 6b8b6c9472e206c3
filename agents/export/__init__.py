"""Export of a policy: a C header with the whole controller, and an ONNX graph of its network, both checked."""
