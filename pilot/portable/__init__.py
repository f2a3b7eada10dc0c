"""Models as ONNX files, and networks of other projects: ONNX with a description, Keras."""
