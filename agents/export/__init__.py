"""Export of controllers, both forms checked: a C header with the whole controller, and ONNX of a policy's network."""
